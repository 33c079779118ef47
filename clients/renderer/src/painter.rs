//! Draws the frames that it is handed, one after the other.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

use cosplat_ipc::schema::{FrameHeader, GaussianState};

use crate::client::{Progress, RenderError};
use crate::drawing::{Drawing, Scene, Summary};
use crate::idle::{IdleTime, give_way};
use crate::output::Wanted;

/// A frame that is to be drawn, in memory of its own.
pub(crate) struct Shot {
    pub header: FrameHeader,
    pub gaussians: Arc<Vec<GaussianState>>,
    pub scene: Arc<Scene>,
    pub wanted: Wanted,
    /// When it was taken.
    pub frames_missed: u64,
    pub runs: u64,
}

/// A frame that was drawn.
pub(crate) struct Painted {
    /// Its memory, to be used again.
    pub gaussians: Arc<Vec<GaussianState>>,
    /// How long that took.
    pub busy: Duration,
}

/// Draws `shots` until there are no more, and gives them back; in idle `time` where that is given, else at full priority.
/// `on_frame` hears of each.
///
/// # Errors
/// When a file cannot be written; what was drawn before is complete.
pub(crate) fn paint(
    mut drawing: Drawing,
    mut time: Option<IdleTime>,
    shots: &Receiver<Shot>,
    painted: &Sender<Painted>,
    mut on_frame: impl FnMut(&Progress),
) -> Result<Summary, RenderError> {
    if time.is_some() {
        give_way();
    }
    let mut draw_all = || -> Result<(), RenderError> {
        for shot in shots {
            let start = Instant::now();
            draw(&mut drawing, &shot, time.as_mut())?;
            on_frame(&Progress {
                step: shot.header.step,
                sim_time: shot.header.sim_time,
                frames_rendered: drawing.summary.frames_rendered,
                frames_missed: shot.frames_missed,
                runs: shot.runs,
            });
            let (gaussians, busy) = (shot.gaussians, start.elapsed());
            // After the last one nobody waits for it.
            let _ = painted.send(Painted { gaussians, busy });
        }
        Ok(())
    };
    let drawn = draw_all();
    let summary = drawing.finish()?;
    drawn?;
    Ok(summary)
}

fn draw(
    drawing: &mut Drawing,
    shot: &Shot,
    time: Option<&mut IdleTime>,
) -> Result<(), RenderError> {
    let look = drawing.look();
    let camera = look.camera_at(&shot.scene, &shot.header, &shot.gaussians)?;
    let (scene, gaussians) = (Arc::clone(&shot.scene), Arc::clone(&shot.gaussians));
    let is_shaded = look.is_shaded;
    let picture = move || scene.picture(&gaussians, &camera, is_shaded);
    drawing.draw(shot.wanted, shot.header.step, || match time {
        Some(time) => time.make(picture),
        None => picture(),
    })
}
