//! The renderer process: frames of a session in, pictures out, without ever holding the server up.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cosplat_ipc::Domain;
use cosplat_ipc::client::{ConnectError, Frame, ReadError, SceneView, StepError};
use cosplat_ipc::schema::{FRAME_FLAG_LAST, SceneHeader};
use glam::Vec3;
use serde::Serialize;

use crate::camera::{Camera, Orbit, up_from_gravity};
use crate::courtesy::Courtesy;
use crate::mp4::Mp4Error;
use crate::output::{Outputs, Written};
use crate::png::PngError;
use crate::source::Source;
use crate::{Harmonics, Projected};

/// Colour behind the splats, sRGB: light enough to show dark ones, dark enough to show white ones.
pub const BACKGROUND: [f32; 3] = [0.93; 3];

/// What to render, and where to.
#[derive(Clone, Debug)]
pub struct Options {
    /// Domain of the session.
    pub domain: Domain,
    /// Name of the session.
    pub session: String,
    /// How long to wait for the server to appear, and as long for its first frame and the scene of each of its runs.
    pub patience: Duration,
    /// Pixels per row, 1..=16384 (a video: 16..=3840).
    pub width: u32,
    /// Rows, 1..=16384 (a video: 16..=2160).
    pub height: u32,
    /// Where to look from; the scene's bounds and gravity fill in the rest.
    pub orbit: Orbit,
    /// Folder for `frame_STEP.png` files.
    pub png: Option<PathBuf>,
    /// A PNG file for the first frame of every such many steps; 0 counts as 1.
    pub every: u64,
    /// Video file.
    pub mp4: Option<PathBuf>,
    /// Video frames per simulated second, 1..=1000.
    pub fps: f64,
    /// Stop after this many rendered frames.
    pub frames: Option<u64>,
    /// Name under which it takes part in lock-step: then no step is made before its picture is.
    pub participant: Option<String>,
}

/// State of the work after a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Step of the frame.
    pub step: u64,
    /// Its simulated time [s].
    pub sim_time: f64,
    /// Frames rendered so far.
    pub frames_rendered: u64,
    /// Frames published since attaching and not looked at, because a newer one was there.
    pub frames_missed: u64,
    /// Runs of the server seen.
    pub runs: u64,
}

/// What a run of the renderer did.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Frames rendered.
    pub frames_rendered: u64,
    /// Frames published since attaching and not looked at, because a newer one was there.
    pub frames_missed: u64,
    /// Runs of the server seen: more than 1 after a restart.
    pub runs: u64,
    /// Step of the last frame.
    pub last_step: u64,
    /// Simulated time of the last frame [s].
    pub sim_time: f64,
    /// Mean time to render a frame [ms], without waiting and encoding.
    pub render_ms: f64,
    /// PNG files written.
    pub pictures: u64,
    /// The newest of them.
    pub last_picture: Option<PathBuf>,
    /// The video, if it has any frame.
    pub video: Option<PathBuf>,
    /// Its frames.
    pub video_frames: u64,
}

/// Why rendering ended early.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// No server, or none that we understand.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The server went before its frames could be drawn.
    #[error("session {session:?} ended before a picture of it could be drawn: {reason}")]
    Ended {
        /// Name of the session.
        session: String,
        /// What was missing.
        reason: String,
    },
    /// It may not take part in lock-step.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The frames cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A picture cannot be written.
    #[error(transparent)]
    Png(#[from] PngError),
    /// The video cannot be written.
    #[error(transparent)]
    Mp4(#[from] Mp4Error),
    /// A folder cannot be made.
    #[error("cannot make the folder {path}: {cause}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
}

/// Renders the session of `options` until its last frame, `options.frames`, or `stop`; files are complete whichever it
/// was, and also after an error. `on_scene` is called once, with all there is to draw and nothing drawn yet: from then on
/// the work may be given a lower priority. `on_frame` hears of every frame that was rendered.
///
/// It always takes the newest frame, so that a slow renderer skips frames and the server never waits; it stays when the
/// server goes, and carries on with the next one of that name. While the simulation is slower than the clock it waits up to
/// four times as long as a picture took before the next one. A participant in lock-step draws every step instead, and the
/// server waits for it.
///
/// # Errors
/// When there is no server, frame or scene within `options.patience`, the session ends before a scene could be read, or a
/// file cannot be written.
pub fn run(
    options: &Options,
    stop: &AtomicBool,
    on_scene: impl FnOnce(),
    on_frame: impl FnMut(&Progress),
) -> Result<Summary, RenderError> {
    let mut outputs = Outputs::open(options)?;
    let mut summary = Summary::default();
    let watched = watch(
        options,
        stop,
        &mut outputs,
        &mut summary,
        on_scene,
        on_frame,
    );
    let Written {
        pictures,
        last_picture,
        video,
        video_frames,
    } = outputs.finish()?;
    watched?;
    if summary.frames_rendered > 0 {
        summary.render_ms /= summary.frames_rendered as f64;
    }
    Ok(Summary {
        pictures,
        last_picture,
        video,
        video_frames,
        ..summary
    })
}

/// The loop of [`run`]; adds up the time of rendering in `render_ms`.
fn watch(
    options: &Options,
    stop: &AtomicBool,
    outputs: &mut Outputs,
    summary: &mut Summary,
    on_scene: impl FnOnce(),
    mut on_frame: impl FnMut(&Progress),
) -> Result<(), RenderError> {
    let Some(mut source) = Source::attach(options, stop)? else {
        return Ok(());
    };
    let mut on_scene = Some(on_scene);
    let mut courtesy = Courtesy::default();
    let goal = options.frames.unwrap_or(u64::MAX);
    while summary.frames_rendered < goal && !stop.load(Ordering::Relaxed) {
        let Some(next) = source.next()? else {
            // Of a frame that found no memory there is nothing to draw: the step goes without a picture.
            if source.is_over()? || !source.permit_step(stop)? {
                break;
            }
            continue;
        };
        let start = Instant::now();
        let header = *next.frame.header();
        courtesy.note(header.sim_time, header.publish_ns);
        let Some((next, scene)) = source.with_scene(next)? else {
            continue;
        };
        if let Some(on_scene) = on_scene.take() {
            on_scene();
        }
        let is_last = header.flags & FRAME_FLAG_LAST != 0;
        let wanted = outputs.wants(header.step, header.sim_time, next.is_new_run, is_last);
        if wanted.anything() {
            let camera = camera(options, scene.header());
            let drawing = Instant::now();
            let projected = project(next.frame, scene, &camera);
            let image = projected.draw(BACKGROUND);
            summary.render_ms += drawing.elapsed().as_secs_f64() * 1e3;
            outputs.write(wanted, header.step, image)?;
            summary.frames_rendered += 1;
        } else {
            drop(next);
        }
        summary.frames_missed = source.missed();
        summary.runs = source.frames.runs();
        summary.last_step = header.step;
        summary.sim_time = header.sim_time;
        if wanted.anything() {
            on_frame(&Progress {
                step: header.step,
                sim_time: header.sim_time,
                frames_rendered: summary.frames_rendered,
                frames_missed: summary.frames_missed,
                runs: summary.runs,
            });
        }
        if is_last || summary.frames_rendered >= goal || !source.permit_step(stop)? {
            break;
        }
        if wanted.anything() && options.participant.is_none() {
            std::thread::sleep(courtesy.wait(start.elapsed()));
        }
    }
    Ok(())
}

/// Takes from the frame what the picture needs, and gives its memory back.
fn project(frame: Frame, scene: &SceneView, camera: &Camera) -> Projected {
    // Without directional coefficients the frame's own colour says it all.
    let sh = match scene.header().sh_degree {
        0 => None,
        degree => Harmonics::new(degree, scene.sh()),
    };
    Projected::new(frame.gaussians(), sh, camera)
}

/// The camera for a scene.
pub fn camera(options: &Options, scene: &SceneHeader) -> Camera {
    Camera::orbit(
        [
            Vec3::from_array(scene.bounds_min),
            Vec3::from_array(scene.bounds_max),
        ],
        up_from_gravity(scene.gravity),
        options.orbit,
        options.width,
        options.height,
    )
}
