//! Sender of commands.

use std::{
    hash::{BuildHasher, RandomState},
    time::{Duration, Instant},
};

use iceoryx2::{
    node::Node,
    port::{client::RequestSendError, listener::Listener, notifier::Notifier},
    prelude::{BackpressureStrategy, EventId, PortFactory},
};

use super::{ConnectError, RETRY_PERIOD, SendError};
use crate::{
    Service,
    schema::{Ack, Command, CommandHeader, MAX_COMMANDS},
    session::{self, EVENT_REQUEST, SessionName},
    shm,
};

type Port = iceoryx2::port::client::Client<Service, [Command], CommandHeader, [Ack], ()>;
type Pending =
    iceoryx2::pending_response::PendingResponse<Service, [Command], CommandHeader, [Ack], ()>;

/// Sends commands and waits for the answers. It stays attached when the server goes, and carries on with the
/// next one.
pub struct CommandSender {
    port: Port,
    service: session::Commands,
    listener: Listener<Service>,
    notifier: Notifier<Service>,
    client: u64,
    sequence: u64,
}

impl CommandSender {
    pub(super) fn open(node: &Node<Service>, session: &SessionName) -> Result<Self, ConnectError> {
        let open = |error| ConnectError::open(session.as_str(), error);
        let failed = |reason: String| {
            ConnectError::transport(session.as_str(), format!("command: {reason}"))
        };
        let event = session::event(node, session, "command", false).map_err(open)?;
        let service = session::commands(node, session, false).map_err(open)?;
        let port = service
            .client_builder()
            .initial_max_slice_len(MAX_COMMANDS)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|error| failed(error.to_string()))?;
        shm::reserve(port.id().value()).map_err(|error| failed(error.to_string()))?;
        Ok(Self {
            port,
            listener: event
                .listener_builder()
                .create()
                .map_err(|error| failed(error.to_string()))?,
            notifier: event
                .notifier_builder()
                .default_event_id(EventId::new(EVENT_REQUEST))
                .create()
                .map_err(|error| failed(error.to_string()))?,
            service,
            client: RandomState::new().hash_one(std::process::id()),
            sequence: 0,
        })
    }

    /// Number that identifies this sender in the journal.
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
        if commands.len() > MAX_COMMANDS {
            return Err(SendError::TooMany {
                count: commands.len(),
                max: MAX_COMMANDS,
            });
        }
        let first = self.sequence + 1;
        self.sequence += commands.len() as u64;
        let numbered: Vec<Command> = (first..)
            .zip(commands)
            .map(|(sequence, command)| Command {
                sequence,
                ..*command
            })
            .collect();
        Ok(Unanswered {
            pending: self.deliver(&numbered, timeout)?,
            first,
            count: commands.len(),
            sent: Instant::now(),
        })
    }

    /// Waits up to `timeout` for the answers to what was sent, one per command.
    pub fn answers(&self, sent: Unanswered, timeout: Duration) -> Result<Vec<Ack>, SendError> {
        let acks = self.await_answer(&sent, super::deadline(timeout))?;
        let sequences = sent.first..sent.first + sent.count as u64;
        if acks.iter().map(|ack| ack.sequence).ne(sequences) {
            return Err(SendError::BadAnswer {
                count: sent.count,
                answers: acks.len(),
            });
        }
        Ok(acks)
    }

    fn deliver(&self, commands: &[Command], timeout: Duration) -> Result<Pending, SendError> {
        let deadline = super::deadline(timeout);
        loop {
            let mut request = self
                .port
                .loan_slice_uninit(commands.len())
                .map_err(|error| SendError::Transport(error.to_string()))?;
            *request.user_header_mut() = CommandHeader {
                client: self.client,
                pid: std::process::id(),
                count: commands.len() as u32,
            };
            let full = match request.write_from_slice(commands).send() {
                Ok(pending) if pending.number_of_server_connections() > 0 => {
                    if let Err(error) = self.notifier.notify() {
                        tracing::debug!(?error, "the server was not woken");
                    }
                    return Ok(pending);
                }
                // Delivered to nobody: the server's queue is full, or there is no server.
                Ok(_) => self.service.dynamic_config().number_of_servers() > 0,
                Err(RequestSendError::ExceedsMaxActiveRequests) => true,
                Err(error) => return Err(SendError::Transport(format!("{error:?}"))),
            };
            if Instant::now() >= deadline {
                let seconds = timeout.as_secs_f64();
                return Err(if full {
                    SendError::Busy { seconds }
                } else {
                    SendError::NoServer { seconds }
                });
            }
            std::thread::sleep(RETRY_PERIOD);
        }
    }

    fn await_answer(&self, sent: &Unanswered, deadline: Instant) -> Result<Vec<Ack>, SendError> {
        let pending = &sent.pending;
        loop {
            // Asked first: what the server sends before it lets go of the request is there when it has.
            let is_open = pending.is_connected();
            let response = pending
                .receive()
                .map_err(|error| SendError::Transport(error.to_string()))?;
            if let Some(response) = response {
                return Ok(response.payload().to_vec());
            }
            let seconds = sent.sent.elapsed().as_secs_f64();
            if !is_open {
                return Err(match self.service.dynamic_config().number_of_servers() {
                    0 => SendError::ServerEnded { seconds },
                    _ => SendError::AnswerLost { seconds },
                });
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(SendError::Timeout { seconds });
            }
            // Errors are interrupts: the answer is still worth its time.
            let _ = session::listen(&self.listener, left.min(Duration::from_millis(50)), |_| {});
        }
    }
}

/// Commands on their way, and the place where their answers will be. Dropped before the server looked at them,
/// they are dropped unseen.
pub struct Unanswered {
    pending: Pending,
    first: u64,
    count: usize,
    sent: Instant,
}
