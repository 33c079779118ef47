//! An act: one session with its processes, a row of faults, and a look at what is left.

use std::{
    path::PathBuf,
    process::Command,
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use cosplat_ipc::{
    Client,
    client::StatusReader,
    schema::{self as wire, Status},
};
use indicatif::ProgressBar;
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

use super::{
    Report, damage,
    events::Event,
    troupe::{PATIENCE, Player, SESSION, Stage, silent, write},
    watch::Watch,
};
use crate::process::{descriptors, own_memory};

/// A scene of one small block over a floor, of some hundred Gaussians: what is measured is what surrounds its steps.
pub const SCENE: &str = r#"
version = 1
name = "a small block"
frame_rate = 50
dx = 0.05

[[objects]]
name = "block"
shape = { kind = "box", size = [0.1, 0.1, 0.1], gaussian_spacing = 0.02 }
translation = [0.0, 0.06, 0.0]
material = "soft_rubber"

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.4
"#;

/// Growth of a server's own memory during a life that counts [bytes]: many times what its allocator keeps for later.
const MEMORY_MARGIN: u64 = 16 << 20;
/// Growth of a server's descriptors during a life that counts. Streams open one for a place of a reader when it is first taken:
/// four more after one killed recorder, four after 36. A leak per fault would pass this in a life of 50 faults.
const DESCRIPTOR_MARGIN: usize = 24;
/// Time without a change after which descriptors count as settled, and the longest wait for that.
const STEADY: Duration = Duration::from_millis(500);
const SETTLED: Duration = Duration::from_secs(15);
/// Faults that a life takes at least before memory and descriptors at its ends are compared.
const LONG_LIFE: u32 = 8;
/// Words of a viewer whose session ended before it could attach to all of it.
const UNDRAWN: &str = "ended before a picture of it could be drawn";

/// How steps are permitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    Realtime,
    Free,
    Lockstep,
    Paused,
}

impl Pace {
    pub const ALL: [Pace; 4] = [Pace::Realtime, Pace::Free, Pace::Lockstep, Pace::Paused];

    fn name(self) -> &'static str {
        match self {
            Pace::Realtime => "real time",
            Pace::Free => "free",
            Pace::Lockstep => "lock-step",
            Pace::Paused => "paused",
        }
    }

    fn arguments(self) -> &'static [&'static str] {
        match self {
            Pace::Realtime => &["--pace", "realtime"],
            Pace::Free => &["--pace", "free"],
            Pace::Lockstep => &[
                "--pace",
                "lockstep",
                "--participants",
                "beat",
                "--on-timeout",
                "drop",
            ],
            Pace::Paused => &["--paused"],
        }
    }
}

/// What a server held at some time of its life.
struct Held {
    pid: u32,
    faults: u32,
    memory: u64,
    descriptors: usize,
}

/// A running act.
pub struct Act<'r> {
    pub name: String,
    pub stage: Stage,
    pace: Pace,
    pub server: Player,
    pub recorder: Player,
    pub viewer: Player,
    pub watch: Watch,
    pub client: Client,
    status: StatusReader,
    /// File of the recorder.
    pub recording: PathBuf,
    recordings: u32,
    /// When the life of the server began.
    held: Held,
    faults: u32,
    report: &'r mut Report,
}

impl<'r> Act<'r> {
    /// Plays it to its end.
    pub fn play(
        pace: Pace,
        seed: u64,
        faults: u32,
        report: &'r mut Report,
        bar: &ProgressBar,
    ) -> anyhow::Result<()> {
        let name = format!("f{}{}", std::process::id() % 1_000_000, report.acts % 1000);
        let mut act = Self::begin(name, pace, report)?;
        let domain = act.stage.domain.clone();
        let ended = match act.suffer(seed, faults, bar) {
            Ok(()) => act.end(),
            Err(error) => {
                drop(act);
                Err(error)
            }
        };
        domain.discard();
        ended
    }

    /// All faults of the act, as long as there is a server.
    fn suffer(&mut self, seed: u64, faults: u32, bar: &ProgressBar) -> anyhow::Result<()> {
        let (mut rng, pace) = (Pcg64Mcg::new(seed.into()), self.pace.name());
        for _ in 0..faults {
            let (event, name) = Event::draw(&mut rng);
            bar.set_message(name);
            let begun = Instant::now();
            if let Err(error) = self.perform(event, &mut rng) {
                self.astray(format!("{pace}, {name}: {error:#}"));
            }
            *self.report.injected.entry(name).or_default() += 1;
            *self.report.took.entry(name).or_default() += begun.elapsed().as_secs_f64();
            *self.report.paces.entry(pace).or_default() += 1;
            self.faults += 1;
            bar.inc(1);
            if !self.server.is_running() {
                bail!("{pace}, {name}: the server ended: {}", self.server.words());
            }
        }
        Ok(())
    }

    fn begin(name: String, pace: Pace, report: &'r mut Report) -> anyhow::Result<Self> {
        let stage = Stage::new(&name)?;
        write(&stage.path("scene.toml"), SCENE)?;
        let server = stage.start("server", silent(serve(&stage, pace, &[])?))?;
        let client = stage.client("campaign")?;
        let watch = Watch::begin(&stage, pace, server.id())?;
        let status = client.status()?;
        let recording = stage.path("run0.mcap");
        let mut act = Self {
            name,
            pace,
            recorder: record(&stage, "run0.mcap")?,
            viewer: view(&stage)?,
            recording,
            recordings: 0,
            held: Held {
                pid: server.id(),
                faults: 0,
                memory: 0,
                descriptors: 0,
            },
            server,
            watch,
            client,
            status,
            stage,
            faults: 0,
            report,
        };
        act.attached()?;
        act.weigh();
        Ok(act)
    }

    /// A server of this act's session.
    pub fn serve(&self, arguments: &[&str]) -> anyhow::Result<Command> {
        serve(&self.stage, self.pace, arguments)
    }

    pub fn start_recorder(&mut self) -> anyhow::Result<Player> {
        self.recordings += 1;
        let name = format!("run{}.mcap", self.recordings);
        self.recording = self.stage.path(&name);
        record(&self.stage, &name)
    }

    pub fn start_viewer(&self) -> anyhow::Result<Player> {
        view(&self.stage)
    }

    /// Readers of frames that an act has.
    fn readers(&self) -> u32 {
        match self.pace {
            Pace::Realtime | Pace::Free => 3,
            Pace::Lockstep | Pace::Paused => 2,
        }
    }

    /// Waits until recorder, viewer and watch are attached to the server of now, and steps are seen.
    pub fn attached(&mut self) -> anyhow::Result<()> {
        let deadline = Instant::now() + PATIENCE;
        let readers = self.readers();
        loop {
            let status = self.status.next(Duration::from_millis(50))?;
            let mut newest = status.filter(|s| s.pid == self.server.id());
            // Readers that were killed count until their places are free again, so the recorder shows itself by its file.
            let is_here = |s: &mut Status| s.frame_readers >= readers && self.recording.exists();
            if newest.take_if(is_here).is_some() {
                return Ok(());
            }
            ensure!(
                self.server.is_running(),
                "the server ended: {}",
                self.server.words()
            );
            for (player, name) in [
                (&mut self.recorder, "recorder"),
                (&mut self.viewer, "viewer"),
            ] {
                if !player.is_running() {
                    let words = format!("the {name} ended: {}", player.words());
                    self.report.find(|c| &mut c.clients_not_reattached, words);
                    return Ok(());
                }
            }
            if Instant::now() > deadline {
                let words = format!(
                    "{} of {readers} readers came back",
                    newest.map_or(0, |s| s.frame_readers)
                );
                self.report.find(|c| &mut c.clients_not_reattached, words);
                return Ok(());
            }
        }
    }

    /// The last step that the server told of.
    pub fn newest_step(&mut self) -> anyhow::Result<u64> {
        let status = self.status.next(PATIENCE)?;
        Ok(status.context("the server says how it goes")?.step)
    }

    /// Kills the server and starts another of its name.
    pub fn kill_server(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        self.compare();
        self.check_skipped()?;
        let shared = self.watch.shared.clone();
        let epoch = shared.epoch.load(Ordering::Relaxed);
        let pause = Duration::from_millis(rng.next_u64() % 100);
        shared.disturb(|| -> anyhow::Result<()> {
            self.server.kill();
            std::thread::sleep(pause);
            let command = silent(self.serve(&[])?);
            self.server = self.stage.start("server", command)?;
            shared.serves(self.server.id());
            self.attached()?;
            // The watch is a client as well.
            let deadline = Instant::now() + PATIENCE;
            while shared.epoch.load(Ordering::Relaxed) == epoch {
                if Instant::now() > deadline {
                    self.astray("the watch saw no step of the new server".into());
                    break;
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            Ok(())
        })?;
        self.weigh();
        Ok(())
    }

    /// Notes what the server holds as its life begins: once all clients have opened what they need.
    fn weigh(&mut self) {
        let pid = self.server.id();
        let deadline = Instant::now() + SETTLED;
        let (mut held, mut since) = (descriptors(pid).unwrap_or_default(), Instant::now());
        while since.elapsed() < STEADY && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
            let now = descriptors(pid).unwrap_or_default();
            if now != held {
                (held, since) = (now, Instant::now());
            }
        }
        self.held = Held {
            pid,
            faults: self.faults,
            memory: own_memory(pid).unwrap_or_default(),
            descriptors: held,
        };
    }

    /// Compares what the server holds with what it held.
    fn compare(&mut self) {
        let Held {
            pid,
            faults,
            memory,
            descriptors: before,
        } = self.held;
        if self.faults - faults < LONG_LIFE {
            return;
        }
        self.report.lives_compared += 1;
        // What killed clients held is given back by and by.
        let deadline = Instant::now() + SETTLED;
        let mut now = descriptors(pid).unwrap_or_default();
        while now > before + DESCRIPTOR_MARGIN && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
            now = descriptors(pid).unwrap_or_default();
        }
        if now > before + DESCRIPTOR_MARGIN {
            let words = format!("{now} descriptors, {before} when it began");
            self.report.find(|c| &mut c.descriptors_grown, words);
        }
        let own = own_memory(pid).unwrap_or_default();
        if own > memory + MEMORY_MARGIN {
            let words = format!(
                "{} MiB of its own, {} when it began",
                own >> 20,
                memory >> 20
            );
            self.report.find(|c| &mut c.memory_grown, words);
        }
    }

    /// Counts frames that the server skipped so far.
    fn check_skipped(&mut self) -> anyhow::Result<()> {
        let of = |s: &Status| s.pid == self.server.id();
        let newest = self.status.newest()?.filter(of);
        if let Some(skipped) = newest.map(|s| s.frames_skipped).filter(|n| *n > 0) {
            self.report.counters.steps_lost += skipped;
            let words = format!("{skipped} frames found no slot");
            self.report.findings.push(words);
        }
        Ok(())
    }

    /// Looks at the recording that a killed recorder left.
    pub fn check_recording(&mut self) {
        if let Some(words) = damage::unreadable(&self.recording) {
            self.unreadable(format!("of a killed recorder: {words}"));
        }
        let _ = std::fs::remove_file(&self.recording);
    }

    pub fn unreadable(&mut self, words: String) {
        self.report.find(|c| &mut c.recordings_unreadable, words);
    }

    pub fn astray(&mut self, words: String) {
        self.report.find(|c| &mut c.clients_not_reattached, words);
    }

    pub fn misbehaved(&mut self, words: String) {
        self.report.find(|c| &mut c.misbehaved, words);
    }

    pub fn skip(&mut self, name: &'static str, why: String) {
        let first = why.lines().next().unwrap_or_default().to_owned();
        self.report.skipped.insert(name, first);
    }

    /// Ends the session in order, and looks at what is left of it.
    fn end(mut self) -> anyhow::Result<()> {
        // One that was killed by the last fault must be there to see the end.
        self.attached()?;
        self.compare();
        self.check_skipped()?;
        let seen = self.watch.end();
        let stop = wire::Command {
            kind: wire::COMMAND_STOP,
            ..Default::default()
        };
        self.client.commands()?.send(&[stop], PATIENCE)?;
        for (player, name) in [
            (&mut self.server, "server"),
            (&mut self.recorder, "recorder"),
            (&mut self.viewer, "viewer"),
        ] {
            match player.wait() {
                Some(status) if status.success() => {}
                // A viewer that has its scene not yet says so, and fails, by right.
                Some(_) if name == "viewer" && player.words().contains(UNDRAWN) => {}
                Some(status) => {
                    let words = format!("the {name} ended with {status}: {}", player.words());
                    self.report.find(|c| &mut c.misbehaved, words);
                }
                None => {
                    let words = format!("the {name} does not end with its session");
                    self.report.find(|c| &mut c.clients_not_reattached, words);
                    player.kill();
                }
            }
        }
        if let Some(words) = damage::damaged(&self.recording) {
            let words = format!("of a recorder that ended: {words}");
            self.report.find(|c| &mut c.recordings_unreadable, words);
        }
        drop((self.status, self.client));
        self.report.steps += seen.steps;
        self.report.longest_wait = self.report.longest_wait.max(seen.longest_wait);
        for words in seen.stalls {
            let words = format!("{}: {words}", self.pace.name());
            self.report.find(|c| &mut c.stalls, words);
        }
        for words in seen.lost {
            self.report.find(|c| &mut c.steps_lost, words);
        }
        for words in seen.failures {
            self.report.find(|c| &mut c.clients_not_reattached, words);
        }
        let left = self.stage.left();
        if !left.is_empty() {
            self.report.counters.files_leaked += left.len() as u64;
            self.report
                .findings
                .push(format!("left: {}", left.join(" ")));
        }
        Ok(())
    }
}

fn serve(stage: &Stage, pace: Pace, more: &[&str]) -> anyhow::Result<Command> {
    let words = [
        "serve",
        "scene.toml",
        "--session",
        SESSION,
        "--threads",
        "1",
    ];
    stage.command(&[&words[..], pace.arguments(), more].concat())
}

fn record(stage: &Stage, name: &str) -> anyhow::Result<Player> {
    let words = ["record", "--session", SESSION, "-o", name, "--wait", "60"];
    stage.start("recorder", silent(stage.command(&words)?))
}

fn view(stage: &Stage) -> anyhow::Result<Player> {
    let words = [
        "view",
        "--session",
        SESSION,
        "--png",
        "pictures",
        "--size",
        "32x24",
    ];
    let patient = ["--every", "25", "--timeout", "60"];
    stage.start(
        "viewer",
        silent(stage.command(&[&words[..], &patient].concat())?),
    )
}
