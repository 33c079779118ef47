//! Why a recording cannot be exported, in sentences.

use std::path::PathBuf;

use cosplat_recorder::RecordingError;
use cosplat_renderer::client::RenderError;
use cosplat_replay::ReplayError;

/// Why a recording cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// It has no such run, or its scene cannot be read.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// A step cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A picture or a film cannot be written.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// It has no step.
    #[error("{} holds no step of run {epoch:016x}", path.display())]
    NoSteps {
        /// The recording.
        path: PathBuf,
        /// The run's epoch.
        epoch: u64,
    },
    /// It does not have that step.
    #[error("{} has no step {step}, expected one of {first} to {last}", path.display())]
    NoStep {
        /// The recording.
        path: PathBuf,
        /// The step asked for.
        step: u64,
        /// The first that is there.
        first: u64,
        /// The last that is there.
        last: u64,
    },
    /// A frame names a Gaussian that the scene does not have.
    #[error("a frame of step {step} has Gaussian number {index}, expected less than {count}")]
    Gaussian {
        /// Step of the frame.
        step: u64,
        /// Number of the Gaussian.
        index: u32,
        /// Gaussians of the scene.
        count: usize,
    },
    /// A step has no places of objects.
    #[error("step {step} has {found} places of objects, expected {expected}: nothing can move")]
    Objects {
        /// The step.
        step: u64,
        /// Objects that are told.
        found: usize,
        /// Objects of the scene.
        expected: usize,
    },
    /// The file is too large for its format.
    #[error(
        "the scene needs {bytes} bytes, a .glb file holds at most {most}: choose fewer steps with --every"
    )]
    TooLarge {
        /// What it needs [byte].
        bytes: u64,
        /// What there may be [byte].
        most: u64,
    },
    /// The Python package cannot write it.
    #[error("{program}, which is to write USD (COSPLAT_PYTHON names another one), failed: {words}")]
    Python {
        /// The interpreter.
        program: String,
        /// Its last words.
        words: String,
    },
    /// The output is the recording.
    #[error(transparent)]
    OntoInput(#[from] cosplat_files::OntoInput),
    /// A file cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
}

impl ExportError {
    pub(crate) fn python(program: &std::ffi::OsStr, words: &str) -> Self {
        Self::Python {
            program: program.to_string_lossy().into_owned(),
            words: words.to_owned(),
        }
    }

    /// For failures of [`std::fs`] calls on `path`.
    pub(crate) fn write(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        |cause| Self::Write { path, cause }
    }
}
