//! Reader of `status`.

use std::time::{Duration, Instant};

use iceoryx2::port::{listener::Listener, subscriber::Subscriber};

use super::{Client, ConnectError, ReadError, origin::Origin};
use crate::{
    Service, monotonic_ns,
    schema::{SERVER_STOPPING, Status},
    session,
};

/// A server whose heartbeat is older is called dead: the longest pause between two is a third of it.
const SILENCE: Duration = Duration::from_secs(1);

/// The newest status. It stays attached when the server goes, and carries on with the next one.
pub struct StatusReader {
    subscriber: Subscriber<Service, [Status], ()>,
    origin: Origin<Status, ()>,
    listener: Listener<Service>,
    newest: Option<Status>,
}

impl StatusReader {
    pub(super) fn open(client: &Client) -> Result<Self, ConnectError> {
        let (node, session) = (&client.node, &client.session);
        let open = |error| ConnectError::open(session.as_str(), error);
        let failed =
            |reason: String| ConnectError::transport(session.as_str(), format!("status: {reason}"));
        let stream = session::STATUS;
        let service = session::pub_sub::<Status, ()>(node, session, stream, false).map_err(open)?;
        Ok(Self {
            listener: session::event(node, session, stream.name, false)
                .map_err(open)?
                .listener_builder()
                .create()
                .map_err(|error| failed(error.to_string()))?,
            subscriber: service
                .subscriber_builder()
                .buffer_size(1)
                .create()
                .map_err(|error| failed(error.to_string()))?,
            origin: Origin::new(client.hello_service.clone(), service),
            newest: None,
        })
    }

    /// The newest status; `None` before the first.
    pub fn newest(&mut self) -> Result<Option<Status>, ReadError> {
        while let Some(status) = self.receive()? {
            self.newest = Some(status);
        }
        Ok(self.newest)
    }

    /// A status newer than any read before, waiting up to `timeout` for it; `None` if there was none.
    pub fn next(&mut self, timeout: Duration) -> Result<Option<Status>, ReadError> {
        let deadline = super::deadline(timeout);
        loop {
            if let Some(status) = self.receive()? {
                self.newest = Some(status);
                return Ok(self.newest);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let wait = left.min(Duration::from_millis(20));
            if left.is_zero() || session::listen(&self.listener, wait, |_| {}).is_err() {
                return Ok(None);
            }
        }
    }

    /// Whether the server gave a sign of life within the last second.
    pub fn is_server_alive(&mut self) -> Result<bool, ReadError> {
        Ok(self
            .newest()?
            .is_some_and(|status| heartbeat_age(&status) < SILENCE))
    }

    /// Whether the server's run `epoch` is over: it said that it stops, and then gave no sign of life for a second. Its last
    /// frame may have been lost, when its memory was in use.
    pub fn has_ended(&mut self, epoch: u64) -> Result<bool, ReadError> {
        Ok(self.newest()?.is_some_and(|status| {
            status.epoch == epoch
                && status.server_state == SERVER_STOPPING
                && heartbeat_age(&status) >= SILENCE
        }))
    }

    fn receive(&mut self) -> Result<Option<Status>, ReadError> {
        let stream = session::STATUS.name;
        let sample = loop {
            let sample = self
                .subscriber
                .receive()
                .map_err(|error| ReadError::transport(stream, error.to_string()))?;
            match sample {
                Some(sample) if self.origin.is_servers(sample.origin()) => break sample,
                Some(_) => {}
                None => return Ok(None),
            }
        };
        match sample.payload() {
            [status] => Ok(Some(*status)),
            other => Err(ReadError::Malformed {
                stream,
                announced: 1,
                actual: other.len(),
            }),
        }
    }
}

/// Time since the server sent `status`.
pub fn heartbeat_age(status: &Status) -> Duration {
    Duration::from_nanos(monotonic_ns().saturating_sub(status.heartbeat_ns))
}
