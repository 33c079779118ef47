//! One run of a recording: its scene at rest, and its steps.

use std::path::{Path, PathBuf};

use cosplat_ipc::schema::{GaussianRest, ObjectInfo, SceneHeader};
use cosplat_recorder::{
    chunks::Chunks,
    tape::{Tape, TapeStep},
    topics::{SCENE_GAUSSIANS, SCENE_OBJECTS, SCENE_SH},
};
use cosplat_replay::rerun::take;

use crate::ExportError;

/// Which steps are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Steps {
    /// The first, and every such many steps after it; 0 counts as 1.
    Every(u64),
    /// One.
    Only(u64),
}

/// A run of a recording.
pub struct Reel {
    /// The scene as it was published.
    pub scene: SceneHeader,
    /// Its Gaussians at rest.
    pub gaussians: Vec<GaussianRest>,
    /// Its objects.
    pub objects: Vec<ObjectInfo>,
    /// Spherical harmonics `[gaussian][coefficient][rgb]`.
    pub sh: Vec<f32>,
    tape: Tape,
    path: PathBuf,
    steps: Steps,
    range: [u64; 2],
}

impl Reel {
    /// Opens run number `run` of a recording, counted from 1, or the only one. `progress` is told how many chunks of how
    /// many were looked through.
    ///
    /// # Errors
    /// When there is no such run, it has no such step, or the recording cannot be read.
    pub fn open(
        path: &Path,
        run: Option<usize>,
        steps: Steps,
        progress: impl FnMut(usize, usize),
    ) -> Result<Self, ExportError> {
        let mut chunks = Chunks::open(path).map_err(ExportError::from)?;
        let taken = take(&mut chunks, path, run)?;
        let scene = taken.header.scene;
        let tape = Tape::open(chunks, scene.epoch, progress)?;
        let path = path.to_owned();
        let Some(range) = tape.range() else {
            let epoch = scene.epoch;
            return Err(ExportError::NoSteps { path, epoch });
        };
        let mut reel = Self {
            scene,
            gaussians: taken.items(SCENE_GAUSSIANS)?,
            objects: taken.items(SCENE_OBJECTS)?,
            sh: taken.items(SCENE_SH)?,
            tape,
            path,
            steps,
            range,
        };
        if let Steps::Only(step) = steps
            && reel.tape.seek(step) != Some(step)
        {
            let ([first, last], path) = (range, reel.path);
            return Err(ExportError::NoStep {
                path,
                step,
                first,
                last,
            });
        }
        Ok(reel)
    }

    /// Makes sure that an output is not the recording itself.
    ///
    /// # Errors
    /// When it is.
    pub(crate) fn keep_apart(&self, output: &Path) -> Result<(), ExportError> {
        Ok(cosplat_files::keep_apart(output, [&self.path])?)
    }

    /// Steps that are recorded, or 1 where only one is wanted.
    pub fn count(&self) -> usize {
        match self.steps {
            Steps::Every(_) => self.tape.count(),
            Steps::Only(_) => 1,
        }
    }

    /// Coefficients of one Gaussian's colour, each of three numbers; 0 where the recording has none.
    pub fn coefficients(&self) -> usize {
        let bands = self.scene.sh_degree.min(3) as usize + 1;
        let has_all = self.sh.len() == 3 * bands * bands * self.gaussians.len();
        if has_all { bands * bands } else { 0 }
    }

    /// The next step that is wanted; `passed` hears of every step that was read.
    ///
    /// # Errors
    /// When it cannot be read, or names Gaussians that the scene does not have.
    pub fn next(&mut self, mut passed: impl FnMut(u64)) -> Result<Option<TapeStep>, ExportError> {
        let mut before = None;
        while let Some(taken) = self.tape.advance()? {
            let step = taken.frame.header.step;
            passed(step);
            let is_wanted = match self.steps {
                Steps::Every(every) => (step - self.range[0]).is_multiple_of(every.max(1)),
                Steps::Only(only) if step == only && before.is_none() => true,
                Steps::Only(_) => return Ok(None),
            };
            before = Some(step);
            if !is_wanted {
                continue;
            }
            let count = self.gaussians.len();
            let stranger = taken.frame.gaussians.iter().map(|g| g.index);
            if let Some(index) = stranger.into_iter().find(|index| *index as usize >= count) {
                return Err(ExportError::Gaussian { step, index, count });
            }
            return Ok(Some(taken));
        }
        Ok(None)
    }
}
