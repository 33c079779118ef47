//! `cosplat serve`: the simulation process.

use std::{path::PathBuf, sync::atomic::AtomicBool};

use anyhow::Context;
use cosplat_ipc::Domain;
use cosplat_scene::load::{LoadedScene, load_scene};
use cosplat_server::{
    pace::Pace,
    serve::{ServeOptions, ServeSummary, serve},
};
use serde_json::json;

use crate::{note, say, seconds, signals};

/// Simulate a scene and publish every step over shared memory.
#[derive(clap::Args)]
pub struct Args {
    /// Scene file.
    scene: PathBuf,
    /// Begin with this checkpoint of the same scene.
    #[arg(long, value_name = "FILE")]
    restore: Option<PathBuf>,
    #[command(flatten)]
    how: How,
}

/// How a scene is served, whatever it begins with.
#[derive(clap::Args)]
pub struct How {
    /// Name under which clients find this simulation.
    #[arg(long, default_value = "default")]
    session: String,
    /// How simulated time follows wall time.
    #[arg(long, value_enum, default_value_t = PaceName::Realtime)]
    pace: PaceName,
    /// Threads of the solver; 0 means one per core. Results do not depend on it.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Simulated seconds after which to stop; without it, runs until Ctrl-C or `cosplat ctl stop`.
    #[arg(long, value_name = "S", value_parser = seconds::number)]
    duration: Option<f64>,
    /// Begin paused, so that clients can attach before the first step (`cosplat ctl resume` starts it).
    #[arg(long)]
    paused: bool,
    /// Wait for slow readers instead of skipping a frame when shared memory is used up.
    #[arg(long)]
    lossless: bool,
    /// Frames in the shared pool; chosen by frame size without.
    #[arg(long, value_name = "N")]
    frame_slots: Option<usize>,
    /// Folder for the checkpoints that clients order with `cosplat ctl checkpoint`.
    #[arg(long, value_name = "DIR", default_value = ".")]
    checkpoints: PathBuf,
    /// Print one JSON object when done.
    #[arg(long)]
    json: bool,
}

/// [`Pace`] on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
enum PaceName {
    /// One simulated second per wall second.
    Realtime,
    /// As fast as possible.
    Free,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let scene = load_scene(&args.scene)?;
    serve_scene(scene, args.restore.clone(), &args.how, &stop)
}

/// Serves a scene from its start, or from the checkpoint `restore` on, until it ends or `stop` is set.
///
/// # Errors
/// When it cannot be served.
pub fn serve_scene(
    scene: LoadedScene,
    restore: Option<PathBuf>,
    args: &How,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    for warning in &scene.report.warnings {
        note!("warning: {warning}");
    }
    let checkpoints = args
        .checkpoints
        .canonicalize()
        .with_context(|| format!("no folder for checkpoints: {}", args.checkpoints.display()))?;
    let options = ServeOptions {
        domain: Domain::from_env().context("cannot use the session folder")?,
        session: args.session.clone(),
        pace: match args.pace {
            PaceName::Realtime => Pace::Realtime,
            PaceName::Free => Pace::Free,
        },
        threads: args.threads,
        duration: args.duration,
        paused: args.paused,
        lossless: args.lossless,
        frame_slots: args.frame_slots,
        checkpoints: Some(checkpoints),
        restore,
    };
    let summary = serve(scene, &options, stop, |summary| {
        note!(
            "serving session \"{}\": {} Gaussians on {} particles in {} objects{}",
            args.session,
            summary.gaussians,
            summary.particles,
            summary.objects,
            if args.paused { ", paused" } else { "" },
        );
    })?;
    if args.json {
        say!("{}", as_json(&args.session, &summary))?;
    } else {
        note!(
            "{} steps, {:.3} s simulated in {:.3} s, {} frames published, {} skipped, state {:016x}",
            summary.steps,
            summary.sim_seconds,
            summary.wall_seconds,
            summary.frames_published,
            summary.frames_skipped,
            summary.state_hash,
        );
    }
    Ok(())
}

fn as_json(session: &str, summary: &ServeSummary) -> serde_json::Value {
    let factor = if summary.wall_seconds > 0.0 {
        summary.sim_seconds / summary.wall_seconds
    } else {
        0.0
    };
    json!({
        "session": session,
        "gaussians": summary.gaussians,
        "particles": summary.particles,
        "objects": summary.objects,
        "steps": summary.steps,
        "frames_published": summary.frames_published,
        "frames_skipped": summary.frames_skipped,
        "sim_seconds": summary.sim_seconds,
        "wall_seconds": summary.wall_seconds,
        "step_seconds": summary.step_seconds,
        "publish_seconds": summary.publish_seconds,
        "real_time_factor": factor,
        "commands_accepted": summary.commands_accepted,
        "commands_refused": summary.commands_refused,
        "state_hash": format!("{:016x}", summary.state_hash),
    })
}
