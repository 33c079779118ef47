//! Every step of a recording simulated again and compared, bit for bit.

use std::path::{Path, PathBuf};

use cosplat_recorder::{
    RecordingError,
    chunks::Chunks,
    messages::Hex64,
    reader::{Event, Recording},
    runs::{CommandCount, Lack, RunHeader, StepCount},
};
use cosplat_sim_core::Interruption;
use serde::Serialize;
use xxhash_rust::xxh3::xxh3_64;

use crate::{
    ReplayError,
    differences::Seen,
    outlook::{Outlook, Start},
    rerun::{Kept, Rerun},
    walk::{Beginning, Walk},
};

/// What the verification of a recording comes to.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// The file.
    pub recording: PathBuf,
    /// Whether every step of every run agrees, and each run has steps that were compared.
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
    /// Steps whose objects were compared and agree.
    pub objects_compared: u64,
    /// Commands of the journal.
    pub commands: u64,
    /// Checkpoints that were compared and agree.
    pub checkpoints_compared: u64,
    /// The step whose checkpoint it was taken up from; `None` where it was simulated from its beginning.
    pub from_checkpoint: Option<u64>,
    /// Recorded steps before that, which nothing can be compared with.
    pub steps_before: u64,
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

/// Verifies a recording on `threads` threads, 0 for one per core; `progress` is told how many frames of how many are done.
///
/// # Errors
/// When the file cannot be opened; whatever is wrong with its content is in the outcome.
pub fn verify(
    path: &Path,
    threads: usize,
    progress: impl FnMut(u64, u64),
) -> Result<Outcome, RecordingError> {
    let mut verifier = Verifier {
        path,
        threads,
        progress,
        done_frames: 0,
        outlook: Outlook::of(path)?,
        walk: Walk::default(),
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
    /// Frames that were taken.
    done_frames: u64,
    outlook: Outlook,
    walk: Walk,
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

impl<P: FnMut(u64, u64)> Verifier<'_, P> {
    fn take(&mut self, event: Event) {
        if let Some(begun) = self.walk.next(&event) {
            self.close();
            self.open = Some(Check::new(begun));
        }
        if matches!(event, Event::Frame(_)) {
            self.done_frames += 1;
            (self.progress)(self.done_frames, self.outlook.frames);
        }
        let Some(check) = &mut self.open else { return };
        match event {
            Event::Attachment { name, data } => {
                if let Some(header) = &check.header {
                    self.kept.attachment(header, name, data);
                }
            }
            Event::Metadata { .. } => {}
            event if check.goes_on() => {
                let taken = check
                    .begin(&self.kept, &self.outlook, self.path, self.threads)
                    .and_then(|()| check.take(event, &self.outlook));
                if let Err(reason) = taken {
                    check.outcome.cannot = Some(reason.to_string());
                }
            }
            _ => {}
        }
    }

    /// The open run is complete.
    fn close(&mut self) {
        let Some(mut check) = self.open.take() else {
            return;
        };
        if check.goes_on() {
            // A run without a step has not begun yet: what it lacks is told all the same.
            let settled = check
                .begin(&self.kept, &self.outlook, self.path, self.threads)
                .and_then(|()| check.settle(&self.outlook))
                .and_then(|()| check.has_compared());
            check.outcome.cannot = settled.err().map(|reason| reason.to_string());
        }
        self.done.push(check.outcome);
    }

    /// Looks into a chunk that is damaged: what can be read of it may tell which step it hits.
    fn damage(&mut self, error: RecordingError) -> Result<String, RecordingError> {
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
    fn new(Beginning { epoch, header }: Beginning) -> Check {
        let mut check = Check::default();
        check.outcome.epoch = Hex64(epoch);
        match header {
            Ok(header) => {
                check.outcome.session.clone_from(&header.session);
                check.header = Some(header);
            }
            Err(reason) => check.outcome.cannot = Some(reason),
        }
        check
    }

    /// Whether there is still something to be found.
    fn goes_on(&self) -> bool {
        self.outcome.differs.is_none() && self.outcome.cannot.is_none()
    }

    /// Begins to simulate the run again, at its beginning or its first checkpoint.
    fn begin(
        &mut self,
        kept: &Kept,
        outlook: &Outlook,
        path: &Path,
        threads: usize,
    ) -> Result<(), ReplayError> {
        let (None, Some(header)) = (&self.rerun, &self.header) else {
            return Ok(());
        };
        let epoch = header.scene.epoch;
        let start = match outlook.start(epoch) {
            Some(step) => Start::read(path, epoch, step)?,
            None => None,
        };
        self.rerun = Some(Rerun::begin(kept, header, path, start.as_ref(), threads)?);
        if let Some(start) = start {
            self.outcome.from_checkpoint = Some(start.step);
            self.commands = CommandCount::joined();
        }
        Ok(())
    }

    /// Whether a step comes before the checkpoint that the run was taken up from.
    fn is_before(&self, step: u64) -> bool {
        self.outcome
            .from_checkpoint
            .is_some_and(|from| step <= from)
    }

    fn take(&mut self, event: Event, outlook: &Outlook) -> Result<(), ReplayError> {
        match event {
            Event::Journal(entry) if self.is_before(entry.applied.step) => {}
            Event::Journal(entry) => {
                self.commands.take(&entry)?;
                self.outcome.commands += 1;
                if let Some(rerun) = &mut self.rerun {
                    rerun.expect(entry.applied);
                }
                self.seen.commands.push(entry);
            }
            Event::Gap(gap) => {
                self.settle(outlook)?;
                if let Some(last) = gap.to_step {
                    self.steps.gap(last);
                }
            }
            Event::Objects(header, states) => {
                self.turn_to(header.step, self.seen.objects.is_some(), outlook)?;
                self.seen.objects = Some((header, states));
            }
            Event::Frame(frame) => {
                let step = frame.header.step;
                self.turn_to(step, self.seen.frame.is_some(), outlook)?;
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

    /// Makes sure that a run without a difference is not one of which nothing was compared.
    fn has_compared(&self) -> Result<(), ReplayError> {
        let (Some(header), outcome) = (&self.header, &self.outcome) else {
            return Ok(());
        };
        let (count, before) = (header.scene.object_count, outcome.steps_before);
        match (outcome.frames_compared, outcome.objects_compared) {
            _ if outcome.differs.is_some() => Ok(()),
            (0, _) if before > 0 => Err(ReplayError::NothingBehind { count: before }),
            (0, _) => Err(Lack::Frames.into()),
            (_, 0) if count > 0 => Err(Lack::Objects { count }.into()),
            _ => Ok(()),
        }
    }

    /// Settles what was seen before a message of `step`, unless it completes that.
    fn turn_to(&mut self, step: u64, is_again: bool, outlook: &Outlook) -> Result<(), ReplayError> {
        if is_again || step != self.seen.step {
            self.settle(outlook)?;
        }
        self.seen.step = step;
        Ok(())
    }

    /// Simulates up to the step that was seen, and compares.
    fn settle(&mut self, outlook: &Outlook) -> Result<(), ReplayError> {
        if self.is_before(self.seen.step) {
            self.outcome.steps_before += u64::from(self.seen.frame.is_some());
            self.seen = Seen::default();
            return Ok(());
        }
        let (Some(rerun), Some(header)) = (&mut self.rerun, &self.header) else {
            return Ok(());
        };
        if self.seen.is_empty() || self.outcome.differs.is_some() {
            return Ok(());
        }
        let step = self.seen.step;
        if step < rerun.step() {
            let before = rerun.step();
            return Err(ReplayError::StepOrder { step, before });
        }
        while rerun.step() < step {
            rerun.advance(Interruption::never())?;
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
        let mut what = self.seen.differences(header, &report, gaussians);
        let kept = outlook.checkpoint(header.scene.epoch, step);
        if let Some(kept) = kept.filter(|_| what.is_empty()) {
            match xxh3_64(&rerun.checkpoint()) == kept {
                true => self.outcome.checkpoints_compared += 1,
                false => what.push("its checkpoint is not the state simulated again".to_owned()),
            }
        }
        if what.is_empty() {
            let outcome = &mut self.outcome;
            let [first, last] = outcome.steps.unwrap_or([step; 2]);
            let is_new = outcome.steps_compared == 0 || step > last;
            outcome.steps_compared += u64::from(is_new);
            outcome.frames_compared += u64::from(is_new && self.seen.frame.is_some());
            outcome.objects_compared += u64::from(is_new && self.seen.objects.is_some());
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
