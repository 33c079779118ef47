//! What can go wrong with a recording, in sentences.

use std::path::{Path, PathBuf};

/// Why a recording could not be written, read or repaired.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The output exists and may not be overwritten.
    #[error("{path} exists already; choose another name or overwrite it with --force")]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A file could not be opened or created.
    #[error("cannot open {path}: {cause}")]
    Open {
        /// The file.
        path: PathBuf,
        /// The operating system's answer.
        cause: std::io::Error,
    },
    /// Writing failed, most often for a full disk. What was written before is kept and can be recovered.
    #[error(
        "cannot write to {path}: {}; the file ends here, `cosplat recover` makes it readable",
        sentence(cause)
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// The writer's answer.
        cause: mcap::McapError,
    },
    /// The file is not a complete, undamaged MCAP file.
    #[error(
        "{path} is damaged or unfinished: {}; `cosplat recover` saves what is readable",
        sentence(cause)
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The reader's answer.
        cause: mcap::McapError,
    },
    /// The file is no MCAP file at all.
    #[error(
        "{path} is not an MCAP file: it starts with {found:02x?}, an MCAP file with {expected:02x?}"
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// Its first bytes, at most 8.
        found: Vec<u8>,
        /// The first bytes of every MCAP file.
        expected: [u8; 8],
    },
    /// A message is not what its topic promises.
    #[error("{path}: message {sequence} of {topic} is malformed: {why}")]
    Message {
        /// The file.
        path: PathBuf,
        /// Topic of the message.
        topic: String,
        /// Sequence number of the message (the low 32 bits of its step).
        sequence: u32,
        /// What was expected and what was found.
        why: String,
    },
    /// Input and output of a recovery are the same file.
    #[error("cannot recover {path} onto itself; choose another output")]
    SameFile {
        /// The file.
        path: PathBuf,
    },
}

impl RecordingError {
    /// For failures of [`std::fs`] calls on `path`.
    pub(crate) fn open(path: &Path, cause: std::io::Error) -> Self {
        if cause.kind() == std::io::ErrorKind::AlreadyExists {
            Self::Exists { path: path.into() }
        } else {
            Self::Open {
                path: path.into(),
                cause,
            }
        }
    }

    pub(crate) fn write(path: &Path, cause: impl Into<mcap::McapError>) -> Self {
        Self::Write {
            path: path.into(),
            cause: cause.into(),
        }
    }

    pub(crate) fn damaged(path: &Path, cause: impl Into<mcap::McapError>) -> Self {
        Self::Damaged {
            path: path.into(),
            cause: cause.into(),
        }
    }
}

/// The cause in words: the first one, for what the library says of an error of the system does not name the system's answer.
fn sentence(error: &mcap::McapError) -> String {
    let mut cause: &dyn std::error::Error = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}
