//! `cosplat demo`: the main job in one go, as four processes.

use std::path::PathBuf;

use cosplat_demo::{
    compare::Comparison,
    paper,
    run::{self, Options},
    semantic,
};

use crate::{progress, say, seconds, signals};

/// Simulate, record, render and push a scene, each in a process of its own.
#[derive(clap::Args)]
pub struct Args {
    /// Splat to drop onto a floor and push (.ply or .splat); without it, two vases on a table. With a --scene that
    /// shows a capture, the file of that capture.
    #[arg(long, value_name = "FILE")]
    splat: Option<PathBuf>,
    /// A scene of the paper, or one on a real capture.
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(paper::names()))]
    scene: Option<String>,
    /// Instead of the four processes: the scene under several contact methods side by side, in one video and one
    /// sheet of pictures. `own` is the method that the scene names.
    #[arg(
        long,
        value_name = "METHODS",
        requires = "scene",
        num_args = 0..=1,
        require_equals = true,
        value_delimiter = ',',
        default_missing_value = "single_field,own"
    )]
    compare: Option<Vec<String>>,
    /// The paper's way from end to end instead: a splat of things that touch, damaged masks, objects, refinement, a text that names
    /// two, materials by word, a collision. Each step is a command; all files stay.
    #[arg(long, conflicts_with_all = ["splat", "scene", "web", "free"])]
    semantic: bool,
    /// A sketch of it: one round of refinement, and no Gaussian is split.
    #[arg(long, requires = "semantic")]
    draft: bool,
    /// Up axis of the splat: +x -x +y -y +z -z.
    #[arg(
        long,
        value_name = "AXIS",
        allow_hyphen_values = true,
        requires = "splat",
        conflicts_with = "scene"
    )]
    up: Option<String>,
    /// Folder for the scene, recording, picture and video.
    #[arg(long, value_name = "DIR", default_value = "cosplat-demo")]
    out: PathBuf,
    /// Simulated seconds [default: 4, or what the --scene needs].
    #[arg(long, value_name = "S", value_parser = seconds::number)]
    duration: Option<f64>,
    /// Show the scene in a browser instead, until Ctrl-C: prints the link of a page that watches and pushes it, and begins
    /// when the page is opened.
    #[arg(long, conflicts_with_all = ["compare", "duration", "free", "json"])]
    web: bool,
    /// Simulate as fast as possible instead of in real time.
    #[arg(long)]
    free: bool,
    /// Size of picture and video.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = cosplat_console::size::size)]
    size: (u32, u32),
    /// Print one JSON object as the last line.
    #[arg(long)]
    json: bool,
}

/// Simulated seconds where nothing else is said.
const DURATION: f64 = 4.0;
/// The same of the collision of `--semantic` [s].
const COLLISION: f64 = 1.2;

/// Runs the command.
///
/// # Errors
/// When the scene cannot be used, a process fails, a file cannot be written, or the user interrupts.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let known = args.scene.as_deref().map(paper::find).transpose()?;
    let usual = known.as_ref().map_or(DURATION, |scene| scene.view.duration);
    let duration = args.duration.unwrap_or(usual);
    anyhow::ensure!(
        duration > 0.0,
        "--duration is 0, expected more: nothing would be seen"
    );
    let stop = signals::stop_flag()?;
    let bars = progress::parts();
    if args.semantic {
        let options = semantic::Options {
            folder: &args.out,
            duration: args.duration.unwrap_or(COLLISION),
            is_draft: args.draft,
            size: args.size,
        };
        let outcome = semantic::run(&options, &stop, &bars)?;
        drop(bars);
        return match args.json {
            true => say!("{}", serde_json::to_string(&outcome)?),
            false => say!("{}", outcome.sentence()),
        };
    }
    if let (Some(scene), Some(methods)) = (&known, &args.compare) {
        let comparison = Comparison {
            scene,
            splat: args.splat.as_deref(),
            methods,
            duration,
            size: args.size,
            folder: &args.out,
        };
        let compared = comparison.run(&stop, &bars)?;
        drop(bars);
        return match args.json {
            true => say!("{}", serde_json::to_string(&compared)?),
            false => say!("{}", compared.sentence()),
        };
    }
    let options = Options {
        scene: known.as_ref(),
        splat: args.splat.as_deref(),
        up: args.up.as_deref(),
        folder: &args.out,
        duration,
        free: args.free,
        size: args.size,
    };
    if args.web {
        return run::show(&options, &stop, &bars, |link| {
            say!("open {link} in a browser; Ctrl-C ends the demo")
        });
    }
    let outcome = run::run(&options, &stop, &bars)?;
    drop(bars);
    match args.json {
        true => say!("{}", serde_json::to_string(&outcome)?),
        false => say!("{}", outcome.sentence()),
    }
}
