//! A sequence of splat files: one `.ply` per step, in the layout that every splat viewer opens.

use std::{
    io::Write,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use cosplat_ipc::schema::{GaussianRest, GaussianState};
use cosplat_recorder::ply::PlyScene;
use glam::Quat;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    ExportError,
    harmonics::Turner,
    reel::Reel,
    shapes::{Shapes, unit},
};

/// Colour of the constant harmonic: `0.5 + C0 c`.
const C0: f32 = 0.282_094_8;

/// What was written.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Sequence {
    /// Files.
    pub files: u64,
    /// Their bytes.
    pub bytes: u64,
    /// The last of them.
    pub last: Option<PathBuf>,
}

/// Writes `step_NNNNNNNN.ply` for every step of a reel into `folder`, until its end or `stop`. A file that is there is
/// complete: it gets its name last. `passed` hears of every step.
///
/// # Errors
/// When the recording cannot be read or a file cannot be written.
pub fn write_sequence(
    reel: &mut Reel,
    folder: &Path,
    stop: &AtomicBool,
    mut passed: impl FnMut(u64),
) -> Result<Sequence, ExportError> {
    std::fs::create_dir_all(folder).map_err(ExportError::write(folder))?;
    let mut shapes = Shapes::new(&reel.gaussians);
    let mut written = Sequence::default();
    while !stop.load(Ordering::Relaxed) {
        let Some(step) = reel.next(&mut passed)? else {
            break;
        };
        let gaussians = shapes.at(&step.frame.gaussians);
        let sh = colors(reel, &step.frame.gaussians, None);
        let scene = PlyScene {
            gaussians: &gaussians,
            sh_degree: reel.scene.sh_degree,
            sh: &sh,
        };
        let path = folder.join(format!("step_{:08}.ply", step.frame.header.step));
        reel.keep_apart(&path)?;
        cosplat_files::write_with(&path, |file| scene.encode(|piece| file.write_all(piece)))
            .map_err(ExportError::write(&path))?;
        written.files += 1;
        written.bytes += scene.encoded_len();
        written.last = Some(path);
    }
    Ok(written)
}

/// Colours of a step `[gaussian][coefficient][rgb]` in the world frame, in the order of the scene; where the recording has no
/// harmonics, what is seen of them in the frame. `turned_back` is a rotation that is taken away again from those of one
/// object, by its id.
pub(crate) fn colors(
    reel: &Reel,
    gaussians: &[GaussianState],
    turned_back: Option<&[Quat]>,
) -> Vec<f32> {
    let count = reel.coefficients();
    if count == 0 {
        let bands = reel.scene.sh_degree.min(3) as usize + 1;
        let mut plain = vec![0.0; 3 * bands * bands * reel.gaussians.len()];
        for gaussian in gaussians {
            let first = gaussian.index as usize * 3 * bands * bands;
            for (value, level) in plain[first..first + 3].iter_mut().zip(gaussian.color) {
                *value = (f32::from(level) / 255.0 - 0.5) / C0;
            }
        }
        return plain;
    }
    let mut colors = reel.sh.clone();
    if count == 1 {
        return colors;
    }
    let mut rotations = vec![Quat::IDENTITY; reel.gaussians.len()];
    for gaussian in gaussians {
        let rotation = unit(gaussian.rotation).as_quat();
        let back = turned_back.and_then(|back| back.get(gaussian.object as usize));
        rotations[gaussian.index as usize] = back.map_or(rotation, |back| *back * rotation);
    }
    let turner = Turner::new(count);
    let all = colors.par_chunks_mut(3 * count).zip(rotations);
    all.for_each(|(color, rotation)| turner.turn(color, rotation));
    colors
}

/// Whether a Gaussian can be shown at all.
pub(crate) fn is_shown(gaussian: &GaussianRest) -> bool {
    let numbers = gaussian
        .position
        .iter()
        .chain(&gaussian.scale)
        .chain(&gaussian.rotation);
    gaussian.opacity > 0.0 && numbers.clone().all(|x| x.is_finite())
}
