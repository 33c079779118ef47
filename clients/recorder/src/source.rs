//! Where the recorder's frames come from: what changed, or whole frames where a server does not send that.

use std::time::Duration;

use cosplat_ipc::Client;
use cosplat_ipc::client::{
    Changes, ChangesReader, ConnectError, Frame, FrameReader, ReadError, StatusReader,
};
use cosplat_ipc::schema::FrameHeader;

use crate::pipeline::{Pipeline, WriterEnded};

/// Frames that wait in shared memory at most.
const QUEUE_DEPTH: usize = 64;
/// How long the first status of a server may take before its frames are read whole.
const STATUS_WAIT: Duration = Duration::from_secs(1);

/// Frames, one way or the other.
pub(crate) enum Source {
    Changes(ChangesReader),
    Frames(FrameReader),
}

/// A step of the server.
pub(crate) enum Step {
    Changes(Changes),
    Frame(Frame),
}

impl Source {
    /// Reads what the server sends.
    pub(crate) fn open(client: &Client, status: &mut StatusReader) -> Result<Self, ConnectError> {
        let newest = status.next(STATUS_WAIT).unwrap_or_default();
        Self::of(client, newest.is_some_and(|status| status.has_changes != 0))
    }

    fn of(client: &Client, has_changes: bool) -> Result<Self, ConnectError> {
        Ok(match has_changes {
            true => Self::Changes(client.changes(QUEUE_DEPTH)?),
            false => Self::Frames(client.frames(QUEUE_DEPTH)?),
        })
    }

    /// Reads otherwise from now on, where the server does.
    pub(crate) fn follow(
        &mut self,
        client: &Client,
        has_changes: bool,
    ) -> Result<(), ConnectError> {
        if has_changes != matches!(self, Self::Changes(_)) {
            *self = Self::of(client, has_changes)?;
        }
        Ok(())
    }

    /// The next step, waiting up to `timeout` for it.
    pub(crate) fn next(&mut self, timeout: Duration) -> Result<Option<Step>, ReadError> {
        Ok(match self {
            Self::Changes(reader) => reader.next(timeout)?.map(Step::Changes),
            Self::Frames(reader) => reader.next(timeout)?.map(Step::Frame),
        })
    }
}

impl Step {
    /// Header of the frame.
    pub(crate) fn header(&self) -> FrameHeader {
        match self {
            Self::Changes(changes) => changes.header().frame(),
            Self::Frame(frame) => *frame.header(),
        }
    }

    /// Queues it to be written; its memory goes back to the server.
    pub(crate) fn write(
        self,
        pipeline: &mut Pipeline,
        status: Option<cosplat_ipc::schema::Status>,
    ) -> Result<(), WriterEnded> {
        match self {
            Self::Changes(changes) => pipeline.changes(changes.header(), changes.items(), status),
            Self::Frame(frame) => pipeline.frame(frame.header(), frame.gaussians(), status),
        }
    }
}
