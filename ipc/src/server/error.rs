//! What can go wrong on the server's side, in sentences.

use std::path::PathBuf;

use crate::{BadSessionName, DomainError, LimitReached, session::OpenError};

/// Why a session cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum CreateError {
    /// The session's name is no name.
    #[error(transparent)]
    BadName(#[from] BadSessionName),
    /// The domain cannot be used.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// Another server is running.
    #[error(
        "session {session:?} is already served by process {pid}: stop it or choose another name with --session"
    )]
    AlreadyServed {
        /// Name of the session.
        session: String,
        /// The server's process id.
        pid: u32,
    },
    /// Shared memory is short.
    #[error(
        "shared memory is too small: {} MiB required, {} MiB available in /dev/shm (enlarge it, for containers with --shm-size, or use a smaller scene)",
        required.div_ceil(1 << 20), available >> 20
    )]
    ShmTooSmall {
        /// Needed [byte].
        required: u64,
        /// There is [byte].
        available: u64,
    },
    /// A pool of that size is of no use.
    #[error(
        "a pool of {slots} frames is not possible, expected {min} to {max}: one is kept for late joiners while the next is written, and all readers together can hold no more"
    )]
    FrameSlots {
        /// Frames asked for.
        slots: usize,
        /// Fewest that work.
        min: usize,
        /// Most that can be in use.
        max: usize,
    },
    /// The process has reached a limit.
    #[error("session {session:?} cannot be served: {limit}")]
    Limit {
        /// Name of the session.
        session: String,
        /// The limit.
        limit: LimitReached,
    },
    /// Programs of another kind use the session's services.
    #[error("session {session:?} is in use by programs of another build: this is cosplat {} with wire version {} on iceoryx2 {}; {detail}. Stop them first",
        env!("CARGO_PKG_VERSION"), crate::schema::WIRE_VERSION, crate::ICEORYX2_VERSION)]
    OtherBuild {
        /// Name of the session.
        session: String,
        /// What differs.
        detail: String,
    },
    /// iceoryx2 failed.
    #[error("cannot {what}: {reason}")]
    Transport {
        /// What was attempted.
        what: &'static str,
        /// What iceoryx2 says.
        reason: String,
    },
}

impl CreateError {
    /// The limit of this process behind a failure of iceoryx2, where there is one.
    pub(super) fn explained(self, session: &str) -> Self {
        match self {
            Self::Transport { what, reason } => match LimitReached::behind(&reason) {
                Some(limit) => Self::Limit {
                    session: session.into(),
                    limit,
                },
                None => Self::Transport { what, reason },
            },
            other => other,
        }
    }

    pub(super) fn open(session: &str, what: &'static str, error: OpenError) -> Self {
        match error {
            OpenError::Corrupted => Self::OtherBuild {
                session: session.into(),
                detail: "their iceoryx2 is of another release, or what they left is damaged".into(),
            },
            OpenError::Incompatible(detail) => Self::OtherBuild {
                session: session.into(),
                detail,
            },
            OpenError::Absent => Self::Transport {
                what,
                reason: "the service comes and goes".into(),
            },
            OpenError::Other(reason) => Self::Transport { what, reason },
        }
    }
}

/// Why no frame can be written now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LoanRefused {
    /// Readers hold or queue every frame of the pool.
    #[error("all {slots} frames of the pool are in use by readers")]
    PoolInUse {
        /// Frames in the pool.
        slots: usize,
    },
    /// The frame is larger than planned.
    #[error("a frame of {count} Gaussians was asked for, the pool is made for {max}")]
    TooLarge {
        /// Asked for.
        count: usize,
        /// Planned.
        max: usize,
    },
    /// iceoryx2 failed.
    #[error("no memory for a frame: {0}")]
    Transport(iceoryx2::port::LoanError),
}

/// Why something could not be published.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PublishError {
    /// More elements than planned.
    #[error("{count} elements on {stream:?}, expected at most {max}")]
    TooMany {
        /// The stream.
        stream: &'static str,
        /// Elements given.
        count: usize,
        /// Elements planned.
        max: usize,
    },
    /// Nobody finds the session any more.
    #[error(
        "session {session:?} ends: its files in {} were removed, so nobody could find or stop it; keep what cleans folders away from there, or set COSPLAT_DOMAIN to a folder elsewhere",
        root.display()
    )]
    Lost {
        /// Name of the session.
        session: String,
        /// Root folder of its domain.
        root: PathBuf,
    },
    /// iceoryx2 failed.
    #[error("cannot publish on {stream:?}: {reason}")]
    Transport {
        /// The stream.
        stream: &'static str,
        /// What iceoryx2 says.
        reason: String,
    },
}
