//! The newest status, sent by whoever has something to say: the server's loop, or the monitor when that is busy.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use iceoryx2::{node::Node, port::notifier::Notifier, prelude::PortFactory};

use super::{
    CreateError, PublishError, notify, pool,
    publish::{Publisher, copy_and_send, publisher},
    sample_notifier,
};
use crate::{
    Service, monotonic_ns,
    schema::{ChangeSlot, ChangesHeader, FrameHeader, GaussianState, Status},
    session::{self, PubSub, STATUS, SessionName},
};

/// A status that is not updated is sent again with a new heartbeat after this time.
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(100);

/// The port of `status`.
pub(super) struct StatusPort {
    publisher: Arc<Publisher<Status, ()>>,
    notifier: Notifier<Service>,
    frames: PubSub<GaussianState, FrameHeader>,
    changes: PubSub<ChangeSlot, ChangesHeader>,
    epoch: u64,
    /// What was sent last, and when. Held while sending: two senders never overtake each other.
    newest: Mutex<Option<(Status, Instant)>>,
}

impl StatusPort {
    pub fn create(
        node: &Node<Service>,
        session: &SessionName,
        epoch: u64,
    ) -> Result<Self, CreateError> {
        Ok(Self {
            publisher: publisher(node, session, STATUS, 1, pool::STATUS_SLOTS, 1)?,
            notifier: sample_notifier(node, session, STATUS.name)?,
            frames: session::pub_sub(node, session, session::FRAME, false).map_err(|error| {
                CreateError::open(session.as_str(), "find the frame service", error)
            })?,
            changes: session::pub_sub(node, session, session::CHANGES, false).map_err(|error| {
                CreateError::open(session.as_str(), "find the service of changes", error)
            })?,
            epoch,
            newest: Mutex::new(None),
        })
    }

    /// For whoever looks after connections.
    pub fn publisher(&self) -> Arc<Publisher<Status, ()>> {
        self.publisher.clone()
    }

    /// Publishes `status` as the newest.
    pub fn update(&self, status: &Status) -> Result<(), PublishError> {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        *newest = Some((*status, Instant::now()));
        self.send(status)
    }

    /// Publishes the newest status once more when that is due.
    pub fn keep_alive(&self) {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let Some((status, sent)) = newest.as_mut() else {
            return;
        };
        if sent.elapsed() >= HEARTBEAT_PERIOD {
            *sent = Instant::now();
            if let Err(error) = self.send(status) {
                tracing::warn!(%error, "no heartbeat");
            }
        }
    }

    fn send(&self, status: &Status) -> Result<(), PublishError> {
        let status = Status {
            heartbeat_ns: monotonic_ns(),
            epoch: self.epoch,
            pid: std::process::id(),
            frame_readers: (self.frames.dynamic_config().number_of_subscribers()
                + self.changes.dynamic_config().number_of_subscribers())
                as u32,
            ..*status
        };
        copy_and_send(&self.publisher, STATUS.name, 1, (), &[status])?;
        notify(&self.notifier);
        Ok(())
    }
}
