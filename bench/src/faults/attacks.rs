//! What a hostile or careless neighbour does to a session: takes all the room, lays links, hangs up, asks for absurd numbers.

use std::os::unix::fs::symlink;

use anyhow::Context;
use cosplat_ipc::{client::CommandSender, schema as wire};
use rand_core::Rng;
use rustix::process::Signal;

use super::{
    act::Act,
    damage,
    troupe::{PATIENCE, SESSION, silent, write},
};

/// How far ahead a queue is filled [steps].
const AHEAD: u64 = 9_000_000;
/// Requests that fill the share of a client, and one more.
const REQUESTS: usize = 4096 / wire::MAX_COMMANDS + 1;
/// Steps whose checkpoints have links in their way.
const LINKED: u64 = 400;
/// What a file holds that no link may lead to.
const VICTIM: &str = "as it was";
/// Numbers of threads that nobody has.
const ABSURD: [&str; 4] = ["5000", "1000000000", "18446744073709551615", "-1"];

/// Gravity as it is.
fn gravity(apply_at_step: u64) -> wire::Command {
    wire::Command {
        kind: wire::COMMAND_SET_GRAVITY,
        vector: [0.0, -9.81, 0.0],
        apply_at_step,
        ..Default::default()
    }
}

/// Why a command was refused.
fn refusal(sender: &mut CommandSender, command: wire::Command) -> anyhow::Result<Option<String>> {
    let acks = sender.send(&[command], PATIENCE)?;
    let ack = acks.first().context("an answer")?;
    Ok((!ack.is_accepted()).then(|| ack.reason().unwrap_or_default().to_owned()))
}

impl Act<'_> {
    /// A client orders as much as it can for a step that nobody lives to see; others are heard nevertheless, and take all of it
    /// back.
    pub fn fill_queue(&mut self) -> anyhow::Result<()> {
        let mut greedy = self.client.commands()?;
        for _ in 0..REQUESTS {
            let acks = greedy.send(&[gravity(AHEAD); wire::MAX_COMMANDS], PATIENCE)?;
            if acks.iter().any(|ack| !ack.is_accepted()) {
                break;
            }
        }
        let mut other = self.client.commands()?;
        for (what, command) in [
            ("the next step", gravity(0)),
            ("a later step", gravity(AHEAD - 1)),
        ] {
            if let Some(reason) = refusal(&mut other, command)? {
                self.misbehaved(format!(
                    "one client's orders keep out those for {what}: {reason}"
                ));
            }
        }
        let cancel = wire::Command {
            kind: wire::COMMAND_CANCEL,
            object: 1,
            ..Default::default()
        };
        if let Some(reason) = refusal(&mut other, cancel)? {
            self.misbehaved(format!("orders cannot be cancelled: {reason}"));
        }
        if let Some(reason) = refusal(&mut greedy, gravity(AHEAD))? {
            self.misbehaved(format!("what was cancelled still takes room: {reason}"));
        }
        refusal(&mut other, cancel)?;
        Ok(())
    }

    /// Links lie where checkpoints are written, under every name that can be foretold.
    pub fn lay_links(&mut self) -> anyhow::Result<()> {
        let victim = self.stage.path("victim");
        write(&victim, VICTIM)?;
        let step = self.newest_step()?;
        let names = (step..step + LINKED).flat_map(|step| {
            ["unfinished", "checkpoint"].map(|end| format!("{SESSION}-step-{step}.{end}"))
        });
        let links: Vec<_> = names.map(|name| self.stage.path(&name)).collect();
        for link in &links {
            // A checkpoint of an earlier fault may be there.
            let _ = symlink(&victim, link);
        }
        let checkpoint = wire::Command {
            kind: wire::COMMAND_CHECKPOINT,
            ..Default::default()
        };
        let refused = refusal(&mut self.client.commands()?, checkpoint)?;
        if let Some(reason) = refused {
            self.misbehaved(format!(
                "links keep a checkpoint from being written: {reason}"
            ));
        }
        if std::fs::read_to_string(&victim).unwrap_or_default() != VICTIM {
            self.misbehaved("a checkpoint was written to where a link leads".into());
        }
        for link in links {
            let _ = std::fs::remove_file(link);
        }
        Ok(())
    }

    /// The recorder's terminal is closed: it finishes its file.
    pub fn hang_up(&mut self) -> anyhow::Result<()> {
        // One that has not attached yet has no file to finish.
        self.attached()?;
        // From the system, and from the shell.
        self.recorder.signal(Signal::HUP);
        self.recorder.signal(Signal::HUP);
        match self.recorder.wait() {
            Some(status) if status.success() => {
                if let Some(words) = damage::damaged(&self.recording) {
                    self.unreadable(format!("of a recorder that was hung up on: {words}"));
                }
            }
            Some(status) => {
                let words = self.recorder.words();
                self.misbehaved(format!("a recorder that was hung up on: {status}: {words}"));
            }
            None => {
                self.recorder.kill();
                self.astray("a recorder does not end when it is hung up on".into());
            }
        }
        let _ = std::fs::remove_file(&self.recording);
        self.recorder = self.start_recorder()?;
        Ok(())
    }

    /// Commands are asked for more threads than any machine has processors.
    pub fn ask_for_threads(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let threads = format!(
            "--threads={}",
            ABSURD[rng.next_u32() as usize % ABSURD.len()]
        );
        for words in [
            &["serve", "scene.toml", "--session", "absurd"][..],
            &["simulate", "scene.toml", "--duration", "0.1"],
            &["verify", "none.mcap"],
            &["branch", "none.mcap", "--at", "1"],
        ] {
            let command = self.stage.command(&[words, &[&threads]].concat())?;
            let (status, said) = self.stage.ask(silent(command))?;
            let is_refused = status.code() == Some(2) && said.contains("1 to 1024 threads");
            if !is_refused {
                self.misbehaved(format!("{} {threads}: {status}: {said}", words[0]));
            }
        }
        Ok(())
    }
}
