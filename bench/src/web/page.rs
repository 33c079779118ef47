//! A page without a picture: asks for frames as the page in a browser does, and clicks. A process of its own, so that it can be
//! stopped.

use std::{
    io::{ErrorKind, Read, Write},
    net::TcpStream,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use cosplat_console::say;
use cosplat_ipc::monotonic_ns;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// How often a page asks for figures, as that in a browser does.
const FIGURES: Duration = Duration::from_millis(250);
/// Longest that an answer may take.
const PATIENCE: Duration = Duration::from_secs(60);
/// Between clicks, at least; up to as much again comes to it, so that they fall anywhere in a step.
const CLICK: Duration = Duration::from_millis(90);
/// Of a clicked object [N s]: seen by none, but an order like any other.
const IMPULSE: f64 = 1e-6;

/// What a page was sent.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Got {
    /// `CLOCK_MONOTONIC` when all of it was there [ns].
    pub at: u64,
    /// Step that the answer is of.
    pub step: u64,
    /// Changes between it and the answer before, that the page did not get, as the server counts.
    pub dropped: u64,
    /// Whether anything moved.
    pub has_news: bool,
    /// Head and body of the answer.
    pub bytes: u64,
}

/// What became of a click.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Click {
    /// Step that the page showed.
    pub shown: u64,
    /// Step at whose start the order takes effect, as its answer says.
    pub step: u64,
}

/// All that a page saw.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Seen {
    pub answers: Vec<Got>,
    pub clicks: Vec<Click>,
}

/// Asks for frames until standard input ends, clicks so often meanwhile, and prints what it saw as one JSON object.
///
/// # Errors
/// When the server of the page refuses or is gone.
pub fn run(link: &str, number: u64, clicks: usize) -> anyhow::Result<()> {
    let (address, token) = link
        .trim()
        .strip_prefix("http://")
        .and_then(|rest| rest.split_once("/#"))
        .with_context(|| format!("{link:?} is no link of a page"))?;
    let stop = Arc::new(AtomicBool::new(false));
    let shown = Arc::new(AtomicU64::new(0));
    let told = stop.clone();
    std::thread::spawn(move || {
        // Its end is all that is told.
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        told.store(true, Ordering::Relaxed);
    });
    let orders = Connection::open(address, token)?;
    let clicker = {
        let (stop, shown) = (stop.clone(), shown.clone());
        std::thread::spawn(move || click(orders, number, clicks, &shown, &stop))
    };
    let answers = pull(Connection::open(address, token)?, &shown, &stop)?;
    let clicks = clicker.join().ok().context("the clicks ended early")??;
    say!("{}", serde_json::to_string(&Seen { answers, clicks })?)
}

/// Asks for what is newer, one answer after the other.
fn pull(
    mut connection: Connection,
    shown: &AtomicU64,
    stop: &AtomicBool,
) -> anyhow::Result<Vec<Got>> {
    let mut scene = 0;
    while scene == 0 {
        let about: Value = serde_json::from_slice(&connection.ask("GET", "/scene", "")?.1)?;
        scene = about["scene"].as_u64().unwrap_or(0);
    }
    let (mut answers, mut version) = (Vec::new(), 0);
    let mut figures = None::<Instant>;
    while !stop.load(Ordering::Relaxed) {
        let mut path = format!("/frame?scene={scene}&version={version}");
        if figures.is_none_or(|at| at.elapsed() >= FIGURES) {
            path += "&figures=0";
            figures = Some(Instant::now());
        }
        let (bytes, body) = connection.ask("GET", &path, "")?;
        let head = Head::of(&body)?;
        ensure!(
            head.scene == scene as u32,
            "the scene changed while it was measured"
        );
        version = head.version;
        shown.store(head.step, Ordering::Relaxed);
        answers.push(Got {
            at: monotonic_ns(),
            step: head.step,
            dropped: head.dropped.into(),
            has_news: head.records > 0,
            bytes,
        });
    }
    Ok(answers)
}

/// Pushes the first object, one way and the other, at moments that have nothing to do with steps.
fn click(
    mut connection: Connection,
    number: u64,
    clicks: usize,
    shown: &AtomicU64,
    stop: &AtomicBool,
) -> anyhow::Result<Vec<Click>> {
    let mut made = Vec::new();
    while made.len() < clicks && !stop.load(Ordering::Relaxed) {
        // The golden ratio, less 1: multiples of it fall evenly between whole numbers.
        let part = (made.len() as f64 * 0.618_033_988_75).fract();
        std::thread::sleep(CLICK.mul_f64(1.0 + part));
        let seen = shown.load(Ordering::Relaxed);
        if seen == 0 {
            continue;
        }
        let way = if made.len() % 2 == 0 { 1.0 } else { -1.0 };
        let order = json!({ "action": "push", "object": 0, "impulse": [way * IMPULSE, 0.0, 0.0] });
        let body = json!({ "order": order, "page": number }).to_string();
        let answer: Value = serde_json::from_slice(&connection.ask("POST", "/command", &body)?.1)?;
        let step = answer["step"].as_u64();
        made.push(Click {
            shown: seen,
            step: step.with_context(|| format!("a click is refused: {answer}"))?,
        });
    }
    Ok(made)
}

/// What an answer to a question for frames begins with.
struct Head {
    scene: u32,
    version: u32,
    step: u64,
    dropped: u32,
    records: u32,
}

impl Head {
    fn of(body: &[u8]) -> anyhow::Result<Head> {
        let bytes = |at: usize, count: usize| body.get(at..at + count).context("a short answer");
        let word =
            |at| -> anyhow::Result<u32> { Ok(u32::from_le_bytes(bytes(at, 4)?.try_into()?)) };
        Ok(Head {
            scene: word(0)?,
            version: word(4)?,
            step: f64::from_le_bytes(bytes(8, 8)?.try_into()?) as u64,
            dropped: word(28)?,
            records: word(32)?,
        })
    }
}

/// A connection that stays open, as a browser's does.
struct Connection {
    stream: TcpStream,
    address: String,
    token: String,
}

impl Connection {
    fn open(address: &str, token: &str) -> anyhow::Result<Connection> {
        let stream = TcpStream::connect(address)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_nodelay(true)?;
        Ok(Connection {
            stream,
            address: address.into(),
            token: token.into(),
        })
    }

    /// Bytes of the answer, and its body. Where the server ended the connection meanwhile, as it does after 10 s without a
    /// request, another one is opened, as a browser does.
    fn ask(&mut self, method: &str, path: &str, body: &str) -> anyhow::Result<(u64, Vec<u8>)> {
        if let Some(answer) = self.exchange(method, path, body)? {
            return Ok(answer);
        }
        *self = Connection::open(&self.address, &self.token)?;
        let answer = self.exchange(method, path, body)?;
        answer.context("the server of the page ends connections")
    }

    /// The same on this connection; `None` where it has ended.
    fn exchange(
        &mut self,
        method: &str,
        path: &str,
        body: &str,
    ) -> anyhow::Result<Option<(u64, Vec<u8>)>> {
        let (address, token, length) = (&self.address, &self.token, body.len());
        let head = format!(
            "{method} {path} HTTP/1.1\r\nhost: {address}\r\nx-cosplat-token: {token}\r\n\
             content-length: {length}\r\n\r\n{body}"
        );
        // Where it has ended, reading says so.
        let _ = self.stream.write_all(head.as_bytes());
        let mut bytes = Vec::with_capacity(1 << 12);
        let end = loop {
            if let Some(at) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
                break at + 4;
            }
            let mut block = [0; 1 << 12];
            let count = match self.stream.read(&mut block) {
                // Who was stopped and goes on is told so.
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) if error.kind() == ErrorKind::ConnectionReset => 0,
                read => read?,
            };
            if count == 0 && bytes.is_empty() {
                return Ok(None);
            }
            ensure!(count > 0, "the server of the page ended amid an answer");
            bytes.extend_from_slice(&block[..count]);
        };
        let head = String::from_utf8_lossy(&bytes[..end]).to_lowercase();
        let length = head
            .lines()
            .find_map(|line| line.strip_prefix("content-length:"))
            .context("an answer without a length")?;
        let length: usize = length.trim().parse()?;
        let have = bytes.len();
        bytes.resize(end + length, 0);
        ensure!(have <= bytes.len(), "an answer is longer than it says");
        self.stream.read_exact(&mut bytes[have..])?;
        let body = bytes.split_off(end);
        ensure!(
            head.starts_with("http/1.1 200"),
            "{path} is answered: {}",
            String::from_utf8_lossy(&body)
        );
        Ok(Some(((end + length) as u64, body)))
    }
}
