//! `cosplat view`: renders a running session to pictures and video.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::bail;
use cosplat_ipc::Domain;
use cosplat_renderer::camera::Orbit;
use cosplat_renderer::client::Options;

use crate::{progress, say, seconds, signals};

/// Render a running session to pictures and video, until its last frame or Ctrl-C.
#[derive(clap::Args)]
pub struct Args {
    /// Session to watch.
    #[arg(long, default_value = "default")]
    session: String,
    /// Seconds to wait for the server, and as long for what it needs to draw.
    #[arg(long, value_name = "S", default_value = "10", value_parser = seconds::duration)]
    timeout: Duration,
    /// Folder for pictures, named by their step.
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// A picture for every such many steps.
    #[arg(long, default_value_t = 1, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,
    /// Video file (H.264), in simulated time.
    #[arg(long, value_name = "FILE")]
    mp4: Option<PathBuf>,
    /// Video frames per simulated second.
    #[arg(long, default_value_t = 30.0)]
    fps: f64,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = size)]
    size: (u32, u32),
    /// Camera's angle around the up axis, anticlockwise from above [degrees].
    #[arg(long, default_value_t = 35.0, allow_negative_numbers = true)]
    azimuth: f32,
    /// Camera's angle above the horizon [degrees].
    #[arg(long, default_value_t = 20.0, allow_negative_numbers = true)]
    elevation: f32,
    /// Camera's distance from the target [m; default: the whole scene is seen].
    #[arg(long)]
    distance: Option<f32>,
    /// Point X Y Z looked at [m; default: centre of the scene].
    #[arg(long, num_args = 3, allow_negative_numbers = true)]
    target: Option<Vec<f32>>,
    /// Stop after this many rendered frames.
    #[arg(long)]
    frames: Option<u64>,
    /// Take part in lock-step under this name: every step waits until it is drawn (`cosplat serve --pace lockstep`).
    #[arg(long, value_name = "NAME")]
    participant: Option<String>,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Priority given up: all of it.
const NICENESS: i32 = 19;

/// Runs the command.
///
/// # Errors
/// When there is no server or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.png.is_none() && args.mp4.is_none() {
        bail!("nothing to write: give --png DIR, --mp4 FILE or both");
    }
    let stop = signals::stop_flag()?;
    let options = Options {
        domain: Domain::from_env()?,
        session: args.session.clone(),
        patience: args.timeout,
        width: args.size.0,
        height: args.size.1,
        orbit: Orbit {
            azimuth: args.azimuth.to_radians(),
            elevation: args.elevation.to_radians(),
            distance: args.distance,
            target: args
                .target
                .as_deref()
                .and_then(|point| <[f32; 3]>::try_from(point).ok())
                .map(Into::into),
        },
        png: args.png.clone(),
        every: args.every,
        mp4: args.mp4.clone(),
        fps: args.fps,
        frames: args.frames,
        participant: args.participant.clone(),
    };
    let bar = match args.frames {
        Some(frames) => progress::bar("frames", frames),
        None => progress::spinner("frames"),
    };
    // Drawing takes every core it gets; the simulation and its other readers come first. Not before there is something to
    // draw: on a busy machine a process without priority would not get that far.
    let is_waited_for = args.participant.is_some();
    let stand_aside = || {
        if is_waited_for {
            return;
        }
        if let Err(error) = rustix::process::nice(NICENESS) {
            tracing::debug!(%error, "keeps its priority");
        }
    };
    let summary = cosplat_renderer::run(&options, &stop, stand_aside, |progress| {
        bar.set_position(progress.frames_rendered);
        bar.set_message(format!(
            "step {}, {:.2} s",
            progress.step, progress.sim_time
        ));
    });
    bar.finish_and_clear();
    let summary = summary?;
    if args.json {
        say!("{}", serde_json::to_string(&summary)?)?;
        return Ok(());
    }
    say!(
        "{} frames rendered ({:.1} ms each), up to step {} at {:.3} s; {} skipped for newer ones",
        summary.frames_rendered,
        summary.render_ms,
        summary.last_step,
        summary.sim_time,
        summary.frames_missed
    )?;
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

/// `640x480`.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |part: &str| {
        part.parse::<u32>()
            .ok()
            .filter(|n| (1..=16_384).contains(n))
    };
    text.split_once('x')
        .and_then(|(width, height)| Some((parse(width)?, parse(height)?)))
        .ok_or_else(|| {
            format!(
                "expected WIDTHxHEIGHT in pixels from 1 to 16384, such as 640x480, not {text:?}"
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_or_refused_in_a_sentence() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["640", "0x10", "10x", "-1x5", "99999x2", "4x4x4"] {
            assert!(size(bad).unwrap_err().contains(bad));
        }
    }
}
