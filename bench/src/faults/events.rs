//! Faults, how often each comes, and what each does.

use std::{process::Command, time::Duration};

use anyhow::Context;
use cosplat_ipc::{
    Client,
    schema::{self as wire},
};
use rand_core::Rng;
use rustix::process::Signal;

use super::{
    act::Act,
    damage,
    doors::Attack,
    orders,
    troupe::{PATIENCE, SESSION, Stage, is_orderly, piped, silent, write},
};

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    StopClient,
    StopServer,
    KillRecorder,
    KillViewer,
    KillHolder,
    KillController,
    KillServer,
    SlowReader,
    ReconnectStorm,
    Malformed,
    Oversized,
    Flood,
    VersionSkew,
    SecondServer,
    FullMemory,
    FullDisk,
    DamagedRecording,
    DamagedCheckpoint,
    ClockJump,
    FullQueue,
    ForeignLink,
    HangUp,
    AbsurdThreads,
    LinkedOutput,
    Bomb,
    Device,
    Door(Attack),
}

/// All faults, with their names and weights.
const ALL: [(Event, &str, u32); 29] = [
    (Event::StopClient, "client stopped", 14),
    (Event::StopServer, "server stopped", 8),
    (Event::KillRecorder, "recorder killed", 3),
    (Event::KillViewer, "viewer killed", 2),
    (Event::KillHolder, "client killed with a frame", 4),
    (Event::KillController, "controller killed", 2),
    (Event::KillServer, "server killed", 2),
    (Event::SlowReader, "slow reader", 12),
    (Event::ReconnectStorm, "reconnect storm", 8),
    (Event::Malformed, "malformed commands", 14),
    (Event::Oversized, "oversized request", 7),
    (Event::Flood, "flood of commands", 6),
    (Event::VersionSkew, "version skew", 5),
    (Event::SecondServer, "second server", 1),
    (Event::FullMemory, "full shared memory", 1),
    (Event::FullDisk, "full disk", 1),
    (Event::DamagedRecording, "damaged recording", 8),
    (Event::DamagedCheckpoint, "damaged checkpoint", 1),
    (Event::ClockJump, "clock jump", 1),
    (Event::FullQueue, "full queue of orders", 2),
    (Event::ForeignLink, "foreign links", 2),
    (Event::HangUp, "recorder hung up on", 2),
    (Event::AbsurdThreads, "absurd numbers of threads", 1),
    (Event::LinkedOutput, "output onto its input", 2),
    (Event::Bomb, "packed to nothing", 1),
    (Event::Device, "device for a recording", 1),
    (
        Event::Door(Attack::OtherSite),
        "page and gateway: orders of another site",
        2,
    ),
    (
        Event::Door(Attack::Silent),
        "page and gateway: silent connections",
        1,
    ),
    (
        Event::Door(Attack::Deaf),
        "page and gateway: answers never read",
        1,
    ),
];

impl Event {
    /// The next one of a schedule.
    pub fn draw(rng: &mut impl Rng) -> (Event, &'static str) {
        let mut at = rng.next_u32() % ALL.iter().map(|(.., weight)| weight).sum::<u32>();
        for (event, name, weight) in ALL {
            if at < weight {
                return (event, name);
            }
            at -= weight;
        }
        (ALL[0].0, ALL[0].1)
    }
}

/// A time between two [ms].
fn between(rng: &mut impl Rng, from: u64, to: u64) -> Duration {
    Duration::from_millis(from + rng.next_u64() % (to - from + 1))
}

impl Act<'_> {
    /// Does it.
    pub fn perform(&mut self, event: Event, rng: &mut impl Rng) -> anyhow::Result<()> {
        match event {
            Event::StopClient => {
                let of = rng.next_u32();
                let player = if of & 1 == 0 {
                    &self.recorder
                } else {
                    &self.viewer
                };
                player.signal(Signal::STOP);
                std::thread::sleep(between(rng, 5, 120));
                player.signal(Signal::CONT);
            }
            Event::StopServer => {
                let (server, time) = (&self.server, between(rng, 5, 60));
                self.watch.shared.disturb(|| {
                    server.signal(Signal::STOP);
                    std::thread::sleep(time);
                    server.signal(Signal::CONT);
                });
            }
            Event::KillRecorder => {
                self.recorder.kill();
                self.check_recording();
                self.recorder = self.start_recorder()?;
                // Some are killed again while they attach.
                std::thread::sleep(between(rng, 0, 300));
            }
            Event::KillViewer => {
                self.viewer.kill();
                self.viewer = self.start_viewer()?;
                std::thread::sleep(between(rng, 0, 300));
            }
            Event::KillHolder => {
                let command = piped(self.stage.command(&["faults", "--hold"])?);
                let mut holder = self.stage.start("holder", command)?;
                match rng.next_u32() % 3 {
                    // While it attaches.
                    0 => std::thread::sleep(between(rng, 0, 100)),
                    _ => {
                        if let Err(error) = holder.hear() {
                            self.astray(format!("{error:#}"));
                        }
                    }
                }
                holder.kill();
            }
            Event::KillController => self.kill_controller(rng)?,
            Event::KillServer => self.kill_server(rng)?,
            Event::SlowReader => {
                let mut frames = self.client.frames(1 + rng.next_u32() as usize % 8)?;
                let held = frames.next(Duration::from_millis(60))?;
                std::thread::sleep(between(rng, 5, 100));
                drop(held);
            }
            Event::ReconnectStorm => self.storm(rng),
            Event::Malformed => {
                let taken = orders::send_malformed(&self.client, rng, PATIENCE)?;
                if taken > 0 {
                    self.misbehaved(format!("{taken} malformed commands were taken"));
                }
            }
            Event::Oversized => orders::send_oversized(&self.stage, rng)?,
            Event::Flood => orders::flood(&self.client, rng)?,
            Event::VersionSkew => {
                if orders::skewed(&self.stage, rng)? {
                    self.misbehaved("other types were let in".into());
                }
            }
            Event::SecondServer => {
                let (status, words) = self.stage.ask(self.serve(&[])?)?;
                let is_told = status.code() == Some(1) && words.contains("already");
                if !is_told {
                    self.misbehaved(format!("a second server: {status}: {words}"));
                }
            }
            Event::FullMemory => self.fill_memory()?,
            Event::FullDisk => self.fill_disk(rng)?,
            Event::DamagedRecording => {
                let copy = self.stage.path("damaged.mcap");
                let found = damage::damaged_copy(&self.recording, &copy, rng);
                if let Some(words) = found {
                    self.unreadable(format!("a damaged recording: {words}"));
                }
            }
            Event::DamagedCheckpoint => self.damage_checkpoint(rng)?,
            Event::ClockJump => self.jump(rng)?,
            Event::FullQueue => self.fill_queue()?,
            Event::ForeignLink => self.lay_links()?,
            Event::HangUp => self.hang_up()?,
            Event::AbsurdThreads => self.ask_for_threads(rng)?,
            Event::LinkedOutput => self.link_output(rng)?,
            Event::Bomb => self.bomb(rng)?,
            Event::Device => self.device(rng)?,
            Event::Door(attack) => self.knock(attack, rng)?,
        }
        Ok(())
    }

    /// A controller that is killed in the middle of its script.
    fn kill_controller(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let orders = (0..200).map(|n| {
            let time = f64::from(n) * 0.001;
            format!("[[order]]\ntime = {time}\naction = 'push'\nobject = 'block'\nimpulse = [0, 1e-9, 0]\n")
        });
        write(&self.stage.path("push.toml"), &orders.collect::<String>())?;
        let command = self
            .stage
            .command(&["ctl", "--session", SESSION, "script", "push.toml"])?;
        let mut controller = self.stage.start("controller", silent(command))?;
        std::thread::sleep(between(rng, 0, 150));
        controller.kill();
        Ok(())
    }

    /// Clients that come and go all at once.
    fn storm(&mut self, rng: &mut impl Rng) {
        let (domain, rounds) = (self.stage.domain.clone(), 1 + rng.next_u32() % 3);
        let visit = || -> anyhow::Result<()> {
            for _ in 0..rounds {
                let client = Client::connect(&domain, SESSION, "storm", PATIENCE)?;
                let _frames = client.frames(2)?;
                let _objects = client.objects(1)?;
                let mut sender = client.commands()?;
                let nothing = wire::Command::default();
                sender.send(&[nothing], PATIENCE)?;
            }
            Ok(())
        };
        let outcomes: Vec<_> = std::thread::scope(|scope| {
            let visitors: Vec<_> = (0..3).map(|_| scope.spawn(visit)).collect();
            visitors.into_iter().map(|visitor| visitor.join()).collect()
        });
        for outcome in outcomes {
            match outcome {
                Ok(Ok(())) => {}
                Ok(Err(error)) => self.astray(format!("a client of a storm: {error:#}")),
                Err(_) => self.misbehaved("a client of a storm panicked".into()),
            }
        }
    }

    /// A server in a mount namespace whose shared memory is too small must say so.
    fn fill_memory(&mut self) -> anyhow::Result<()> {
        let stage = Stage::new(&format!("{}m", self.name))?;
        write(&stage.path("scene.toml"), super::act::SCENE)?;
        let mut command = Command::new("unshare");
        command
            .args(["--mount", "--map-root-user", "sh", "-c"])
            .arg("mount -t tmpfs -o size=4m tmpfs /dev/shm && exec \"$0\" serve scene.toml --duration 1")
            .arg(std::env::current_exe()?);
        stage.prepare(&mut command);
        let asked = stage.ask(command);
        stage.domain.discard();
        let (status, words) = asked?;
        if words.contains("unshare") || words.contains("mount:") {
            self.skip("full shared memory", words);
        } else if status.code() != Some(1) || !words.contains("shared memory") {
            self.misbehaved(format!("full shared memory: {status}: {words}"));
        }
        Ok(())
    }

    /// A recorder whose file may not grow, which to it is a full disk.
    fn fill_disk(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let blocks = 16 + rng.next_u32() % 512;
        let mut command = Command::new("sh");
        command
            .args(["-c", &format!("ulimit -f {blocks} && exec \"$0\" record --session {SESSION} -o full.mcap --force --duration 1")])
            .arg(std::env::current_exe()?);
        self.stage.prepare(&mut command);
        let (status, words) = self.stage.ask(command)?;
        if !is_orderly(status) {
            self.misbehaved(format!("full disk: {status}: {words}"));
        }
        if let Some(words) = damage::unreadable(&self.stage.path("full.mcap")) {
            self.unreadable(format!("a recording on a full disk: {words}"));
        }
        // The next one has the name from its beginning, too.
        let _ = std::fs::remove_file(self.stage.path("full.mcap"));
        Ok(())
    }

    /// A server that is to begin with a damaged checkpoint must refuse.
    fn damage_checkpoint(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let order = wire::Command {
            kind: wire::COMMAND_CHECKPOINT,
            ..Default::default()
        };
        let acks = self.client.commands()?.send(&[order], PATIENCE)?;
        let ack = acks.first().context("an answer")?;
        let mut bytes = std::fs::read(ack.reason()?).context("the checkpoint that was ordered")?;
        let whole = bytes.clone();
        damage::damage(&mut bytes, 0, rng);
        if bytes == whole {
            return Ok(());
        }
        std::fs::write(self.stage.path("damaged.checkpoint"), bytes)?;
        // In a session of its own: the name of this one is taken, which is a refusal as well.
        let words = [
            "serve",
            "scene.toml",
            "--session",
            "damaged",
            "--duration",
            "0.02",
        ];
        let restore = ["--restore", "damaged.checkpoint"];
        let command = self.stage.command(&[&words[..], &restore].concat())?;
        let (status, words) = self.stage.ask(command)?;
        if status.success() || !is_orderly(status) {
            self.misbehaved(format!("a damaged checkpoint: {status}: {words}"));
        }
        Ok(())
    }

    /// A client whose clocks are elsewhere by hours.
    fn jump(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let seconds = 10_000 + rng.next_u32() % 100_000;
        let mut command = Command::new("unshare");
        let offsets = [
            format!("--monotonic={seconds}"),
            format!("--boottime={seconds}"),
        ];
        command
            .args(["--map-root-user", "--time", "--fork", "--kill-child"])
            .args(offsets)
            .arg(std::env::current_exe()?)
            .args([
                "record",
                "--session",
                SESSION,
                "-o",
                "elsewhere.mcap",
                "--force",
            ])
            .args(["--duration", "0.2", "--wait", "5"]);
        self.stage.prepare(&mut command);
        let (status, words) = self.stage.ask(command)?;
        if words.contains("unshare") {
            self.skip("clock jump", words);
        } else if !is_orderly(status) {
            self.misbehaved(format!("clock jump: {status}: {words}"));
        }
        Ok(())
    }
}
