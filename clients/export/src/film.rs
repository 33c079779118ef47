//! Pictures and a film of a recording: every step that they need, as fast as the machine draws.

use std::sync::atomic::{AtomicBool, Ordering};

use cosplat_renderer::drawing::{Drawing, Look, Scene, Summary};

use crate::{ExportError, reel::Reel};

/// Draws a reel until its end, or `stop`; files are complete in either case. `passed` hears of every step.
///
/// # Errors
/// When the recording cannot be read or a file cannot be written or is the recording; what was drawn before is complete.
pub fn draw(
    reel: &mut Reel,
    look: &Look,
    stop: &AtomicBool,
    mut passed: impl FnMut(u64),
) -> Result<Summary, ExportError> {
    if let Some(path) = &look.mp4 {
        reel.keep_apart(path)?;
    }
    let mut drawing = Drawing::begin(look)?;
    let scene = Scene {
        header: reel.scene,
        objects: reel.objects.clone(),
        sh: reel.sh.clone(),
    };
    let mut draw_all = || -> Result<(), ExportError> {
        let mut is_first = true;
        while !stop.load(Ordering::Relaxed) {
            let Some(step) = reel.next(&mut passed)? else {
                break;
            };
            let frame = step.frame;
            drawing.show(&frame.header, is_first, &scene, &frame.gaussians)?;
            is_first = false;
        }
        Ok(())
    };
    let drawn = draw_all();
    let summary = drawing.finish()?;
    drawn?;
    Ok(Summary { runs: 1, ..summary })
}
