//! Sender of commands.

use std::{
    hash::{BuildHasher, RandomState},
    time::{Duration, Instant},
};

use iceoryx2::node::Node;

use super::{
    ConnectError, SendError,
    requests::{RequestSender, Sent},
};
use crate::{
    Service,
    schema::{Ack, Command, CommandHeader},
    session::SessionName,
};

/// Sends commands and waits for the answers. It stays attached when the server goes, and carries on with the
/// next one.
pub struct CommandSender {
    requests: RequestSender<CommandHeader>,
    client: u64,
}

impl CommandSender {
    pub(super) fn open(
        node: &Node<Service>,
        session: &SessionName,
        client: Option<u64>,
    ) -> Result<Self, ConnectError> {
        let random = || RandomState::new().hash_one(std::process::id());
        Ok(Self {
            requests: RequestSender::open(node, session)?,
            client: client.unwrap_or_else(random),
        })
    }

    /// Number that identifies this sender in the journal, and orders its commands among those of others in a step.
    pub fn client_id(&self) -> u64 {
        self.client
    }

    /// Sends 1 to 32 commands, which take effect in this order, and waits up to `timeout` for one answer each.
    /// Their `sequence` is replaced by this sender's running number, from 1. Commands of a request that the
    /// server has not looked at when the wait ends are dropped unseen.
    pub fn send(&mut self, commands: &[Command], timeout: Duration) -> Result<Vec<Ack>, SendError> {
        if commands.is_empty() {
            return Ok(Vec::new());
        }
        let start = Instant::now();
        let sent = self.submit(commands, timeout)?;
        self.answers(sent, timeout.saturating_sub(start.elapsed()))
    }

    /// Sends commands as [`send`](Self::send) does, waiting up to `timeout` for a place in the server's queue; the
    /// answers are fetched by [`answers`](Self::answers). A sender has at most 16 requests without an answer.
    pub fn submit(
        &mut self,
        commands: &[Command],
        timeout: Duration,
    ) -> Result<Unanswered, SendError> {
        let header = CommandHeader {
            client: self.client,
            pid: std::process::id(),
            count: commands.len() as u32,
        };
        let sent = self.requests.submit(header, commands, timeout, true)?;
        Ok(Unanswered { sent })
    }

    /// Waits up to `timeout` for the answers to what was sent, one per command.
    pub fn answers(&self, sent: Unanswered, timeout: Duration) -> Result<Vec<Ack>, SendError> {
        let answers = self.requests.answers(&sent.sent, timeout, || true);
        answers.map(|((), acks)| acks)
    }

    /// The answers to what was sent if they are there, for a loop that has other things to do.
    ///
    /// # Errors
    /// When they never will be: the server ended, or dropped the request.
    pub fn try_answers(&self, sent: &Unanswered) -> Result<Option<Vec<Ack>>, SendError> {
        match self.requests.answers(&sent.sent, Duration::ZERO, || true) {
            Ok(((), acks)) => Ok(Some(acks)),
            Err(SendError::Timeout { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

/// Commands on their way, and the place where their answers will be. Dropped before the server looked at them,
/// they are dropped unseen.
pub struct Unanswered {
    sent: Sent<CommandHeader>,
}
