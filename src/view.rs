//! `cosplat view`: renders a running session, or a recording, to pictures and video.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::bail;
use cosplat_export::{
    film,
    reel::{Reel, Steps},
};
use cosplat_files::keep_apart;
use cosplat_ipc::{Domain, session_name};
use cosplat_renderer::client::Options;
use cosplat_renderer::drawing::{Look, Summary};

use crate::{camera_path, progress, say, seconds, signals, viewpoint::Viewpoint};

/// Render a running session to pictures and video, until its last frame or Ctrl-C; or a recording, every frame of it.
#[derive(clap::Args)]
pub struct Args {
    /// A recording to draw in place of a session.
    #[arg(value_name = "RUN.mcap", conflicts_with_all = ["session", "timeout", "frames", "participant"])]
    recording: Option<PathBuf>,
    /// Which run of the recording, counted from 1; needed where it holds several.
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    /// Session to watch.
    #[arg(long, default_value = "default", value_parser = session_name)]
    session: String,
    /// Seconds to wait for the server, and as long for what it needs to draw.
    #[arg(long, value_name = "S", default_value = "10", value_parser = seconds::duration)]
    timeout: Duration,
    /// Folder for pictures, named by their step.
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// A picture of every such many steps, exactly [default: of a session as many as there is time for, of a recording all].
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    every: Option<u64>,
    /// Video file (H.264), in simulated time.
    #[arg(long, value_name = "FILE")]
    mp4: Option<PathBuf>,
    /// Video frames per simulated second [default: 30; of a recording as many as it has].
    #[arg(long)]
    fps: Option<f64>,
    #[command(flatten)]
    viewpoint: Viewpoint,
    /// The camera turns around the up axis, by so much per simulated second [degrees/s].
    #[arg(
        long,
        default_value_t = 0.0,
        value_name = "DEG",
        allow_negative_numbers = true
    )]
    orbit: f32,
    /// Object that the camera looks at, wherever that goes.
    #[arg(long, value_name = "OBJECT", conflicts_with = "target")]
    follow: Option<String>,
    /// Camera path: keys with eye, look_at, up and field of view at simulated times or steps, in TOML or JSON.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["orbit", "azimuth", "elevation", "distance", "target"])]
    path: Option<PathBuf>,
    /// Shade on what stands still, below what moves.
    #[arg(long)]
    shade: bool,
    /// Stop after this many rendered frames.
    #[arg(long)]
    frames: Option<u64>,
    /// Take part in lock-step under this name: every step waits until it is drawn (`cosplat serve --pace lockstep`).
    #[arg(long, value_name = "NAME")]
    participant: Option<String>,
    /// Serve a page that shows the session, or the recording, in a browser and takes orders, and print its link: at this
    /// address, on a free port of this machine without.
    #[arg(
        long,
        value_name = "ADDR",
        num_args = 0..=1,
        default_missing_value = "127.0.0.1:0",
        value_parser = page,
        conflicts_with_all = ["png", "mp4", "frames", "participant", "json", "path"]
    )]
    web: Option<Page>,
    /// The page takes no orders.
    #[arg(long, requires = "web")]
    read_only: bool,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

/// What stands behind `--web`.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Page {
    /// Where to listen.
    At(SocketAddr),
    /// What to show, at a free port.
    Of(PathBuf),
}

/// `127.0.0.1:8000`, or the recording that was meant as the argument before.
fn page(text: &str) -> Result<Page, String> {
    match text.parse() {
        Ok(address) => Ok(Page::At(address)),
        Err(_) if Path::new(text).is_file() => Ok(Page::Of(text.into())),
        Err(_) => Err("expected ADDRESS:PORT, such as 127.0.0.1:8000, or a recording".into()),
    }
}

/// Runs the command.
///
/// # Errors
/// When there is no server or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let free = || SocketAddr::from(([127, 0, 0, 1], 0));
    match (&args.web, &args.recording) {
        (None, _) => {}
        (Some(Page::Of(other)), Some(path)) => {
            bail!(
                "one recording at a time: {} or {}",
                path.display(),
                other.display()
            )
        }
        (Some(Page::Of(path)), None) => {
            return crate::web::replay(free(), path, args.run, args.read_only);
        }
        (Some(Page::At(address)), Some(path)) => {
            return crate::web::replay(*address, path, args.run, args.read_only);
        }
        (Some(Page::At(address)), None) => {
            return crate::web::serve(*address, &args.session, args.timeout, args.read_only);
        }
    }
    if args.run.is_some() && args.recording.is_none() {
        bail!("--run says which run of a recording, and there is none: give RUN.mcap");
    }
    if args.png.is_none() && args.mp4.is_none() {
        bail!(
            "nothing to write: give --png DIR, --mp4 FILE or both, or --web for a page in the browser"
        );
    }
    if let (Some(video), Some(path)) = (&args.mp4, &args.path) {
        keep_apart(video, [path])?;
    }
    let summary = match &args.recording {
        Some(path) => draw_recording(args, path)?,
        None => watch_session(args)?,
    };
    report(args, &summary)
}

impl Args {
    /// # Errors
    /// When the camera path cannot be used.
    fn look(&self, usual_fps: f64) -> Result<Look, camera_path::PathFileError> {
        let path = self.path.as_deref().map(camera_path::read).transpose()?;
        Ok(Look {
            path,
            turning: self.orbit.to_radians(),
            follow: self.follow.clone(),
            is_shaded: self.shade,
            png: self.png.clone(),
            every: self.every.unwrap_or(0),
            mp4: self.mp4.clone(),
            fps: self.fps.unwrap_or(usual_fps),
            ..self.viewpoint.look()
        })
    }
}

fn draw_recording(args: &Args, path: &Path) -> anyhow::Result<Summary> {
    let stop = signals::stop_flag()?;
    let mut reel = open_reel(path, args.run, Steps::Every(1))?;
    let look = args.look(reel.scene.frame_rate)?;
    let bar = progress::bar("frames", reel.count() as u64);
    let summary = film::draw(&mut reel, &look, &stop, |step| {
        bar.inc(1);
        bar.set_message(format!("step {step}"));
    })?;
    bar.finish_and_clear();
    Ok(summary)
}

/// Opens a run of a recording, with a bar.
///
/// # Errors
/// When there is none, or it cannot be read.
pub fn open_reel(path: &Path, run: Option<usize>, steps: Steps) -> anyhow::Result<Reel> {
    let bar = progress::bar("looking through", 0);
    let reel = Reel::open(path, run, steps, |done, chunks| {
        bar.set_length(chunks as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    Ok(reel)
}

fn watch_session(args: &Args) -> anyhow::Result<Summary> {
    let stop = signals::stop_flag()?;
    let options = Options {
        domain: Domain::from_env()?,
        session: args.session.clone(),
        patience: args.timeout,
        look: args.look(30.0)?,
        frames: args.frames,
        participant: args.participant.clone(),
    };
    let bar = match args.frames {
        Some(frames) => progress::bar("frames", frames),
        None => progress::spinner("frames"),
    };
    let summary = cosplat_renderer::run(&options, &stop, |progress| {
        bar.set_position(progress.frames_rendered);
        bar.set_message(format!(
            "step {}, {:.2} s",
            progress.step, progress.sim_time
        ));
    });
    bar.finish_and_clear();
    Ok(summary?)
}

fn report(args: &Args, summary: &Summary) -> anyhow::Result<()> {
    if args.json {
        say!("{}", serde_json::to_string(summary)?)?;
        return Ok(());
    }
    say!(
        "{} frames rendered ({:.1} ms each), up to step {} at {:.3} s; {} left out for lack of time",
        summary.frames_rendered,
        summary.render_ms,
        summary.last_step,
        summary.sim_time,
        summary.frames_missed
    )?;
    if summary.pictures_missed > 0 {
        say!(
            "{} pictures are missing: more than 256 MiB of frames waited for theirs",
            summary.pictures_missed
        )?;
    }
    if let Some(path) = &summary.last_picture {
        say!(
            "{} pictures, the last one {}",
            summary.pictures,
            path.display()
        )?;
    }
    if let Some(path) = &summary.video {
        say!(
            "{} video frames in {}",
            summary.video_frames,
            path.display()
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_of_an_address_or_of_a_file_that_is_there() {
        let address = "127.0.0.1:8000".parse().expect("an address");
        assert_eq!(page("127.0.0.1:8000"), Ok(Page::At(address)));
        assert_eq!(page("Cargo.toml"), Ok(Page::Of("Cargo.toml".into())));
        assert!(page("no-such.mcap").is_err());
    }
}
