//! A session in lock-step at 60 steps per second of the clock, its page server, and pages.
//!
//! The measuring process is the one participant. So it knows how long the server took for each step, and the steps are those of
//! a server in real time.

use std::{
    io::{BufRead, BufReader},
    process::{Child, Stdio},
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use cosplat_ipc::{
    Client, Domain,
    client::{JournalReader, Participant},
};
use rustix::process::{Pid, Signal, kill_process};

use super::page::Seen;
use crate::{
    child::Owned,
    process::{attach, own_memory, processor_time, this},
};

/// Steps per second of the clock [1/s].
const RATE: f64 = 60.0;
/// Longest that anything is waited for, loading included.
const PATIENCE: Duration = Duration::from_secs(120);
/// How often the memory of the page server is looked at.
const LOOK: Duration = Duration::from_millis(100);

/// A step of the simulation.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Time that the server took for it [ms].
    pub own_ms: f64,
    /// From asking to the answer, which comes when its frame was sent [ms].
    pub whole_ms: f64,
}

/// What was seen while steps were made.
#[derive(Debug, Default)]
pub struct Watched {
    pub steps: Vec<Step>,
    /// Wall time [s].
    pub seconds: f64,
    /// Processor time of the page server [s].
    pub web_seconds: f64,
    /// Memory of the page server's own, now and then [byte].
    pub web_memory: Vec<u64>,
}

/// Server, page server and participant.
pub struct Session {
    domain: Domain,
    participant: Participant,
    client: Client,
    journal: JournalReader,
    /// Steps at whose start commands were applied so far.
    pub applied: Vec<u64>,
    /// The last step.
    pub step: u64,
    web: Owned,
    _server: Owned,
    /// Where the page is.
    link: String,
}

impl Session {
    /// Starts server and page server of a scene file, and takes part.
    ///
    /// # Errors
    /// When one of them does not start.
    pub fn open(domain: &Domain, name: &str, scene: &str) -> anyhow::Result<Session> {
        let arguments = ["serve", scene, "--session", name, "--pace", "lockstep"];
        let more = ["--participants", "bench"];
        let mut server = this(domain, &[&arguments[..], &more].concat())?;
        let server = Owned(server.spawn().context("the server does not start")?);
        let client = attach(domain, name, PATIENCE)?;
        let mut web = this(domain, &["view", "--web", "--session", name])?;
        web.stdout(Stdio::piped());
        let mut web = Owned(web.spawn().context("the page server does not start")?);
        let output = web.0.stdout.take().context("its link")?;
        let mut link = String::new();
        BufReader::new(output).read_line(&mut link)?;
        ensure!(link.contains("/#"), "the page server says no link");
        Ok(Session {
            domain: domain.clone(),
            participant: client.participate("bench", PATIENCE)?,
            journal: client.journal()?,
            client,
            applied: Vec::new(),
            step: 0,
            web,
            _server: server,
            link,
        })
    }

    /// Makes steps for so long.
    ///
    /// # Errors
    /// When one is not made.
    pub fn run(&mut self, seconds: f64) -> anyhow::Result<Watched> {
        let period = Duration::from_secs_f64(1.0 / RATE);
        let begin = Instant::now();
        let before = self.web_time()?;
        let mut seen = Watched::default();
        let (mut due, mut looked) = (begin, 0);
        while begin.elapsed().as_secs_f64() < seconds {
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let asked = Instant::now();
            let stepped = self.participant.step(1, &[])?;
            ensure!(stepped.is_complete(), "a step was not made");
            seen.steps.push(Step {
                own_ms: stepped.done.step_ns as f64 * 1e-6,
                whole_ms: asked.elapsed().as_secs_f64() * 1e3,
            });
            self.step = stepped.done.step;
            if begin.elapsed() >= LOOK * looked {
                looked += 1;
                seen.web_memory.extend(own_memory(self.web.0.id()));
            }
            self.read_journal()?;
            // Late steps are not made up for, as in real time.
            due = (due + period).max(Instant::now());
        }
        seen.seconds = begin.elapsed().as_secs_f64();
        seen.web_seconds = (self.web_time()? - before) as f64 * 1e-9;
        Ok(seen)
    }

    /// What the page server spent on processors so far [ns].
    fn web_time(&self) -> anyhow::Result<u64> {
        let [spent, _] = processor_time(self.web.0.id()).context("the page server is gone")?;
        Ok(spent)
    }

    fn read_journal(&mut self) -> anyhow::Result<()> {
        while let Some(message) = self.journal.next(Duration::ZERO)? {
            let entries = message.items().iter();
            self.applied.extend(entries.map(|entry| entry.step));
        }
        ensure!(
            self.journal.missed() == 0,
            "commands of the journal are lost"
        );
        Ok(())
    }

    /// Makes steps until nobody reads frames, as the page server does until a while after the last page.
    ///
    /// # Errors
    /// When a step is not made, or somebody goes on reading.
    pub fn run_until_nobody_looks(&mut self) -> anyhow::Result<()> {
        let mut status = self.client.status()?;
        let deadline = Instant::now() + PATIENCE;
        while status.newest()?.is_none_or(|s| s.frame_readers > 0) {
            self.run(0.25)?;
            ensure!(Instant::now() < deadline, "somebody goes on reading frames");
        }
        Ok(())
    }

    /// Makes steps until every object has this fidelity.
    ///
    /// # Errors
    /// When a step is not made, or that does not come.
    pub fn run_until_all_have(&mut self, fidelity: u32) -> anyhow::Result<()> {
        let mut objects = self.client.objects(1)?;
        let deadline = Instant::now() + PATIENCE;
        loop {
            self.run(0.25)?;
            let newest = objects.next(Duration::from_millis(100))?;
            let is_there = |o: &cosplat_ipc::schema::ObjectState| o.fidelity == fidelity;
            if newest.is_some_and(|message| message.items().iter().all(is_there)) {
                return Ok(());
            }
            ensure!(Instant::now() < deadline, "the scene does not settle");
        }
    }

    /// Opens a page that clicks so often, with a number.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn page(&self, number: u64, clicks: usize) -> anyhow::Result<PageProcess> {
        let [number, clicks] = [number.to_string(), clicks.to_string()];
        let arguments = ["web", "--page", self.link.trim(), "--number", &number];
        let more = ["--clicks", &clicks];
        let mut page = this(&self.domain, &[&arguments[..], &more].concat())?;
        page.stdin(Stdio::piped()).stdout(Stdio::piped());
        let page = page.spawn().context("a page cannot be started")?;
        Ok(PageProcess(Owned(page)))
    }
}

/// A page.
pub struct PageProcess(Owned);

impl PageProcess {
    /// Sends a signal.
    ///
    /// # Errors
    /// When it is gone.
    pub fn signal(&self, signal: Signal) -> anyhow::Result<()> {
        let pid = i32::try_from(self.0.0.id()).ok().and_then(Pid::from_raw);
        Ok(kill_process(pid.context("a process id")?, signal)?)
    }

    /// Ends it; what it saw.
    ///
    /// # Errors
    /// When it failed.
    pub fn end(mut self) -> anyhow::Result<Seen> {
        let child: &mut Child = &mut self.0.0;
        drop(child.stdin.take());
        let output = child.stdout.take().context("what a page saw")?;
        serde_json::from_reader(output).context("a page ended early")
    }
}
