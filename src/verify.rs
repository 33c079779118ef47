//! `cosplat verify`: simulates what was recorded again and compares every step.

mod differences;

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use cosplat_recorder::{
    RecordingError,
    chunks::Chunks,
    messages::Hex64,
    reader::{Event, Recording},
    runs::{CommandCount, Lack, RunHeader, StepCount},
    topics::RUN_METADATA,
};
use serde::Serialize;

use crate::{
    progress,
    resimulate::{Kept, Rerun},
    say,
};
use differences::Seen;

/// Simulate what was recorded again, from the recording alone, and compare every step.
///
/// State hashes, Gaussians and objects are compared bit for bit. The exit status is 0 only if all of them agree.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// Threads of the solver; 0 means one per core. Results do not depend on it.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print the outcome as one JSON object.
    #[arg(long)]
    json: bool,
}

/// What the verification of a recording comes to.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// The file.
    pub recording: PathBuf,
    /// Whether every step of every run agrees.
    pub verified: bool,
    /// Runs of the server, in the order of the file.
    pub runs: Vec<RunOutcome>,
    /// What is wrong with the file itself.
    pub damage: Option<String>,
}

/// What the verification of one run comes to.
#[derive(Debug, Default, Serialize)]
pub struct RunOutcome {
    /// Identifies the run.
    pub epoch: Hex64,
    /// Name of its session.
    pub session: String,
    /// First and last step that was compared and agrees.
    pub steps: Option<[u64; 2]>,
    /// Steps that were compared and agree.
    pub steps_compared: u64,
    /// Frames that were compared Gaussian by Gaussian and agree.
    pub frames_compared: u64,
    /// Commands of the journal.
    pub commands: u64,
    /// The first step that differs.
    pub differs: Option<Difference>,
    /// Why the run, or the rest of it, cannot be compared.
    pub cannot: Option<String>,
}

/// A step that is not what the simulation makes of it.
#[derive(Debug, Serialize)]
pub struct Difference {
    /// The step.
    pub step: u64,
    /// What differs, in sentences.
    pub what: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// When the file cannot be read, or a step differs or cannot be compared.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let counter = progress::spinner("verifying step");
    let outcome = verify(&args.recording, args.threads, |step| {
        counter.set_position(step);
    })?;
    counter.finish_and_clear();
    match args.json {
        true => say!("{}", serde_json::to_string(&outcome)?)?,
        false => print(&outcome)?,
    }
    match outcome.verified {
        true => Ok(()),
        false => bail!("{} is not verified", args.recording.display()),
    }
}

fn print(outcome: &Outcome) -> anyhow::Result<()> {
    let count = outcome.runs.len();
    for (n, run) in outcome.runs.iter().enumerate() {
        say!("run {} of {count}, session {:?}:", n + 1, run.session)?;
        if let Some([first, last]) = run.steps {
            say!(
                "  {} steps from {first} to {last} agree, {} of them Gaussian by Gaussian, with {} commands",
                run.steps_compared,
                run.frames_compared,
                run.commands
            )?;
        }
        if let Some(Difference { step, what }) = &run.differs {
            say!("  step {step} is the first that differs:")?;
            for sentence in what {
                say!("    {sentence}")?;
            }
        }
        if let Some(reason) = &run.cannot {
            say!("  cannot be verified: {reason}")?;
        }
    }
    if let Some(damage) = &outcome.damage {
        say!("{damage}")?;
    }
    Ok(())
}

/// Verifies a recording on `threads` threads, 0 for one per core; `progress` is told every step.
///
/// # Errors
/// When the file cannot be opened; whatever is wrong with its content is in the outcome.
pub fn verify(path: &Path, threads: usize, progress: impl FnMut(u64)) -> anyhow::Result<Outcome> {
    let mut verifier = Verifier {
        path,
        threads,
        progress,
        kept: Kept::default(),
        open: None,
        done: Vec::new(),
    };
    let mut damage = None;
    for event in Recording::open(path)? {
        match event {
            Ok(event) => verifier.take(event),
            Err(error) => damage = Some(error),
        }
    }
    let damage = damage.map(|error| verifier.damage(error)).transpose()?;
    verifier.close();
    let runs = verifier.done;
    let agrees = |run: &RunOutcome| run.differs.is_none() && run.cannot.is_none();
    Ok(Outcome {
        recording: path.into(),
        verified: damage.is_none() && !runs.is_empty() && runs.iter().all(agrees),
        runs,
        damage,
    })
}

struct Verifier<'a, P> {
    path: &'a Path,
    threads: usize,
    progress: P,
    kept: Kept,
    open: Option<Check>,
    done: Vec<RunOutcome>,
}

/// A run that is being compared.
#[derive(Default)]
struct Check {
    outcome: RunOutcome,
    header: Option<RunHeader>,
    rerun: Option<Rerun>,
    steps: StepCount,
    commands: CommandCount,
    seen: Seen,
}

impl<P: FnMut(u64)> Verifier<'_, P> {
    fn take(&mut self, event: Event) {
        match event {
            Event::Metadata { name, values } if name == RUN_METADATA => {
                self.close();
                let mut check = Check::default();
                match RunHeader::parse(&values) {
                    Ok(header) => {
                        check.outcome.epoch = Hex64(header.scene.epoch);
                        check.outcome.session.clone_from(&header.session);
                        check.header = Some(header);
                    }
                    Err(reason) => check.outcome.cannot = Some(reason),
                }
                self.open = Some(check);
            }
            Event::Attachment { name, data } => {
                if let Some(header) = self.open.as_ref().and_then(|check| check.header.as_ref()) {
                    self.kept.attachment(header, name, data);
                }
            }
            Event::Metadata { .. } => {}
            event => self.compare(event),
        }
    }

    /// Takes a message of the open run.
    fn compare(&mut self, event: Event) {
        let open = self.open.as_ref().map(|check| check.outcome.epoch.0);
        let epoch = match &event {
            Event::Frame(frame) => Some(frame.header.epoch),
            Event::Objects(header, _) => Some(header.epoch),
            Event::Journal(entry) => entry.epoch,
            _ => None,
        };
        if open.is_none() || epoch.is_some_and(|epoch| Some(epoch) != open) {
            self.close();
            let epoch = epoch.unwrap_or_default();
            let lack = Lack::Metadata { epoch };
            let mut check = Check::default();
            check.outcome.epoch = Hex64(epoch);
            check.outcome.cannot = Some(lack.to_string());
            self.open = Some(check);
        }
        let (kept, path, threads) = (&self.kept, self.path, self.threads);
        if let Some(check) = &mut self.open
            && check.goes_on()
            && let Err(reason) = check.take(event, kept, path, threads, &mut self.progress)
        {
            check.outcome.cannot = Some(format!("{reason:#}"));
        }
    }

    /// The open run is complete.
    fn close(&mut self) {
        let Some(mut check) = self.open.take() else {
            return;
        };
        if check.goes_on()
            && let Err(reason) = check.settle(&mut self.progress)
        {
            check.outcome.cannot = Some(format!("{reason:#}"));
        }
        self.done.push(check.outcome);
    }

    /// Looks into a chunk that is damaged: what can be read of it may tell which step it hits.
    fn damage(&mut self, error: RecordingError) -> anyhow::Result<String> {
        if matches!(error, RecordingError::Damaged { .. })
            && let Ok(mut chunks) = Chunks::open(self.path)
            && let Some(content) = chunks.first_damaged()?
        {
            for event in content.events {
                self.take(event);
            }
        }
        Ok(error.to_string())
    }
}

impl Check {
    /// Whether there is still something to be found.
    fn goes_on(&self) -> bool {
        self.outcome.differs.is_none() && self.outcome.cannot.is_none()
    }

    fn take(
        &mut self,
        event: Event,
        kept: &Kept,
        path: &Path,
        threads: usize,
        progress: &mut impl FnMut(u64),
    ) -> anyhow::Result<()> {
        if self.rerun.is_none() {
            let header = self.header.as_ref();
            let header = header.ok_or_else(|| anyhow!("it has no metadata"))?;
            self.rerun = Some(Rerun::begin(kept, header, path, threads)?);
        }
        match event {
            Event::Journal(entry) => {
                self.commands.take(&entry)?;
                self.outcome.commands += 1;
                if let Some(rerun) = &mut self.rerun {
                    rerun.expect(entry.applied);
                }
                self.seen.commands.push(entry);
            }
            Event::Gap(gap) => {
                self.settle(progress)?;
                if let Some(last) = gap.to_step {
                    self.steps.gap(last);
                }
            }
            Event::Objects(header, states) => {
                self.turn_to(header.step, self.seen.objects.is_some(), progress)?;
                self.seen.objects = Some((header, states));
            }
            Event::Frame(frame) => {
                let step = frame.header.step;
                self.turn_to(step, self.seen.frame.is_some(), progress)?;
                if let Some(untold) = self.steps.frame(step) {
                    self.outcome.differs = Some(Difference {
                        step: untold.from_step,
                        what: vec![format!(
                            "steps {} to {} are missing, and /gaps does not say so",
                            untold.from_step, untold.to_step
                        )],
                    });
                    return Ok(());
                }
                self.seen.frame = Some((frame.header, frame.gaussians));
            }
            Event::Metadata { .. } | Event::Attachment { .. } => {}
        }
        Ok(())
    }

    /// Settles what was seen before a message of `step`, unless it completes that.
    fn turn_to(
        &mut self,
        step: u64,
        is_again: bool,
        progress: &mut impl FnMut(u64),
    ) -> anyhow::Result<()> {
        if is_again || step != self.seen.step {
            self.settle(progress)?;
        }
        self.seen.step = step;
        Ok(())
    }

    /// Simulates up to the step that was seen, and compares.
    fn settle(&mut self, progress: &mut impl FnMut(u64)) -> anyhow::Result<()> {
        let (Some(rerun), Some(header)) = (&mut self.rerun, &self.header) else {
            return Ok(());
        };
        if self.seen.is_empty() || self.outcome.differs.is_some() {
            return Ok(());
        }
        let step = self.seen.step;
        if step < rerun.step() {
            bail!("step {step} comes after step {}", rerun.step());
        }
        while rerun.step() < step {
            rerun.advance()?;
            progress(rerun.step());
        }
        let (later, commands) = std::mem::take(&mut self.seen.commands)
            .into_iter()
            .partition(|entry| entry.applied.step > step);
        self.seen.commands = commands;
        let report = rerun.report().clone();
        let gaussians = match self.seen.frame {
            Some(_) => rerun.gaussians(),
            None => &[],
        };
        let what = self.seen.differences(header, &report, gaussians);
        if what.is_empty() {
            let outcome = &mut self.outcome;
            let [first, last] = outcome.steps.unwrap_or([step; 2]);
            let is_new = outcome.steps_compared == 0 || step > last;
            outcome.steps_compared += u64::from(is_new);
            outcome.frames_compared += u64::from(is_new && self.seen.frame.is_some());
            outcome.steps = Some([first, step]);
        } else {
            self.outcome.differs = Some(Difference { step, what });
        }
        self.seen = Seen {
            step,
            commands: later,
            ..Seen::default()
        };
        Ok(())
    }
}
