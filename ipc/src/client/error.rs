//! What can go wrong on a client's side, in sentences.

use std::path::PathBuf;

use crate::{
    BadSessionName, DomainError, ICEORYX2_VERSION, LimitReached, SessionInfo, schema::WIRE_VERSION,
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
    /// The process or the session has reached a limit.
    #[error("cannot attach to session {session:?}: {limit}")]
    Limit {
        /// Name of the session.
        session: String,
        /// The limit.
        limit: LimitReached,
    },
    /// A service cannot be opened, as happens while a server comes or goes.
    #[error("session {session:?} is coming or going: {what}")]
    Unsettled {
        /// Name of the session.
        session: String,
        /// What was found.
        what: &'static str,
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
    /// Whether it may pass by itself, so that those who wait for a server try again: none is there, or one is just coming or
    /// going.
    pub fn may_pass(&self) -> bool {
        matches!(
            self,
            Self::NoServer { .. }
                | Self::Timeout { .. }
                | Self::Unsettled { .. }
                | Self::OtherTransport { .. }
        )
    }

    pub(super) fn open(session: &str, error: OpenError) -> Self {
        let unsettled = |what| Self::Unsettled {
            session: session.into(),
            what,
        };
        let reason = match error {
            OpenError::Absent => return unsettled("a service does not exist"),
            OpenError::Corrupted => return unsettled("a service is damaged"),
            OpenError::Incompatible(reason) => format!(
                "a service has other types or limits than wire version {WIRE_VERSION} says ({reason})"
            ),
            OpenError::Other(reason) => reason,
        };
        Self::transport(session, reason)
    }

    /// A failure of iceoryx2, or the limit behind it.
    pub(super) fn transport(session: &str, reason: String) -> Self {
        let session = session.into();
        match LimitReached::behind(&reason) {
            Some(limit) => Self::Limit { session, limit },
            None => Self::Transport { session, reason },
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
    /// The process or the session has reached a limit.
    #[error("cannot read {stream:?}: {limit}")]
    Limit {
        /// The stream.
        stream: &'static str,
        /// The limit.
        limit: LimitReached,
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

impl ReadError {
    /// A failure of iceoryx2, or the limit behind it.
    pub(super) fn transport(stream: &'static str, reason: String) -> Self {
        match LimitReached::behind(&reason) {
            Some(limit) => Self::Limit { stream, limit },
            None => Self::Transport { stream, reason },
        }
    }
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
    /// The server lives and has not answered.
    #[error(
        "the server has not answered for {seconds:.1} s: the commands take effect if it has looked at them"
    )]
    Timeout {
        /// Since they were sent [s].
        seconds: f64,
    },
    /// The server is done with the commands, and there is no answer.
    #[error(
        "the answer was lost {seconds:.1} s after the commands were sent: they were looked at, and those that were accepted take effect; `journal` tells which"
    )]
    AnswerLost {
        /// Since they were sent [s].
        seconds: f64,
    },
    /// The server went while the commands waited.
    #[error(
        "the server ended {seconds:.1} s after the commands were sent: they took effect if it had looked at them before; `journal` tells which"
    )]
    ServerEnded {
        /// Since they were sent [s].
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
