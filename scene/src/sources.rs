//! The files that a scene was made of, so that a recorder can keep them.

use std::{
    path::{Path, PathBuf, absolute},
    sync::Arc,
};

use xxhash_rust::xxh3::xxh3_64;

/// What a file was read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceKind {
    /// A splat or mesh that the scene file names.
    Asset,
    /// The checkpoint that the run began with.
    Checkpoint,
}

/// A file that was read beside the scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// What for.
    pub kind: SourceKind,
    /// As the scene file names it; the file name of a checkpoint.
    pub name: String,
    /// Where it lies, absolute.
    pub path: PathBuf,
    /// Length of its content [byte].
    pub bytes: u64,
    /// XXH3 of its content, 64 bits, seed 0.
    pub hash: u64,
}

/// The content of a file that need not lie on a disk.
#[derive(Clone, Debug)]
pub struct HeldFile {
    /// Where a copy of it lies, or what names it in messages.
    pub path: PathBuf,
    /// Its bytes.
    pub content: Arc<[u8]>,
}

impl SourceFile {
    /// The file at `path` with the `content` that was read there.
    pub fn of(kind: SourceKind, name: &str, path: &Path, content: &[u8]) -> SourceFile {
        SourceFile {
            kind,
            name: name.to_owned(),
            // Only an empty path cannot be made absolute, and that is no file.
            path: absolute(path).unwrap_or_else(|_| path.to_owned()),
            bytes: content.len() as u64,
            hash: xxh3_64(content),
        }
    }
}
