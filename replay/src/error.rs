//! Why a recording cannot run again, in sentences.

use std::path::PathBuf;

use cosplat_ipc::server::{CreateError, LoanRefused, PublishError};
use cosplat_recorder::{RecordingError, runs::Lack};
use cosplat_scene::load::LoadError;
use cosplat_server::convert::WireError;
use cosplat_sim_core::{CheckpointError, WorldError};

/// Why a recording cannot run again.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Something was not recorded.
    #[error(transparent)]
    Lack(#[from] Lack),
    /// The metadata of a run cannot be read.
    #[error("{0}")]
    Metadata(String),
    /// It has no run.
    #[error("{} holds no run of a server", path.display())]
    NoRun {
        /// The recording.
        path: PathBuf,
    },
    /// It has several runs.
    #[error("{} holds {count} runs, choose one with --run 1 to {count}", path.display())]
    ManyRuns {
        /// The recording.
        path: PathBuf,
        /// How many.
        count: usize,
    },
    /// It has no run of that number.
    #[error("{} has no run {number}, expected 1 to {count}", path.display())]
    RunNumber {
        /// The recording.
        path: PathBuf,
        /// The number asked for.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// The scene text is no text.
    #[error("its scene.toml is no text: {cause}")]
    Text {
        /// Where not.
        cause: std::str::Utf8Error,
    },
    /// The scene cannot be built.
    #[error(transparent)]
    Scene(#[from] LoadError),
    /// A block of the scene is not what its text makes.
    #[error("its attachment {name} is not that of its scene")]
    SceneBlock {
        /// Name of the attachment.
        name: String,
    },
    /// The metadata are not those of the scene.
    #[error("its metadata say {field} {recorded:?}, its scene has {found:?}")]
    SceneHeader {
        /// The field, as in the wire format.
        field: &'static str,
        /// As recorded.
        recorded: Vec<f64>,
        /// As the scene is built now.
        found: Vec<f64>,
    },
    /// All that is recorded comes before the state that the run can be taken up from.
    #[error(
        "its {count} frames come before the checkpoint that it can be taken up from: nothing was compared"
    )]
    NothingBehind {
        /// Frames before it.
        count: u64,
    },
    /// This program makes another scene of the same files.
    #[error("its scene makes another one now: hash {found:016x}, expected {expected:016x}")]
    OtherScene {
        /// Hash of the scene as it is built now.
        found: u64,
        /// Hash as recorded.
        expected: u64,
    },
    /// The threads of the solver do not start.
    #[error("cannot start {threads} threads: {cause}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the operating system says.
        cause: rayon::ThreadPoolBuildError,
    },
    /// The solver refuses the scene.
    #[error("its scene cannot be simulated: {0}")]
    World(WorldError),
    /// The solver refuses the checkpoint.
    #[error("the checkpoint that it begins with cannot be restored: {0}")]
    Checkpoint(CheckpointError),
    /// A checkpoint is not that of the step in its name.
    #[error("the checkpoint of step {expected} is one of step {found}")]
    CheckpointStep {
        /// The step of its state.
        found: u64,
        /// As it is named.
        expected: u64,
    },
    /// The journal is out of order.
    #[error("a command of step {command} comes after step {step} in the journal")]
    LateCommand {
        /// Step of the command.
        command: u64,
        /// Step that is at hand.
        step: u64,
    },
    /// A command of the journal cannot be read.
    #[error("in the journal of step {step}: {cause}")]
    Command {
        /// The step.
        step: u64,
        /// What is wrong with it.
        cause: WireError,
    },
    /// A command of the journal is none that a world obeys.
    #[error("the journal of step {step} has a command of kind {kind}, which changes no world")]
    NoAction {
        /// The step.
        step: u64,
        /// Kind of the command.
        kind: u32,
    },
    /// Steps are out of order.
    #[error("step {step} comes after step {before}")]
    StepOrder {
        /// The step.
        step: u64,
        /// The one before it in the file.
        before: u64,
    },
    /// The step was not recorded.
    #[error("step {at} is not in the run, which can be branched at steps {first} to {last}")]
    NoSuchStep {
        /// The step asked for.
        at: u64,
        /// First step that can be gone on from.
        first: u64,
        /// Last one.
        last: u64,
    },
    /// The run gives another state now.
    #[error(
        "step {step} is not what was recorded: its state hash is {found:016x}, expected {expected:016x}; \
         `cosplat verify` says more"
    )]
    Differs {
        /// The first such step.
        step: u64,
        /// Hash of the state as it is simulated now.
        found: u64,
        /// Hash as recorded.
        expected: u64,
    },
    /// A file that a branch needs cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        cause: std::io::Error,
    },
    /// There is nothing to show.
    #[error("{} has no frames", path.display())]
    NoFrames {
        /// The recording.
        path: PathBuf,
    },
    /// An attachment ends within an element.
    #[error("attachment {name} has {bytes} bytes, expected a multiple of {size}")]
    Attachment {
        /// Its name.
        name: &'static str,
        /// Its length [byte].
        bytes: usize,
        /// Length of an element [byte].
        size: usize,
    },
    /// Frames are no time apart.
    #[error("the recording has the frame rate {found}, expected a positive number")]
    FrameRate {
        /// The recorded one [1/s].
        found: f64,
    },
    /// The session cannot be made.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// There is no memory for a frame.
    #[error(transparent)]
    Loan(#[from] LoanRefused),
    /// A step cannot be published.
    #[error(transparent)]
    Publish(#[from] PublishError),
}
