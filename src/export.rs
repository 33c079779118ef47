//! `cosplat export`: a recording as splat files, as an animated scene or as splats in time.

use std::path::PathBuf;

use cosplat_export::{glb, ply, reel::Steps, usd};

use crate::{inspect::plural, progress, say, signals, view::open_reel};

/// Export a recording: a splat file per step, or one animated scene.
///
/// What each format cannot carry is in docs/export.md.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("format").required(true)))]
pub struct Args {
    /// The recording.
    #[arg(value_name = "RUN.mcap")]
    recording: PathBuf,
    /// Folder for a sequence of splat files, `step_NNNNNNNN.ply`.
    #[arg(long, value_name = "DIR", group = "format")]
    ply: Option<PathBuf>,
    /// File for an animated scene, binary glTF: a node per object, with its Gaussians.
    #[arg(long, value_name = "FILE", group = "format")]
    glb: Option<PathBuf>,
    /// File for splats in time, USD (`.usd`, `.usdc`, `.usda`): needs Python with `cosplat[usd]`, which COSPLAT_PYTHON names.
    #[arg(long, value_name = "FILE", group = "format")]
    usd: Option<PathBuf>,
    /// The first of every such many steps.
    #[arg(long, value_name = "STEPS", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,
    /// One step.
    #[arg(long, value_name = "STEP", conflicts_with = "every")]
    step: Option<u64>,
    /// Which run of the recording, counted from 1; needed where it holds several.
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the recording cannot be read, or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let steps = args.step.map_or(Steps::Every(args.every), Steps::Only);
    let mut reel = open_reel(&args.recording, args.run, steps)?;
    let bar = progress::bar("steps", reel.count() as u64);
    let passed = |_| bar.inc(1);
    if let Some(folder) = &args.ply {
        let written = ply::write_sequence(&mut reel, folder, &stop, passed)?;
        bar.finish_and_clear();
        return match (args.json, &written.last) {
            (true, _) => say!("{}", serde_json::to_string(&written)?),
            (false, None) => say!("interrupted before the first file"),
            (false, Some(last)) => say!(
                "{} {}, {} bytes, the last one {}",
                written.files,
                plural(written.files, "file"),
                written.bytes,
                last.display()
            ),
        };
    }
    if let Some(path) = &args.usd {
        let written = usd::write_scene(&mut reel, path, &stop, passed)?;
        bar.finish_and_clear();
        return match args.json {
            true => say!("{}", serde_json::to_string(&written)?),
            false => say!(
                "{} {}, {} bytes: {}",
                written.steps,
                plural(written.steps, "step"),
                written.bytes,
                path.display()
            ),
        };
    }
    // The group asks for one of the three.
    let Some(path) = &args.glb else { return Ok(()) };
    let written = glb::write_animation(&mut reel, path, &stop, passed)?;
    bar.finish_and_clear();
    if args.json {
        return say!("{}", serde_json::to_string(&written)?);
    }
    say!(
        "{} {}, {} bytes: {}",
        written.steps,
        plural(written.steps, "step"),
        written.bytes,
        path.display()
    )?;
    for object in &written.approximated {
        say!(
            "object {:?} moves as a whole only: its Gaussians are up to {:.3e} m from where they were",
            object.object,
            object.largest_error
        )?;
    }
    Ok(())
}
