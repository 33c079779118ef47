//! `cosplat branch`: goes on live from a recorded step.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
};

use anyhow::{Context, bail, ensure};
use cosplat_recorder::{
    chunks::Chunks,
    messages::JournalEntry,
    reader::{Event, Recording},
    runs::{CommandCount, FileKind, RunHeader},
};

use crate::{
    note, progress,
    resimulate::{Kept, Rerun, Take, take},
    serve, signals,
};

/// Go on live from a recorded step, with all of its state.
///
/// The run is simulated again up to that step, from its start or the checkpoint that it began with, and compared with the
/// recorded hashes on the way; commands that the recording has of later steps are left out.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// The step after which to go on.
    #[arg(long, value_name = "STEP")]
    at: u64,
    /// Which run of the server, counted from 1; needed where the recording holds several.
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    #[command(flatten)]
    how: serve::How,
}

/// Runs the command.
///
/// # Errors
/// When the recording lacks something, the step is not in it, or simulating it again gives another state.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let path = &args.recording;
    let Take { header, kept, .. } = take(&mut Chunks::open(path)?, path, args.run)?;
    let recorded = Recorded::of(path, header.scene.epoch)?;
    let mut rerun = Rerun::begin(&kept, &header, path, args.how.threads)?;
    let (first, last) = (rerun.step(), recorded.last);
    ensure!(
        (first..=last).contains(&args.at),
        "step {} is not in the run, which can be branched at steps {first} to {last}",
        args.at
    );
    let mut count = CommandCount::default();
    for entry in recorded.journal {
        if entry.applied.step <= args.at {
            count.take(&entry)?;
            rerun.expect(entry.applied);
        }
    }
    let bar = progress::bar("simulating again", args.at - first);
    loop {
        let (step, hash) = (rerun.step(), rerun.report().state_hash);
        if let Some(expected) = recorded.hashes.get(&step)
            && *expected != hash
        {
            bail!(
                "step {step} is not what was recorded: its state hash is {hash:016x}, expected {expected:016x}; \
                 `cosplat verify` says more"
            );
        }
        bar.set_position(step - first);
        if step == args.at {
            break;
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        rerun.advance()?;
    }
    bar.finish_and_clear();

    // Recorders of the branch find here what they attach, for as long as it is served.
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let copies = unpack(&kept, &header, folder.path())?;
    let copy = |name: &str| copies.get(name).cloned().unwrap_or_default();
    let scene = kept.scene(&header, path, copy)?;
    let checkpoint = folder.path().join(format!("step-{}.checkpoint", args.at));
    fs::write(&checkpoint, rerun.checkpoint())
        .with_context(|| format!("cannot write {}", checkpoint.display()))?;
    drop(rerun);
    note!("branching {} at step {}", path.display(), args.at);
    serve::serve_scene(scene, Some(checkpoint), &args.how, &stop)
}

/// What a run has to be compared with and to apply.
#[derive(Default)]
struct Recorded {
    journal: Vec<JournalEntry>,
    /// State hashes by step.
    hashes: BTreeMap<u64, u64>,
    /// Last step of a frame.
    last: u64,
}

impl Recorded {
    /// Reads the run with this `epoch`.
    fn of(path: &Path, epoch: u64) -> anyhow::Result<Recorded> {
        let mut recorded = Recorded::default();
        for event in Recording::open(path)?.without_gaussians() {
            match event? {
                Event::Frame(frame) if frame.header.epoch == epoch => {
                    let header = frame.header;
                    recorded.hashes.insert(header.step, header.state_hash);
                    recorded.last = header.step;
                }
                Event::Journal(entry) if entry.epoch.is_none_or(|e| e == epoch) => {
                    recorded.journal.push(entry);
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
) -> anyhow::Result<BTreeMap<String, PathBuf>> {
    let assets = kept
        .files(run)
        .filter(|(kind, ..)| *kind == FileKind::Asset);
    let mut paths = BTreeMap::new();
    for (n, (_, name, content)) in assets.enumerate() {
        // Names come from the recording, and are no paths to write to.
        let path = folder.join(format!("asset-{n}"));
        fs::write(&path, content).with_context(|| format!("cannot write {}", path.display()))?;
        paths.insert(name.to_owned(), path);
    }
    Ok(paths)
}
