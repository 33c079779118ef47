//! The page in the browser: what is served, to whom, and how much of it.

use std::io::{Read, Write};
use std::net::TcpStream;

use cosplat_ipc::schema::{SERVER_PAUSED, SERVER_RUNNING, Status};
use serde_json::{Value, json};

use crate::stage::{PATIENCE, Process, SMALL_SCENE, Stage, wait_for_status, watchdog};

/// A session, and its page.
pub struct Page {
    pub stage: Stage,
    _server: Option<Process>,
    _page: Option<Process>,
    pub host: String,
    pub token: String,
}

/// An answer: status, head, body.
pub struct Answer(pub u16, pub String, pub Vec<u8>);

impl Page {
    pub fn open(arguments: &[&str]) -> Page {
        let stage = Stage::new();
        // What a hand aims at comes to rest: on grids of their own both would bounce on.
        let scene = SMALL_SCENE.replace("[[objects]]", "[[objects]]\nsolver = \"spatial\"");
        let server = stage.serve_scene(&scene, &["--pace", "realtime"]);
        Page::of(stage, server, arguments)
    }

    fn of(stage: Stage, server: Process, arguments: &[&str]) -> Page {
        Page::beside(stage, Some(server), arguments)
    }

    /// The page of a server, or of what the arguments say.
    pub fn beside(stage: Stage, server: Option<Process>, arguments: &[&str]) -> Page {
        let mut all = vec!["view", "--web"];
        all.extend(arguments);
        let mut page = Process::start(stage.cosplat(&all));
        let link = page.wait_for_output("\n");
        Page {
            _server: server,
            _page: Some(page),
            ..Page::at(stage, link.trim())
        }
    }

    /// The page behind a link that somebody else serves.
    pub fn at(stage: Stage, link: &str) -> Page {
        let (host, token) = link.split_once("/#").expect("a link with a token");
        Page {
            stage,
            _server: None,
            _page: None,
            host: host.strip_prefix("http://").expect("plain HTTP").to_owned(),
            token: token.to_owned(),
        }
    }

    /// The answer to this path without a token.
    pub fn status_of(&self, path: &str) -> u16 {
        self.ask(&format!("GET {path}"), &[], "").0
    }

    /// Step of the next answer with something new behind a step.
    pub fn step_of_news(&self, behind: u64) -> u64 {
        let number = self.scene()["scene"].as_u64().expect("a number") as u32;
        let mut version = 0;
        loop {
            let line = format!("GET /frame?scene={number}&version={version}");
            let Answer(status, _, body) = self.ask(&line, &self.with_token(), "");
            assert_eq!(status, 200);
            let word = |at: usize| u32::from_le_bytes(body[at..at + 4].try_into().expect("a word"));
            let step = f64::from_le_bytes(body[8..16].try_into().expect("a step")) as u64;
            version = word(4);
            if word(32) > 0 && step > behind {
                return step;
            }
        }
    }

    pub fn link(&self) -> String {
        format!("http://{}/#{}", self.host, self.token)
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).expect("the page listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
        stream
    }

    /// Sends these lines as they are, and reads the answer.
    pub fn raw(&self, lines: &[String], body: &str) -> Answer {
        let mut stream = self.connect();
        let head = lines.join("\r\n");
        // The server may have answered and closed before all of it was sent.
        let _ = write!(stream, "{head}\r\n\r\n{body}");
        read_answer(&mut stream)
    }

    pub fn ask(&self, line: &str, more: &[String], body: &str) -> Answer {
        let mut lines = vec![
            format!("{line} HTTP/1.1"),
            format!("host: {}", self.host),
            format!("content-length: {}", body.len()),
        ];
        lines.extend_from_slice(more);
        self.raw(&lines, body)
    }

    pub fn with_token(&self) -> Vec<String> {
        vec![format!("x-cosplat-token: {}", self.token)]
    }

    pub fn order(&self, order: &Value) -> Value {
        self.ordered(&json!({ "order": order }))
    }

    /// An order of the page with a number.
    pub fn order_of(&self, page: u64, order: &Value) -> Value {
        self.ordered(&json!({ "order": order, "page": page }))
    }

    /// The status of the answer to this body of an order.
    pub fn post(&self, body: &str) -> u16 {
        self.ask("POST /command", &self.with_token(), body).0
    }

    /// Figures of all objects.
    pub fn figures(&self) -> Value {
        let number = self.scene()["scene"].as_u64().expect("a number") as u32;
        loop {
            let figures = self.frame(number, 0).figures;
            let objects = figures["objects"].as_array().map_or(0, Vec::len);
            if objects > 0 {
                return figures;
            }
        }
    }

    /// Bytes of so many answers in a row with nothing new, and the steps that were made meanwhile.
    pub fn bytes_of_quiet_answers(&self, count: usize) -> (usize, u64) {
        let number = self.scene()["scene"].as_u64().expect("a number") as u32;
        let (mut version, mut quiet, mut begun) = (0, Vec::new(), 0);
        while quiet.len() < count {
            let frame = self.frame(number, version);
            version = frame.version;
            if !frame.records.is_empty() {
                quiet.clear();
                begun = self.status().step;
                continue;
            }
            quiet.push(frame.bytes);
        }
        (quiet.iter().sum(), self.status().step - begun)
    }

    fn ordered(&self, body: &Value) -> Value {
        let body = body.to_string();
        let Answer(status, _, body) = self.ask("POST /command", &self.with_token(), &body);
        let text = String::from_utf8_lossy(&body).into_owned();
        assert_eq!(status, 200, "{text}");
        serde_json::from_str(&text).expect("answers are JSON")
    }

    fn scene(&self) -> Value {
        loop {
            let Answer(status, _, body) = self.ask("GET /scene", &self.with_token(), "");
            assert_eq!(status, 200);
            let scene: Value = serde_json::from_slice(&body).expect("the scene is JSON");
            if scene.get("objects").is_some() {
                return scene;
            }
        }
    }

    fn frame(&self, scene: u32, version: u32) -> Frame {
        let line = format!("GET /frame?scene={scene}&version={version}&figures=0");
        let Answer(status, head, body) = self.ask(&line, &self.with_token(), "");
        assert_eq!(status, 200);
        Frame::of(&body, head.len() + body.len())
    }

    fn status(&self) -> Status {
        wait_for_status(&self.stage.client(), |_| true)
    }
}

/// Reads an answer with a length.
pub fn read_answer(stream: &mut TcpStream) -> Answer {
    let (mut bytes, mut block) = (Vec::new(), [0; 65_536]);
    loop {
        let head = bytes.windows(4).position(|w| w == b"\r\n\r\n");
        if let Some(end) = head {
            let head = String::from_utf8_lossy(&bytes[..end + 4]).to_lowercase();
            let length = head.lines().find_map(|l| l.strip_prefix("content-length:"));
            let length: usize = length.map_or(0, |l| l.trim().parse().expect("a length"));
            if bytes.len() >= end + 4 + length {
                let status = head[9..12].parse().expect("a status");
                return Answer(status, head, bytes[end + 4..][..length].to_vec());
            }
        }
        let count = stream.read(&mut block).expect("an answer comes");
        assert!(
            count > 0,
            "the connection ended after {} bytes",
            bytes.len()
        );
        bytes.extend_from_slice(&block[..count]);
    }
}

/// An answer to a page's question for what is newer.
struct Frame {
    scene: u32,
    version: u32,
    dropped: u32,
    /// Kind, object and Gaussians of each record.
    records: Vec<[u32; 3]>,
    figures: Value,
    bytes: usize,
}

impl Frame {
    fn of(body: &[u8], bytes: usize) -> Frame {
        let word = |at: usize| u32::from_le_bytes(body[at..at + 4].try_into().expect("a word"));
        let text = word(36) as usize;
        let mut records = Vec::new();
        let mut at = 40 + text;
        while at < body.len() {
            let [kind, object, count] = [word(at), word(at + 4), word(at + 12)];
            at += 16
                + match kind {
                    1 => 28,
                    2 => 24 + 16 * count as usize,
                    3 => 4 * count as usize,
                    other => panic!("record of kind {other}"),
                };
            records.push([kind, object, count]);
        }
        assert_eq!((at, word(32) as usize), (body.len(), records.len()));
        Frame {
            scene: word(0),
            version: word(4),
            dropped: word(28),
            records,
            figures: serde_json::from_slice(&body[40..40 + text]).expect("figures are JSON"),
            bytes,
        }
    }
}

#[test]
fn who_is_not_the_page_is_refused_and_changes_nothing() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let (host, token) = (&page.host, &page.token);
    let port = host.split_once(':').expect("a port").1;
    let pause = json!({ "order": { "action": "pause" } }).to_string();
    let request = |line: &str, more: &[&str]| {
        let mut lines = vec![format!("{line} HTTP/1.1")];
        lines.extend(more.iter().map(|l| (*l).to_owned()));
        lines.push(format!("content-length: {}", pause.len()));
        let Answer(status, head, _) = page.raw(&lines, &pause);
        assert!(!head.contains("access-control"), "{head}");
        status
    };
    let ours = format!("host: {host}");
    let shown = format!("x-cosplat-token: {token}");
    let cases: &[(&str, &str, &[&str], u16)] = &[
        ("no host", "POST /command", &[&shown], 403),
        (
            "another host",
            "POST /command",
            &[&format!("host: evil.example:{port}"), &shown],
            403,
        ),
        (
            "another port",
            "POST /command",
            &["host: 127.0.0.1:1", &shown],
            403,
        ),
        (
            "two hosts",
            "POST /command",
            &[&ours, "host: evil.example", &shown],
            403,
        ),
        (
            "the page by another name",
            "GET /",
            &[&format!("host: evil.example:{port}")],
            403,
        ),
        (
            "a foreign origin",
            "POST /command",
            &[&ours, "origin: http://evil.example", &shown],
            403,
        ),
        (
            "an origin of nothing",
            "POST /command",
            &[&ours, "origin: null", &shown],
            403,
        ),
        (
            "another site",
            "POST /command",
            &[&ours, "sec-fetch-site: cross-site", &shown],
            403,
        ),
        (
            "another port of this machine",
            "POST /command",
            &[&ours, "sec-fetch-site: same-site", &shown],
            403,
        ),
        ("no token", "POST /command", &[&ours], 401),
        ("no token to look", "GET /frame", &[&ours], 401),
        (
            "a wrong token",
            "POST /command",
            &[&ours, &format!("x-cosplat-token: {}", "0".repeat(32))],
            401,
        ),
        (
            "half of the token",
            "POST /command",
            &[&ours, &format!("x-cosplat-token: {}", &token[..16])],
            401,
        ),
        (
            "a preflight",
            "OPTIONS /command",
            &[
                &ours,
                "origin: http://evil.example",
                "access-control-request-method: POST",
                "access-control-request-headers: x-cosplat-token",
            ],
            403,
        ),
        (
            "a preflight of ours",
            "OPTIONS /command",
            &[&ours, "access-control-request-method: POST"],
            403,
        ),
        ("another method", "PUT /command", &[&ours, &shown], 405),
        ("an order by GET", "GET /command", &[&ours, &shown], 405),
        ("another path", "POST /commands", &[&ours, &shown], 404),
        (
            "an oversized head",
            "POST /command",
            &[&ours, &shown, &format!("x-more: {}", "a".repeat(9000))],
            431,
        ),
    ];
    let before = page.status();
    for (what, line, more, expected) in cases {
        assert_eq!(request(line, more), *expected, "{what}");
    }
    let bodies = [
        (" ".repeat(5000), 413),
        ("{}".into(), 400),
        ("{\"order\":{\"action\":\"explode\"}}".into(), 400),
    ];
    for (body, expected) in bodies {
        let answer = page.ask("POST /command", &page.with_token(), &body);
        assert_eq!(answer.0, expected, "{body:.40}");
    }
    let after = wait_for_status(&page.stage.client(), |s| s.step > before.step);
    assert_eq!(after.server_state, SERVER_RUNNING);
    assert_eq!(after.commands_accepted, before.commands_accepted);
    // What the cases vary is what keeps them out.
    assert_eq!(request("POST /command", &[&ours, &shown]), 200);
    let client = page.stage.client();
    wait_for_status(&client, |s| s.server_state == SERVER_PAUSED);
}

/// How many files a page has; all say its policy, and together they are small.
pub fn small_files(page: &Page) -> usize {
    let mut paths = vec!["/".to_owned()];
    let (mut bytes, mut n) = (0, 0);
    while n < paths.len() {
        let Answer(status, head, body) = page.ask(&format!("GET {}", paths[n]), &[], "");
        assert_eq!(status, 200, "{}", paths[n]);
        for expected in [
            "content-security-policy: default-src 'none'; script-src 'self'",
            "frame-ancestors 'none'",
            "x-content-type-options: nosniff",
            "referrer-policy: no-referrer",
            "cross-origin-resource-policy: same-origin",
            "cache-control: no-store",
        ] {
            assert!(head.contains(expected), "{expected}: {head}");
        }
        bytes += body.len();
        let text = String::from_utf8(body).expect("the page is text");
        assert!(!text.contains("http://") && !text.contains("https://"));
        let quoted = text.split(['"', '\'']).skip(1).step_by(2);
        for path in quoted.filter(|q| q.ends_with(".js") || q.ends_with(".css")) {
            let path = format!("/{}", path.trim_start_matches("./").trim_start_matches('/'));
            if !paths.contains(&path) {
                paths.push(path);
            }
        }
        n += 1;
    }
    assert!(bytes < 100_000, "{bytes}");
    paths.len()
}

#[test]
fn the_page_is_small_fetches_nothing_and_says_its_policy() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    assert!(small_files(&page) >= 9);
}

#[test]
fn a_page_gets_all_once_and_then_only_what_is_newer() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let scene = page.scene();
    let number = scene["scene"].as_u64().expect("a number") as u32;
    let names: Vec<_> = scene["objects"]
        .as_array()
        .expect("objects")
        .iter()
        .collect();
    assert_eq!((names.len(), &names[0]["name"]), (2, &json!("left")));
    let mut frame = page.frame(number, 0);
    while frame.records.len() < 4 {
        frame = page.frame(number, 0);
    }
    let of_kind = |frame: &Frame, kind| frame.records.iter().filter(|r| r[0] == kind).count();
    assert_eq!((of_kind(&frame, 2), of_kind(&frame, 3)), (2, 2));
    // Falling, both move; their colours do not.
    page.order(&json!({ "action": "reset" }));
    let mut newer = page.frame(frame.scene, frame.version);
    while newer.records.is_empty() {
        newer = page.frame(frame.scene, newer.version);
    }
    assert!(newer.version > frame.version);
    assert_eq!(of_kind(&newer, 3), 0);
    // Whoever asks late gets the newest and is told how many it missed.
    let client = page.stage.client();
    let step = page.status().step;
    for more in 1..=5 {
        wait_for_status(&client, |s| s.step >= step + more);
        page.order(&json!({ "action": "push", "object": "left", "impulse": [0.1, 0, 0] }));
    }
    let mut late = page.frame(newer.scene, newer.version);
    while late.version < newer.version + 2 {
        late = page.frame(newer.scene, newer.version);
    }
    assert_eq!(late.dropped, late.version - newer.version - 1);
    assert!(late.records.len() <= 4, "{:?}", late.records);
    assert!(late.figures["dropped"].as_u64() >= Some(0));
    // Of another scene it learns the number first.
    let other = page.frame(number + 1, late.version);
    assert_eq!((other.scene, other.records.len()), (number, 0));
}

#[test]
fn a_paused_scene_sends_less_than_5_kilobytes_a_second() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let scene = page.scene();
    let number = scene["scene"].as_u64().expect("a number") as u32;
    page.order(&json!({ "action": "pause" }));
    let mut version = 0;
    let mut quiet = page.frame(number, version);
    while version == 0 || !quiet.records.is_empty() {
        version = quiet.version;
        quiet = page.frame(number, version);
    }
    // Answers with nothing new come after 250 ms, four a second.
    assert!(4 * quiet.bytes < 5000, "{} bytes", quiet.bytes);
}

#[test]
fn orders_of_the_page_are_answered_like_those_of_ctl() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let push = json!({ "action": "push", "object": "left", "impulse": [0.1, 0, 0] });
    let answer = page.order(&push);
    assert!(answer["step"].as_u64() > Some(0) && answer["refused"].is_null());
    let softer = json!({ "action": "set-material", "object": "right",
        "material": { "preset": "rubber", "youngs_modulus_pa": 1e6 } });
    assert!(page.order(&softer)["refused"].is_null());
    let unknown = json!({ "action": "push", "object": "middle", "impulse": [1, 0, 0] });
    let refused = page.order(&unknown)["refused"].to_string();
    assert!(refused.contains("left, right"), "{refused}");
    let wrong = json!({ "action": "set-material", "object": 0, "material": "unobtainium" });
    assert!(
        page.order(&wrong)["refused"]
            .to_string()
            .contains("unobtainium")
    );
    page.order(&json!({ "action": "pause" }));
    let at = page.order(&json!({ "action": "step", "count": 3 }));
    assert_eq!(at["step"], json!(page.status().step));
}

#[test]
fn a_page_that_only_shows_takes_no_orders() {
    let _watchdog = watchdog();
    let page = Page::open(&["--read-only"]);
    assert_eq!(page.scene()["read_only"], json!(true));
    let body = json!({ "order": { "action": "pause" } }).to_string();
    let Answer(status, _, body) = page.ask("POST /command", &page.with_token(), &body);
    assert_eq!(status, 403);
    assert!(String::from_utf8_lossy(&body).contains("--read-only"));
    assert_eq!(page.status().server_state, SERVER_RUNNING);
}

/// A short run of the demo scene, recorded.
pub fn record(stage: &Stage) -> String {
    let path = stage.path("run.mcap");
    let path = path.to_str().expect("a plain path").to_owned();
    let mut server = stage.serve(&["--paused", "--duration", "0.6"]);
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", &path]));
    let client = stage.client();
    crate::stage::wait_for_readers(&client, 1, &mut [&mut recorder]);
    assert!(stage.ctl(&["resume"]).status.success());
    assert!(server.wait().success() && recorder.wait().success());
    path
}

#[test]
fn a_replay_is_shown_and_goes_where_the_page_says() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let path = &record(&stage);
    let mut replay = Process::start(stage.cosplat(&["replay", path, "--paused"]));
    stage.wait_for_server(&mut replay);
    let page = Page::of(stage, replay, &[]);
    let number = page.scene()["scene"].as_u64().expect("a number") as u32;
    let mut frame = page.frame(number, 0);
    while frame.records.len() < 4 {
        frame = page.frame(number, 0);
    }
    let body = json!({ "order": { "action": "seek" }, "step": 20 }).to_string();
    let answer = page.ask("POST /command", &page.with_token(), &body);
    let answer: Value = serde_json::from_slice(&answer.2).expect("JSON");
    assert_eq!(answer["step"], json!(20));
    while page.frame(number, frame.version).records.is_empty() {}
    let refused = page.order(&json!({ "action": "reset" }));
    assert!(
        refused["refused"]
            .to_string()
            .contains("replays a recording")
    );
}
