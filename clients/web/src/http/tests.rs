//! The server of the page over real sockets, with no session behind it.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::thread::JoinHandle;

use super::*;
use crate::places::STRANGERS;

/// Longest wait for an answer before a test is called hung.
const HUNG: Duration = Duration::from_secs(60);

/// A server in a thread of its own.
struct Running {
    address: SocketAddr,
    token: String,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn new() -> Running {
        let runtime = tokio::runtime::Builder::new_current_thread();
        let runtime = { runtime }.enable_all().build().expect("a runtime");
        let any = SocketAddr::from(([127, 0, 0, 1], 0));
        let listener = runtime.block_on(TcpListener::bind(any)).expect("a port");
        let address = listener.local_addr().expect("an address");
        let guard = Guard::new(address).expect("random numbers");
        let token = guard.token().to_owned();
        let site = Arc::new(Site {
            shared: Shared::new(),
            orders: None,
            presets: Value::Null,
            guard,
            board: None,
        });
        let stop = Arc::new(AtomicBool::new(false));
        let seen = stop.clone();
        let thread = std::thread::spawn(move || {
            runtime.block_on(serve(listener, site, &seen));
            runtime.shutdown_background();
        });
        Running {
            address,
            token,
            stop,
            thread: Some(thread),
        }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).expect("it listens");
        stream.set_read_timeout(Some(HUNG)).expect("a time limit");
        stream
    }

    fn head(&self, line: &str, more: &[&str]) -> String {
        let host = format!("host: {}", self.address);
        let first = format!("{line} HTTP/1.1");
        let lines = [&[first.as_str(), &host], more, &["", ""]].concat();
        lines.join("\r\n")
    }

    fn with_token(&self) -> String {
        format!("x-cosplat-token: {}", self.token)
    }

    /// Status of the answer to a request by a connection.
    fn ask(&self, stream: &mut TcpStream, line: &str, more: &[&str]) -> Option<u16> {
        let _ = stream.write_all(self.head(line, more).as_bytes());
        head_of_answer(stream).and_then(|head| head[9..12].parse().ok())
    }

    /// The same by a connection of its own.
    fn status(&self, line: &str, more: &[&str]) -> Option<u16> {
        self.ask(&mut self.connect(), line, more)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().expect("the server ends in order");
        }
    }
}

/// Head of an answer whose body is read and left; nothing where the server hung up.
fn head_of_answer(stream: &mut TcpStream) -> Option<String> {
    let mut head = Vec::new();
    let mut byte = [0];
    while !head.ends_with(b"\r\n\r\n") {
        match stream.read(&mut byte) {
            Ok(1) => head.push(byte[0]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => panic!("no answer"),
            _ => return None,
        }
    }
    let head = String::from_utf8(head)
        .expect("a head is text")
        .to_lowercase();
    let length = head
        .lines()
        .find_map(|l| l.strip_prefix("content-length: "));
    let length = length.map_or(0, |l| l.parse().expect("a length"));
    stream.read_exact(&mut vec![0; length]).ok()?;
    Some(head)
}

/// Asks for the page again and again and reads nothing, until nothing more is taken or this server hangs up.
fn stuff(running: &Running, more: &[&str]) -> TcpStream {
    let mut stream = running.connect();
    let short = Duration::from_millis(50);
    stream.set_write_timeout(Some(short)).expect("a time limit");
    let requests = running.head("GET /main.js", more).repeat(100);
    for _ in 0..100 {
        if stream.write_all(requests.as_bytes()).is_err() {
            break;
        }
    }
    stream
}

#[test]
fn who_has_no_token_keeps_nobody_out() {
    let running = Running::new();
    let token = running.with_token();
    let mut page = running.connect();
    assert_eq!(running.ask(&mut page, "GET /scene", &[&token]), Some(200));
    let mut deaf: Vec<_> = (0..8).map(|_| stuff(&running, &[])).collect();
    let silent = (0..2 * STRANGERS).map(|_| running.connect());
    deaf.extend(silent);
    // Pages that come, and those that were there.
    assert_eq!(running.status("GET /", &[]), Some(200));
    assert_eq!(running.status("GET /scene", &[&token]), Some(200));
    assert_eq!(running.ask(&mut page, "GET /scene", &[&token]), Some(200));
    // The first of them lost their places.
    let mut rest = Vec::new();
    let _ = deaf[0].read_to_end(&mut rest);
    drop(deaf);
}

#[test]
fn one_connection_too_many_that_knows_the_token_is_told_so() {
    let running = Running::new();
    let token = running.with_token();
    let mut known: Vec<TcpStream> = (0..KNOWN).map(|_| running.connect()).collect();
    for stream in &mut known {
        assert_eq!(running.ask(stream, "GET /scene", &[&token]), Some(200));
    }
    let mut more = running.connect();
    assert_eq!(running.ask(&mut more, "GET /", &[]), Some(200));
    assert_eq!(running.ask(&mut more, "GET /scene", &[&token]), Some(429));
    assert_eq!(running.ask(&mut more, "GET /", &[]), None);
    drop(known);
    while running.status("GET /scene", &[&token]) != Some(200) {}
}

#[test]
fn who_takes_no_answer_or_says_nothing_more_loses_its_place() {
    let running = Running::new();
    let token = running.with_token();
    let scene = || running.status("GET /scene", &[&token]);
    let mut known: Vec<TcpStream> = (0..KNOWN / 2)
        .map(|_| {
            let mut stream = running.connect();
            assert_eq!(running.ask(&mut stream, "GET /scene", &[&token]), Some(200));
            stream
        })
        .collect();
    let deaf = (KNOWN / 2..KNOWN).map(|_| {
        let mut stream = running.connect();
        assert_eq!(running.ask(&mut stream, "GET /scene", &[&token]), Some(200));
        let _ = stream.set_write_timeout(Some(Duration::from_millis(20)));
        let requests = running.head("GET /main.js", &[&token]).repeat(100);
        while stream.write_all(requests.as_bytes()).is_ok() {}
        stream
    });
    known.extend(deaf);
    let begun = std::time::Instant::now();
    while scene() != Some(200) {
        assert!(begun.elapsed() < HUNG, "the places are not free again");
        std::thread::sleep(Duration::from_millis(50));
    }
    for mut stream in known {
        let mut rest = Vec::new();
        let _ = stream.read_to_end(&mut rest);
    }
}

#[test]
fn a_header_that_decides_comes_once() {
    let running = Running::new();
    let token = running.with_token();
    let own = format!("origin: http://{}", running.address);
    let other = "origin: http://evil.example";
    let host = format!("host: {}", running.address);
    let ask = |more: &[&str]| {
        let all = [&[token.as_str()], more].concat();
        running.status("GET /scene", &all)
    };
    assert_eq!(ask(&[&own]), Some(200));
    for more in [
        [own.as_str(), other],
        [other, &own],
        [&own, &own],
        ["sec-fetch-site: same-origin", "sec-fetch-site: cross-site"],
        ["sec-fetch-site: none", "sec-fetch-site: none"],
        [&own, &host],
        [&own, "origin: \u{e4}"],
    ] {
        assert_eq!(ask(&more), Some(403), "{more:?}");
    }
    assert_eq!(ask(&[&token]), Some(401));
    let wrong = format!("x-cosplat-token: {}", "0".repeat(32));
    assert_eq!(ask(&[&wrong]), Some(401));
}

#[test]
fn an_answer_to_head_promises_no_body() {
    let running = Running::new();
    let token = running.with_token();
    for (path, more) in [
        ("/", vec![]),
        ("/scene", vec![]),
        ("/scene", vec![token.as_str()]),
        ("/", vec!["origin: http://evil.example"]),
        ("/nowhere", vec![&token]),
    ] {
        let mut stream = running.connect();
        let head = running.head(&format!("HEAD {path}"), &more);
        stream.write_all(head.as_bytes()).expect("it listens");
        let head = head_of_answer(&mut stream).expect("an answer");
        let length = head
            .lines()
            .find_map(|l| l.strip_prefix("content-length: "));
        assert!(matches!(length, None | Some("0")), "{path}: {head}");
        assert!(head.starts_with("http/1.1 4"), "{head}");
        // What comes next is the next answer.
        assert_eq!(running.ask(&mut stream, "GET /", &[]), Some(200));
    }
}
