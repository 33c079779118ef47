//! The renderer process: frames of a session in, pictures out, without ever holding the server up.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;
use std::time::Duration;

use cosplat_ipc::Domain;
use cosplat_ipc::client::{ConnectError, ReadError, StepError};

use crate::drawing::{Drawing, Look, Summary};
use crate::idle::IdleTime;
use crate::mp4::Mp4Error;
use crate::painter::paint;
use crate::png::PngError;
use crate::taker::Taker;

/// What to render.
#[derive(Clone, Debug)]
pub struct Options {
    /// Domain of the session.
    pub domain: Domain,
    /// Name of the session.
    pub session: String,
    /// How long to wait for the server to appear, and as long for its first frame and the scene of each of its runs.
    pub patience: Duration,
    /// What pictures show, and where they go.
    pub look: Look,
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
    /// Frames published since attaching and not drawn for lack of time.
    pub frames_missed: u64,
    /// Runs of the server seen.
    pub runs: u64,
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
    /// There is nothing of that name to follow.
    #[error("the scene has no object {name:?} to follow, expected one of {names}")]
    NoObject {
        /// The name asked for.
        name: String,
        /// Names of the objects that there are.
        names: String,
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
    /// The thread that draws cannot be started.
    #[error("cannot start the thread that draws: {0}")]
    Thread(std::io::Error),
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
/// was, and also after an error. `on_frame` hears of every frame that was rendered.
///
/// Frames are copied and drawn on processor time that nobody else wants, so that the server never waits. Those of steps that
/// were asked for (`look.every`) wait for their turn, up to 256 MiB of them; of the others the newest is taken. While the
/// simulation is slower than the clock, up to four times as long as a picture took passes before the next one. It stays when
/// the server goes, and carries on with the next one of that name. A participant in lock-step draws every step instead, at its
/// full priority, and the server waits for it.
///
/// # Errors
/// When there is no server, frame or scene within `options.patience`, the session ends before a scene could be read, or a
/// file cannot be written.
pub fn run(
    options: &Options,
    stop: &AtomicBool,
    on_frame: impl FnMut(&Progress) + Send,
) -> Result<Summary, RenderError> {
    let drawing = Drawing::begin(&options.look)?;
    let (hand_over, shots) = channel();
    let (give_back, painted) = channel();
    // From here, where priority is what it was.
    let time = options.participant.is_none().then(IdleTime::new);
    std::thread::scope(|scope| {
        let name = std::thread::Builder::new().name("painter".into());
        let painter = name.spawn_scoped(scope, move || {
            paint(drawing, time, &shots, &give_back, on_frame)
        });
        let painter = painter.map_err(RenderError::Thread)?;
        let mut taker = Taker::new(options, hand_over, painted);
        let watched = taker.watch(stop);
        let seen = taker.end();
        let painted = painter.join();
        let summary = painted.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        watched?;
        Ok(Summary {
            pictures: summary.pictures,
            last_picture: summary.last_picture,
            video: summary.video,
            video_frames: summary.video_frames,
            frames_rendered: summary.frames_rendered,
            render_ms: summary.render_ms,
            ..seen
        })
    })
}
