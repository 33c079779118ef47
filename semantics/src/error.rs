//! Why views, masks or files of objects are refused, in sentences.

use std::path::{Path, PathBuf};

use cosplat_files::reading;

/// Why views, masks or a file of objects are refused.
#[derive(Debug, thiserror::Error)]
pub enum SemanticsError {
    /// A file cannot be read.
    #[error("cannot read {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// A file cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("{}: {why}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        why: String,
    },
    /// A camera bends its picture.
    #[error(
        "{}: camera {camera} has model {model}, expected PINHOLE or SIMPLE_PINHOLE: undistort the pictures with \
         `colmap image_undistorter --image_path images --input_path sparse/0 --output_path undistorted`",
        path.display()
    )]
    Distorted {
        /// The file.
        path: PathBuf,
        /// The camera, as the file names it.
        camera: String,
        /// Its model, or the coefficient that is not 0.
        model: String,
    },
    /// No view has masks.
    #[error(
        "{} has masks for none of the {views} views: expected files such as {example}.png",
        folder.display()
    )]
    NoMasks {
        /// Where they were looked for.
        folder: PathBuf,
        /// Views.
        views: usize,
        /// The first view's name.
        example: String,
    },
    /// A file of objects.
    #[error(transparent)]
    Objects(#[from] cosplat_scene::assets::objects::ObjectsError),
}

impl SemanticsError {
    pub(crate) fn format(path: &Path, why: impl Into<String>) -> Self {
        Self::Format {
            path: path.to_owned(),
            why: why.into(),
        }
    }

    /// The content of a file of data.
    pub(crate) fn content(path: &Path) -> Result<Vec<u8>, Self> {
        reading::read(path, reading::LARGEST_DATA).map_err(Self::read(path))
    }

    pub(crate) fn read(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        |cause| Self::Read { path, cause }
    }

    pub(crate) fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        |cause| Self::Write { path, cause }
    }
}
