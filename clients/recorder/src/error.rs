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
    #[error("{path} is damaged or unfinished: {cause}; `cosplat recover` saves what is readable")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        cause: Damage,
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
    /// What was written does not read back as it was.
    #[error(
        "{path} does not come back as it was after {messages} messages: the disk or this program is at fault"
    )]
    NotTheSame {
        /// The file.
        path: PathBuf,
        /// Messages that are the same.
        messages: u64,
    },
    /// Input and output are the same file.
    #[error(transparent)]
    OntoInput(#[from] cosplat_files::OntoInput),
}

/// What is wrong with a damaged file.
#[derive(Debug, thiserror::Error)]
pub enum Damage {
    /// Something that the reader of the container found.
    #[error("{}", sentence(.0))]
    Container(mcap::McapError),
    /// A record does not end within its chunk.
    #[error(
        "a record with opcode {opcode:#04x} is {length} bytes long, its chunk has {available} left"
    )]
    RecordLength {
        /// Kind of the record.
        opcode: u8,
        /// Its length as the file says [byte].
        length: u64,
        /// What is left of the chunk [byte].
        available: u64,
    },
    /// A chunk is packed smaller than a recording can be.
    #[error(
        "a chunk of {packed} bytes unpacks to {size}, expected at most {most} in a file of this length"
    )]
    Bomb {
        /// Its length in the file [byte].
        packed: u64,
        /// Its length as its header says [byte].
        size: u64,
        /// What a chunk of the file may have [byte].
        most: u64,
    },
}

impl From<mcap::McapError> for Damage {
    fn from(error: mcap::McapError) -> Self {
        Self::Container(error)
    }
}

impl From<std::io::Error> for Damage {
    fn from(error: std::io::Error) -> Self {
        Self::Container(error.into())
    }
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

    pub(crate) fn damaged(path: &Path, cause: impl Into<Damage>) -> Self {
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
