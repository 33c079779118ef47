//! Why networks, pictures or words are refused, in sentences.

use std::path::{Path, PathBuf};

use cosplat_semantics::SemanticsError;

/// Why networks, pictures or words are refused.
#[derive(Debug, thiserror::Error)]
pub enum FeaturesError {
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
    /// A file beside a network does not say what is needed.
    #[error("{}: {why}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        why: String,
    },
    /// A network cannot be loaded.
    #[error("{}: no network that can be run: {why}", path.display())]
    Load {
        /// The file.
        path: PathBuf,
        /// The runtime's reason.
        why: String,
    },
    /// A network has no input or output of this name.
    #[error("{} has no {kind} {name:?}, expected one of {}", path.display(), known.join(", "))]
    Name {
        /// The network.
        path: PathBuf,
        /// `input` or `output`.
        kind: &'static str,
        /// The name.
        name: String,
        /// Names that there are.
        known: Vec<String>,
    },
    /// A network does not run.
    #[error("{}: does not run: {why}", path.display())]
    Run {
        /// The network.
        path: PathBuf,
        /// The runtime's reason.
        why: String,
    },
    /// What comes out of a network has another shape.
    #[error("{}: output {name:?} {why}", path.display())]
    Output {
        /// The network.
        path: PathBuf,
        /// The output.
        name: String,
        /// What was expected and what was found.
        why: String,
    },
    /// A file is no picture that can be read.
    #[error("{}: {why}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        why: String,
    },
    /// There is no picture.
    #[error("{} has no pictures: expected .png, .jpg or .jpeg", folder.display())]
    NoPictures {
        /// Where they were looked for.
        folder: PathBuf,
    },
    /// Two pictures differ in the ends of their names alone.
    #[error("{} and {} are both called {name:?}: results have the picture's name", first.display(), second.display())]
    SameName {
        /// One picture.
        first: PathBuf,
        /// The other.
        second: PathBuf,
        /// Their name.
        name: String,
    },
    /// A folder has results of other networks.
    #[error("{} has results of {found}, not of {expected}: choose another folder, or remove this one", folder.display())]
    OtherNetwork {
        /// The folder.
        folder: PathBuf,
        /// Hashes of the networks whose results are there.
        found: String,
        /// Hashes of those at hand.
        expected: String,
    },
    /// A text is too long.
    #[error("{text:?} has {tokens} tokens with its start and its end, expected at most {most}")]
    TooLong {
        /// The text.
        text: String,
        /// Its tokens.
        tokens: usize,
        /// Tokens that the network takes.
        most: usize,
    },
    /// Results cannot be kept.
    #[error(transparent)]
    Results(#[from] SemanticsError),
}

impl FeaturesError {
    pub(crate) fn read(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        |cause| Self::Read { path, cause }
    }

    pub(crate) fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        |cause| Self::Write { path, cause }
    }

    pub(crate) fn config(path: &Path, why: impl Into<String>) -> Self {
        Self::Config {
            path: path.to_owned(),
            why: why.into(),
        }
    }
}
