//! The state after a recorded step, to go on from.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use cosplat_recorder::{
    RecordingError,
    chunks::Chunks,
    messages::JournalEntry,
    reader::{Event, Recording},
    runs::{CommandCount, FileKind, RunHeader},
    topics::checkpoint_of,
};
use cosplat_scene::load::LoadedScene;
use cosplat_sim_core::{Interruption, command::Action};

use crate::{
    ReplayError,
    outlook::Start,
    rerun::{Kept, Rerun, Take, action, take},
    walk::Walk,
};

/// Where to branch.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The step after which to go on.
    pub at: u64,
    /// Which run of the server, counted from 1; needed where the recording holds several.
    pub run: Option<usize>,
}

/// What a server needs to go on.
#[derive(Debug)]
pub struct Branch {
    /// The scene; copies of its assets are in the folder.
    pub scene: LoadedScene,
    /// The state after the step.
    pub checkpoint: PathBuf,
}

/// Simulates a run again up to a step, compared with the recorded hashes on the way, and writes what a server goes on with
/// to `folder`. `progress` is told how many steps of how many are done; `None` once `stop` is set.
///
/// # Errors
/// When the recording lacks something, the step is not in it, or simulating it again gives another state.
pub fn branch(
    path: &Path,
    Place { at, run }: Place,
    threads: usize,
    folder: &Path,
    stop: &AtomicBool,
    mut progress: impl FnMut(u64, u64),
) -> Result<Option<Branch>, ReplayError> {
    let Take { header, kept, .. } = take(&mut Chunks::open(path)?, path, run)?;
    let recorded = Recorded::of(path, header.scene.epoch, at)?;
    let (first, last) = (recorded.first, recorded.last);
    if !(first..=last).contains(&at) {
        return Err(ReplayError::NoSuchStep { at, first, last });
    }
    let start = match &recorded.start {
        Some(start) if !reaches_back(&recorded.journal, start.step, at)? => Some(start),
        _ => None,
    };
    let mut rerun = Rerun::begin(&kept, &header, path, start, threads)?;
    let first = rerun.step();
    let mut count = match start {
        Some(_) => CommandCount::joined(),
        None => CommandCount::default(),
    };
    for entry in recorded.journal {
        if (first + 1..=at).contains(&entry.applied.step) {
            count.take(&entry)?;
            rerun.expect(entry.applied);
        }
    }
    let asks = || stop.load(Ordering::Relaxed);
    loop {
        if asks() {
            return Ok(None);
        }
        let (step, found) = (rerun.step(), rerun.report().state_hash);
        let expected = recorded.hashes.get(&step).copied().unwrap_or(found);
        if expected != found {
            return Err(ReplayError::Differs {
                step,
                found,
                expected,
            });
        }
        progress(step - first, at - first);
        if step == at {
            break;
        }
        rerun.advance(&Interruption::when(&asks))?;
    }
    // Recorders of the branch find here what they attach, for as long as it is served.
    let copies = unpack(&kept, &header, folder)?;
    let copy = |name: &str| copies.get(name).cloned().unwrap_or_default();
    let scene = kept.scene(&header, path, copy)?;
    let checkpoint = folder.join(format!("step-{at}.checkpoint"));
    write(&checkpoint, &rerun.checkpoint())?;
    Ok(Some(Branch { scene, checkpoint }))
}

/// Whether an undo or redo after step `start`, and up to step `at`, goes to a state from before: a checkpoint has none of these.
fn reaches_back(journal: &[JournalEntry], start: u64, at: u64) -> Result<bool, ReplayError> {
    let (mut undoable, mut redoable) = (0_usize, 0_usize);
    for JournalEntry { applied, .. } in journal {
        if !(start + 1..=at).contains(&applied.step) {
            continue;
        }
        let action = action(applied, applied.step)?.action;
        let [from, to] = match action {
            Action::Undo => [&mut undoable, &mut redoable],
            Action::Redo => [&mut redoable, &mut undoable],
            _ if action.is_edit() => {
                (undoable, redoable) = (undoable + 1, 0);
                continue;
            }
            _ => continue,
        };
        let Some(left) = from.checked_sub(1) else {
            return Ok(true);
        };
        (*from, *to) = (left, *to + 1);
    }
    Ok(false)
}

/// What a run has to be compared with and to apply.
#[derive(Default)]
struct Recorded {
    journal: Vec<JournalEntry>,
    /// State hashes by step.
    hashes: BTreeMap<u64, u64>,
    /// First and last step of a frame; none where they are the wrong way round.
    first: u64,
    last: u64,
    /// The last checkpoint before or at the step asked for.
    start: Option<Start>,
}

impl Recorded {
    /// Reads the run with this `epoch`, which is asked for the step `at`.
    fn of(path: &Path, epoch: u64, at: u64) -> Result<Recorded, RecordingError> {
        let mut recorded = Recorded {
            first: u64::MAX,
            ..Recorded::default()
        };
        let mut walk = Walk::default();
        for event in Recording::open(path)?.without_gaussians() {
            let event = event?;
            walk.next(&event);
            if walk.epoch() != Some(epoch) {
                continue;
            }
            match event {
                Event::Frame(frame) => {
                    let header = frame.header;
                    recorded.hashes.insert(header.step, header.state_hash);
                    recorded.first = recorded.first.min(header.step);
                    recorded.last = header.step;
                }
                Event::Journal(entry) => recorded.journal.push(entry),
                Event::Attachment { name, data } => {
                    let step =
                        checkpoint_of(&name).filter(|(of, step)| *of == epoch && *step <= at);
                    if let Some((_, step)) = step {
                        recorded.start = Some(Start { step, data });
                    }
                }
                _ => {}
            }
        }
        Ok(recorded)
    }
}

/// Writes the assets of a run to `folder`, and returns their paths by the names in the scene.
fn unpack(
    kept: &Kept,
    run: &RunHeader,
    folder: &Path,
) -> Result<BTreeMap<String, PathBuf>, ReplayError> {
    let assets = kept
        .files(run)
        .filter(|(kind, ..)| *kind == FileKind::Asset);
    let mut paths = BTreeMap::new();
    for (n, (_, name, content)) in assets.enumerate() {
        // Names come from the recording, and are no paths to write to.
        let path = folder.join(format!("asset-{n}"));
        write(&path, content)?;
        paths.insert(name.to_owned(), path);
    }
    Ok(paths)
}

fn write(path: &Path, content: &[u8]) -> Result<(), ReplayError> {
    cosplat_files::write(path, content).map_err(|cause| ReplayError::Write {
        path: path.to_owned(),
        cause,
    })
}
