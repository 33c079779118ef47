//! What can go wrong on a client's side, in sentences.

use std::path::PathBuf;

use crate::{
    BadSessionName, DomainError, ICEORYX2_VERSION, SessionInfo, schema::WIRE_VERSION,
    session::OpenError,
};

/// What a client's ports may take.
pub(super) const MIN_FREE_BYTES: u64 = 1 << 20;

/// Why a client cannot attach.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The session's name is no name.
    #[error(transparent)]
    BadName(#[from] BadSessionName),
    /// The domain cannot be used.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// Shared memory is full: attaching would risk the process.
    #[error(
        "shared memory is full: {} KiB free in /dev/shm, at least {} KiB expected for a client",
        available >> 10, MIN_FREE_BYTES >> 10
    )]
    ShmFull {
        /// There is [byte].
        available: u64,
    },
    /// Nobody serves the session.
    #[error("{}", no_server(session, root, others))]
    NoServer {
        /// Name of the session.
        session: String,
        /// Root folder of the domain that was searched.
        root: PathBuf,
        /// Sessions that are served there.
        others: Vec<SessionInfo>,
    },
    /// The server speaks another version of the wire contract.
    #[error(
        "session {session:?} is served by cosplat {server_release} (process {pid}) with wire version {server}, this is cosplat {} with wire version {WIRE_VERSION}: use the same release on both sides",
        env!("CARGO_PKG_VERSION")
    )]
    OtherWireVersion {
        /// Name of the session.
        session: String,
        /// The server's wire version.
        server: u32,
        /// The server's release.
        server_release: String,
        /// The server's process id.
        pid: u32,
    },
    /// Equal version numbers, different layouts: a development build.
    #[error(
        "session {session:?} is served by process {pid} with layout hash {server:016x}, this program has {client:016x}, both with wire version {WIRE_VERSION}: build both from the same source"
    )]
    OtherLayout {
        /// Name of the session.
        session: String,
        /// The server's layout hash.
        server: u64,
        /// Ours.
        client: u64,
        /// The server's process id.
        pid: u32,
    },
    /// The server uses another release of iceoryx2.
    #[error(
        "session {session:?} exists but cannot be read: this program uses iceoryx2 {ICEORYX2_VERSION}, in {} there are traces of {}; use the same release on both sides",
        root.display(),
        if others.is_empty() { "an unknown one".into() } else { others.join(", ") }
    )]
    OtherTransport {
        /// Name of the session.
        session: String,
        /// Root folder of the domain.
        root: PathBuf,
        /// Other releases that left traces in the domain.
        others: Vec<String>,
    },
    /// The server runs but a stream did not come up.
    #[error("session {session:?} is served, but {what} did not come within {seconds:.1} s")]
    Timeout {
        /// Name of the session.
        session: String,
        /// What was waited for.
        what: &'static str,
        /// How long [s].
        seconds: f64,
    },
    /// iceoryx2 failed.
    #[error("cannot attach to session {session:?}: {reason}")]
    Transport {
        /// Name of the session.
        session: String,
        /// What iceoryx2 says.
        reason: String,
    },
}

fn no_server(session: &str, root: &std::path::Path, others: &[SessionInfo]) -> String {
    let mut text = format!(
        "no server for session {session:?} in {}: start one with `cosplat serve SCENE.toml --session {session}`",
        root.display()
    );
    if others.is_empty() {
        text.push_str("; no session is served there");
    } else {
        let names: Vec<String> = others
            .iter()
            .map(|s| format!("{:?} (process {})", s.name, s.pid))
            .collect();
        text.push_str(&format!("; served there: {}", names.join(", ")));
    }
    text
}

impl ConnectError {
    pub(super) fn open(session: &str, error: OpenError) -> Self {
        let reason = match error {
            OpenError::Absent => "a service does not exist".into(),
            OpenError::Corrupted => "a service is damaged".into(),
            OpenError::Incompatible(reason) => format!(
                "a service has other types or limits than wire version {WIRE_VERSION} says ({reason})"
            ),
            OpenError::Other(reason) => reason,
        };
        Self::Transport {
            session: session.into(),
            reason,
        }
    }
}

/// Why a message cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// The program holds as many messages as it may.
    #[error("{max} messages of {stream:?} are held already: drop one first")]
    TooManyHeld {
        /// The stream.
        stream: &'static str,
        /// The limit.
        max: usize,
    },
    /// The header and the payload disagree; the message is dropped.
    #[error("a message on {stream:?} announces {announced} elements and holds {actual}")]
    Malformed {
        /// The stream.
        stream: &'static str,
        /// By the header.
        announced: usize,
        /// In the payload.
        actual: usize,
    },
    /// iceoryx2 failed.
    #[error("cannot read {stream:?}: {reason}")]
    Transport {
        /// The stream.
        stream: &'static str,
        /// What iceoryx2 says.
        reason: String,
    },
}

/// Why commands were not answered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SendError {
    /// Nobody serves the session.
    #[error("no server took the commands within {seconds:.1} s")]
    NoServer {
        /// How long [s].
        seconds: f64,
    },
    /// The server does not look at its requests, and no more of this sender's fit the queue.
    #[error("the server's queue was full for {seconds:.1} s: the commands were not sent")]
    Busy {
        /// How long [s].
        seconds: f64,
    },
    /// The server took the commands, or may yet, and did not answer.
    #[error(
        "the server did not answer within {seconds:.1} s: whether the commands took effect is unknown"
    )]
    Timeout {
        /// How long [s].
        seconds: f64,
    },
    /// More commands than fit a request.
    #[error("{count} commands in one request, expected at most {max}")]
    TooMany {
        /// Given.
        count: usize,
        /// Possible.
        max: usize,
    },
    /// The answer does not match the commands.
    #[error("the server answered {answers} of {count} commands")]
    BadAnswer {
        /// Commands sent.
        count: usize,
        /// Answers received.
        answers: usize,
    },
    /// iceoryx2 failed.
    #[error("cannot send commands: {0}")]
    Transport(String),
}
