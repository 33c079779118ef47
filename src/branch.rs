//! `cosplat branch`: goes on live from a recorded step.

use std::path::PathBuf;

use anyhow::Context;
use cosplat_replay::branch::{Branch, Place, branch};

use crate::{note, progress, serve, signals};

/// Go on live from a recorded step, with all of its state.
///
/// The run is simulated again up to that step, from its start or the last checkpoint before it, and compared with the
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
    args.how.check()?;
    let (path, at) = (&args.recording, args.at);
    let place = Place { at, run: args.run };
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let bar = progress::bar("simulating again", 0);
    let threads = args.how.threads;
    let found = branch(path, place, threads, folder.path(), &stop, |done, steps| {
        bar.set_length(steps);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    let Some(Branch { scene, checkpoint }) = found else {
        return Ok(());
    };
    note!("branching {} at step {at}", path.display());
    serve::serve_scene(scene, Some(checkpoint), &args.how, &stop)
}
