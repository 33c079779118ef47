//! Page and gateway, and who comes there: a browser on behalf of another site, crowds that say nothing, readers that do not read.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::{Shutdown, TcpStream},
    process::Command,
    time::Duration,
};

use anyhow::{Context, bail};
use rand_core::Rng;
use rustix::process::Signal;

use super::{
    act::Act,
    troupe::{PATIENCE, Player, SESSION, Stage, is_orderly, piped},
};

/// Longest that a request of somebody who does not read is tried to be sent.
const SHORT: Duration = Duration::from_millis(20);
/// What another site has a browser send, or a program without the token: gravity as it is.
const PAGE_ORDER: &str =
    r#"{"order": {"action": "gravity", "gravity": [0, -9.81, 0]}, "step": 0, "page": 1}"#;
const GATEWAY_ORDER: &str = r#""orders": [{"order": "SetGravity", "gravity": [0, -9.81, 0]}]"#;

/// What comes to a door.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attack {
    /// Orders that a browser sends on behalf of another site.
    OtherSite,
    /// Connections that say nothing.
    Silent,
    /// Connections that ask and read no answer.
    Deaf,
}

/// What listens at a door.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Page,
    Gateway,
}

/// A program that listens.
struct Door {
    kind: Kind,
    player: Player,
    address: String,
    token: String,
}

impl Act<'_> {
    /// Opens a page or a gateway, attacks it, and sees whether it still opens to who has the token, and to nobody else.
    pub fn knock(&mut self, attack: Attack, rng: &mut impl Rng) -> anyhow::Result<()> {
        let door = match rng.next_u32() % 2 {
            0 => Some(Door::page(&self.stage)?),
            _ => Door::gateway(&self.stage)?,
        };
        let Some(mut door) = door else {
            let why = "python3 does not find the package cosplat";
            self.skip("page and gateway: the gateway", why.into());
            return Ok(());
        };
        let crowd: Vec<TcpStream> = match attack {
            Attack::OtherSite => {
                for request in door.other_site() {
                    if door.is_taken(&request)? {
                        let first = request.lines().next().unwrap_or_default();
                        self.misbehaved(format!("{:?} took {first:?} ...", door.kind));
                    }
                }
                // What these vary is what keeps them out.
                if !door.is_taken(&door.own_site())? {
                    self.astray(format!("{:?} took no order", door.kind));
                }
                Vec::new()
            }
            Attack::Silent => {
                let count = 100 + rng.next_u32() % 100;
                let all = (0..count).map(|_| door.connect());
                all.collect::<anyhow::Result<_>>()?
            }
            Attack::Deaf => {
                let count = 20 + rng.next_u32() % 40;
                let all = (0..count).map(|_| door.connect_deaf());
                all.collect::<anyhow::Result<_>>()?
            }
        };
        if let Err(error) = door.opens() {
            let words = format!("{attack:?} shuts the {:?}: {error:#}", door.kind);
            self.astray(words);
        }
        drop(crowd);
        door.player.signal(Signal::INT);
        match door.player.wait() {
            Some(status) if is_orderly(status) => {}
            status => {
                let words = format!("{:?}: {status:?}: {}", door.kind, door.player.words());
                self.misbehaved(words);
            }
        }
        Ok(())
    }
}

impl Door {
    fn page(stage: &Stage) -> anyhow::Result<Door> {
        let words = ["view", "--session", SESSION, "--web", "--timeout", "60"];
        let mut player = stage.start("page", piped(stage.command(&words)?))?;
        let link = player.hear()?;
        let parts = link.trim().strip_prefix("http://");
        let (address, token) = parts
            .and_then(|rest| rest.split_once("/#"))
            .with_context(|| format!("a page says {link:?}, expected a link"))?;
        Ok(Door {
            kind: Kind::Page,
            player,
            address: address.into(),
            token: token.into(),
        })
    }

    /// None where there is no Python with the package.
    fn gateway(stage: &Stage) -> anyhow::Result<Option<Door>> {
        let python = |words: &[&str]| {
            let mut command = Command::new("python3");
            command.args(words).env_remove("COSPLAT_TOKEN");
            stage.prepare(&mut command);
            command
        };
        // Whoever has no Python at all has no gateway either.
        let find = "import importlib.util as u; exit(u.find_spec('cosplat') is None)";
        let found = stage.ask(python(&["-c", find]));
        if !found.is_ok_and(|(status, _)| status.success()) {
            return Ok(None);
        }
        let words = ["-m", "cosplat.gateway", SESSION, "--listen", "127.0.0.1:0"];
        let mut player = stage.start("gateway", piped(python(&words)))?;
        let said = player.hear()?;
        let words: Vec<&str> = said.split_whitespace().collect();
        let after = |word| words.iter().skip_while(move |w| **w != word).nth(1);
        match (after("at"), after("port"), after("token")) {
            (Some(host), Some(port), Some(token)) => Ok(Some(Door {
                kind: Kind::Gateway,
                player,
                address: format!("{host}:{port}"),
                token: (*token).to_owned(),
            })),
            _ => bail!("a gateway says {said:?}, expected address, port and token"),
        }
    }

    fn connect(&self) -> anyhow::Result<TcpStream> {
        let stream = TcpStream::connect(&self.address)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        Ok(stream)
    }

    /// A connection that asks for more than it could be sent without reading.
    fn connect_deaf(&self) -> anyhow::Result<TcpStream> {
        let mut stream = self.connect()?;
        let request = match self.kind {
            Kind::Page => format!("GET /main.js HTTP/1.1\r\nhost: {}\r\n\r\n", self.address),
            Kind::Gateway => "{\"ask\": \"scene\"}\n".into(),
        };
        stream.set_write_timeout(Some(SHORT))?;
        // It may be hung up on, or not be read any more: by right.
        let _ = stream.write_all(request.repeat(1000).as_bytes());
        Ok(stream)
    }

    /// A request that must be taken.
    fn own_site(&self) -> String {
        let Door { address, token, .. } = self;
        let shown = format!("x-cosplat-token: {token}");
        match self.kind {
            Kind::Page => post("/command", address, &[&shown], PAGE_ORDER),
            Kind::Gateway => format!("{{\"token\": \"{token}\", {GATEWAY_ORDER}}}\n"),
        }
    }

    /// Requests that must not be taken.
    fn other_site(&self) -> Vec<String> {
        let Door { address, token, .. } = self;
        let port = address.rsplit(':').next().unwrap_or_default();
        let foreign = "origin: http://evil.example";
        let cross = "sec-fetch-site: cross-site";
        match self.kind {
            Kind::Page => {
                let own = format!("origin: http://{address}");
                let shown = format!("x-cosplat-token: {token}");
                let other = format!("evil.example:{port}");
                let to = |host: &str, headers: &[&str]| post("/command", host, headers, PAGE_ORDER);
                vec![
                    to(address, &[foreign, cross]),
                    to(address, &[]),
                    to(address, &[&shown, foreign]),
                    to(address, &[&shown, &own, foreign]),
                    to(address, &[&shown, cross]),
                    to(&other, &[&shown]),
                ]
            }
            Kind::Gateway => {
                let wrong = "0".repeat(32);
                let shown = |token: &str| format!("{{\"token\": \"{token}\", {GATEWAY_ORDER}}}\n");
                let bare = format!("{{{GATEWAY_ORDER}}}\n");
                let plain = "content-type: text/plain;charset=UTF-8";
                let to = |body: &str| post("/", address, &[plain, foreign, cross], body);
                vec![
                    to(&bare),
                    to(&shown(&wrong)),
                    // Not even with the token, which no other site has.
                    to(&shown(token)),
                    bare.clone(),
                    shown(&wrong),
                ]
            }
        }
    }

    /// Whether a request was answered as a right one is.
    fn is_taken(&self, request: &str) -> anyhow::Result<bool> {
        let mut stream = self.connect()?;
        // Whoever is hung up on cannot send all of it, nor read all of the reason.
        let _ = stream.write_all(request.as_bytes());
        let mut answer = Vec::new();
        let _ = match self.kind {
            Kind::Page => BufReader::new(stream).read_until(b'\n', &mut answer),
            Kind::Gateway => stream
                .shutdown(Shutdown::Write)
                .and_then(|()| stream.read_to_end(&mut answer)),
        };
        let answer = String::from_utf8_lossy(&answer);
        Ok(match self.kind {
            Kind::Page => answer.starts_with("HTTP/1.1 2"),
            Kind::Gateway => answer.contains("\"acks\""),
        })
    }

    /// Asks as who has the token does.
    fn opens(&self) -> anyhow::Result<()> {
        let mut stream = self.connect()?;
        let Door { address, token, .. } = self;
        let (request, right) = match self.kind {
            Kind::Page => (
                format!(
                    "GET /scene HTTP/1.1\r\nhost: {address}\r\nx-cosplat-token: {token}\r\n\r\n"
                ),
                "HTTP/1.1 200",
            ),
            Kind::Gateway => (
                format!("{{\"token\": \"{token}\", \"ask\": \"hello\"}}\n"),
                "{\"session\"",
            ),
        };
        stream.write_all(request.as_bytes())?;
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line)?;
        match line.starts_with(right) {
            true => Ok(()),
            false => bail!("it answers {:?}", line.trim()),
        }
    }
}

fn post(path: &str, host: &str, headers: &[&str], body: &str) -> String {
    let length = body.len();
    let head = format!("POST {path} HTTP/1.1\r\nhost: {host}\r\ncontent-length: {length}");
    let lines: String = headers.iter().map(|line| format!("\r\n{line}")).collect();
    format!("{head}{lines}\r\n\r\n{body}")
}
