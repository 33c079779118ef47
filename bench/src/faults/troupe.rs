//! The processes of an act.

use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Command, ExitStatus, Stdio},
    time::{Duration, Instant},
};

use anyhow::{Context, bail};
use cosplat_ipc::{Client, Domain};
use rustix::process::{Pid, Signal, kill_process};

use crate::child::Owned;

/// Longest that anything is waited for before it counts as lost.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// The session of an act.
pub const SESSION: &str = "faults";

/// A process of this very program, in a domain and a folder.
pub struct Player {
    child: Owned,
    /// What it says on standard error goes there.
    words: PathBuf,
}

/// Where players are started.
pub struct Stage {
    pub domain: Domain,
    pub folder: tempfile::TempDir,
}

impl Stage {
    /// A fresh domain and folder.
    pub fn new(name: &str) -> anyhow::Result<Self> {
        Ok(Self {
            domain: Domain::named(name)?,
            folder: tempfile::tempdir()?,
        })
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// This program with other words.
    pub fn command(&self, arguments: &[&str]) -> anyhow::Result<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(arguments);
        self.prepare(&mut command);
        Ok(command)
    }

    /// Puts a program into the domain and the folder.
    pub fn prepare(&self, command: &mut Command) {
        command
            .env("COSPLAT_DOMAIN", self.domain.root())
            .current_dir(self.folder.path())
            .stdin(Stdio::null());
    }

    /// Starts a player.
    pub fn start(&self, name: &str, mut command: Command) -> anyhow::Result<Player> {
        let words = self.path(&format!("{name}.err"));
        let file = std::fs::File::create(&words)?;
        let child = command
            .stderr(file)
            .spawn()
            .with_context(|| format!("{name} cannot be started"))?;
        Ok(Player {
            child: Owned(child),
            words,
        })
    }

    /// Runs a program that ends by itself; its status and what it said on standard error.
    pub fn ask(&self, command: Command) -> anyhow::Result<(ExitStatus, String)> {
        let mut player = self.start("asked", {
            let mut command = command;
            command.stdout(Stdio::null());
            command
        })?;
        let status = player.wait().context("a program does not end")?;
        Ok((status, player.words()))
    }

    /// A new client.
    pub fn client(&self, role: &str) -> anyhow::Result<Client> {
        Ok(Client::connect(&self.domain, SESSION, role, PATIENCE)?)
    }

    /// Files that the domain left in shared memory, but for the one that iceoryx2 keeps for whoever comes next.
    pub fn left(&self) -> Vec<String> {
        let prefix = self.domain.prefix();
        let files = std::fs::read_dir("/dev/shm").into_iter().flatten();
        let names = files.flatten();
        let names = names.map(|file| file.file_name().to_string_lossy().into_owned());
        let is_kept = |name: &String| name.ends_with("_mgmt") || name.contains("management");
        names
            .filter(|name| name.starts_with(prefix) && !is_kept(name))
            .collect()
    }
}

impl Player {
    pub fn id(&self) -> u32 {
        self.child.0.id()
    }

    pub fn is_running(&mut self) -> bool {
        matches!(self.child.0.try_wait(), Ok(None))
    }

    /// What it said.
    pub fn words(&self) -> String {
        std::fs::read_to_string(&self.words).unwrap_or_default()
    }

    pub fn signal(&self, signal: Signal) {
        if let Some(pid) = i32::try_from(self.id()).ok().and_then(Pid::from_raw) {
            // It may have ended by itself.
            let _ = kill_process(pid, signal);
        }
    }

    /// SIGKILL, then reaped.
    pub fn kill(&mut self) {
        let _ = self.child.0.kill();
        let _ = self.child.0.wait();
    }

    /// Waits for its end; nothing where it does not come.
    pub fn wait(&mut self) -> Option<ExitStatus> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            match self.child.0.try_wait() {
                Ok(Some(status)) => return Some(status),
                _ if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(5)),
                _ => return None,
            }
        }
    }

    /// Waits for a line on its standard output, which must be piped.
    pub fn hear(&mut self) -> anyhow::Result<String> {
        let pipe = self.child.0.stdout.take().context("output is captured")?;
        let (sender, receiver) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let mut line = String::new();
            let read = BufReader::new(pipe).read_line(&mut line);
            let _ = sender.send(read.is_ok_and(|n| n > 0).then_some(line));
        });
        match receiver.recv_timeout(PATIENCE) {
            Ok(Some(line)) => Ok(line),
            _ => bail!("a player says nothing: {}", self.words()),
        }
    }
}

/// Whether an end was one that a program chose: neither a signal nor a panic.
pub fn is_orderly(status: ExitStatus) -> bool {
    matches!(status.code(), Some(code) if code != 101 && code < 126)
}

/// The part of a client that takes a frame and never lets go.
pub fn hold() -> anyhow::Result<()> {
    let domain = Domain::from_env()?;
    let client = Client::connect(&domain, SESSION, "holder", PATIENCE)?;
    let mut frames = client.frames(4)?;
    let _held = frames.next(Duration::from_millis(200))?;
    let _sender = client.commands()?;
    println!("holding");
    std::thread::sleep(PATIENCE * 2);
    Ok(())
}

/// Writes a text into the folder.
pub fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// A child whose output is captured.
pub fn piped(mut command: Command) -> Command {
    command.stdout(Stdio::piped());
    command
}

/// A child whose output nobody reads.
pub fn silent(mut command: Command) -> Command {
    command.stdout(Stdio::null());
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_and_a_panic_are_no_orderly_end() {
        let status = |script: &str| {
            let mut shell = Command::new("sh");
            let child = shell.args(["-c", script]).spawn();
            child.and_then(|mut child| child.wait()).expect("a shell")
        };
        assert!(is_orderly(status("exit 0")) && is_orderly(status("exit 2")));
        assert!(!is_orderly(status("exit 101")) && !is_orderly(status("kill -9 $$")));
    }
}
