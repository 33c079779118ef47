//! `cosplat bench faults`: a server and its clients under a seeded schedule of faults, and counters that must stay at zero.
//!
//! A campaign is a row of acts. An act has a domain of its own, a server in one of four paces, a recorder, a viewer and a
//! watch; faults come one after the other. `docs/faults.md` explains faults, counters and their limits.

mod act;
mod attacks;
mod damage;
mod doors;
mod events;
mod files;
mod orders;
mod troupe;
mod watch;

use std::{collections::BTreeMap, time::Instant};

use anyhow::bail;
use indicatif::ProgressBar;
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use serde::Serialize;

use crate::{machine::Run, page, progress};
use act::{Act, Pace};

/// What the table is called in a page.
const PART: &str = "cosplat bench faults";
/// Faults of one act.
const EVENTS_PER_ACT: u32 = 50;

/// Inject faults into sessions in every pace, and count what must not happen.
#[derive(clap::Args)]
pub struct Args {
    /// Faults.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
    events: u32,
    /// Seed of the schedule; the same seed injects the same faults in the same order.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    telling: page::Telling,
    /// Be a client that takes a frame and never lets go; the campaign starts it.
    #[arg(long, hide = true)]
    hold: bool,
}

/// Runs the command.
///
/// # Errors
/// When a process cannot be started, or a counter is not zero.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.hold {
        return troupe::hold();
    }
    args.telling.check(PART)?;
    let report = campaign(args)?;
    let here = (&Run::here(), "a campaign of faults");
    args.telling.tell(PART, &report, &report.table(), here)?;
    if !report.counters.are_zero() {
        bail!("seed {}: {}", args.seed, report.findings.join("; "));
    }
    Ok(())
}

/// What must not happen, and how often it did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counters {
    /// Steps that were made and not published, or did not reach a reader that kept up.
    pub steps_lost: u64,
    /// Waits for a step that were more than two frames too long, processor time that others had aside.
    pub stalls: u64,
    /// Recordings of which nothing can be read after recovery, or that are damaged after it.
    pub recordings_unreadable: u64,
    /// Clients that did not come back to a server, or could not attach to it.
    pub clients_not_reattached: u64,
    /// Files in shared memory after the last process of a domain ended.
    pub files_leaked: u64,
    /// Lives of a server in which its own memory grew by more than a bound.
    pub memory_grown: u64,
    /// Lives of a server at whose end it held more descriptors than at its beginning.
    pub descriptors_grown: u64,
    /// Bad input that was taken, or that ended a program by a signal or a panic.
    pub misbehaved: u64,
}

impl Counters {
    fn are_zero(&self) -> bool {
        *self == Self::default()
    }

    /// Each with its name.
    fn named(&self) -> [(&'static str, u64); 8] {
        [
            ("steps lost", self.steps_lost),
            ("stalls over two frames", self.stalls),
            ("recordings unreadable", self.recordings_unreadable),
            ("clients not reattached", self.clients_not_reattached),
            ("files leaked in shared memory", self.files_leaked),
            ("lives with memory grown", self.memory_grown),
            ("lives with descriptors grown", self.descriptors_grown),
            ("bad input taken, panics", self.misbehaved),
        ]
    }
}

/// What a campaign came to.
#[derive(Debug, Default, Serialize)]
pub struct Report {
    seed: u64,
    events: u32,
    acts: u32,
    seconds: f64,
    /// Faults by name.
    injected: BTreeMap<&'static str, u64>,
    /// Time that they took, by name [s].
    took: BTreeMap<&'static str, f64>,
    /// Faults by pace.
    paces: BTreeMap<&'static str, u64>,
    /// Faults that this machine does not permit, by name, and why.
    skipped: BTreeMap<&'static str, String>,
    /// Steps that were watched.
    steps: u64,
    /// Longest wait for a step, processor time that others had aside, over the length of a frame.
    longest_wait: f64,
    /// Lives of servers in which memory and descriptors were compared.
    lives_compared: u64,
    counters: Counters,
    /// One sentence for each count.
    findings: Vec<String>,
}

impl Report {
    /// Counts something and says what.
    fn find(&mut self, counter: fn(&mut Counters) -> &mut u64, words: String) {
        *counter(&mut self.counters) += 1;
        self.findings.push(words);
    }

    fn table(&self) -> String {
        let list = |all: &BTreeMap<&str, u64>| {
            let words = all.iter().map(|(name, n)| format!("{name} {n}"));
            words.collect::<Vec<_>>().join(", ")
        };
        let mut lines = vec![
            "| counter | count |".to_owned(),
            "| --- | ---: |".to_owned(),
        ];
        let counters = self.counters.named().into_iter();
        lines.extend(counters.map(|(name, n)| format!("| {name} | {n} |")));
        lines.push(String::new());
        lines.push(format!(
            "Seed {}: {} faults in {} acts, {:.0} s. {} steps watched, longest wait {:.1} frames, {} lives of servers compared.",
            self.seed, self.events, self.acts, self.seconds, self.steps, self.longest_wait, self.lives_compared
        ));
        lines.push(format!("By pace: {}.", list(&self.paces)));
        lines.push(String::new());
        lines.extend(["| fault | injected |", "| --- | ---: |"].map(str::to_owned));
        let injected = self.injected.iter();
        lines.extend(injected.map(|(name, n)| format!("| {name} | {n} |")));
        lines.push(String::new());
        for (name, why) in &self.skipped {
            lines.push(format!("Not possible here: {name} ({why})."));
        }
        lines.extend(self.findings.iter().map(|words| format!("- {words}")));
        lines.join("\n")
    }
}

fn campaign(args: &Args) -> anyhow::Result<Report> {
    let mut report = Report {
        seed: args.seed,
        events: args.events,
        ..Report::default()
    };
    let begun = Instant::now();
    let mut rng = Pcg64Mcg::new(u128::from(args.seed));
    let bar: ProgressBar = progress::bar("faults", u64::from(args.events));
    let mut left = args.events;
    while left > 0 {
        // Short campaigns visit every pace, too.
        let events = left.min(EVENTS_PER_ACT).min(args.events.div_ceil(4));
        let pace = Pace::ALL[report.acts as usize % Pace::ALL.len()];
        let seed = rng.next_u64();
        Act::play(pace, seed, events, &mut report, &bar)?;
        report.acts += 1;
        left -= events;
    }
    bar.finish_and_clear();
    report.seconds = begun.elapsed().as_secs_f64();
    Ok(report)
}
