//! Requests with commands and their answers, on `command` and on `step`.

use std::time::{Duration, Instant};

use iceoryx2::{
    node::Node,
    port::{client::RequestSendError, listener::Listener, notifier::Notifier},
    prelude::{BackpressureStrategy, EventId, PortFactory},
};

use super::{ConnectError, RETRY_PERIOD, SendError};
use crate::{
    Service,
    schema::{Ack, Command, CommandHeader, MAX_COMMANDS},
    session::{self, EVENT_REQUEST, RequestHeader, Requests, SessionName},
    shm,
};

type Port<H, R> = iceoryx2::port::client::Client<Service, [Command], H, [Ack], R>;
type Pending<H, R> = iceoryx2::pending_response::PendingResponse<Service, [Command], H, [Ack], R>;

/// Sends requests with the header `H`.
pub(super) struct RequestSender<H: RequestHeader> {
    port: Port<H, H::Answer>,
    service: Requests<H, H::Answer>,
    listener: Listener<Service>,
    notifier: Notifier<Service>,
    sequence: u64,
}

/// A request on its way. Dropped before the server looked at it, it is dropped unseen.
pub(super) struct Sent<H: RequestHeader> {
    pending: Pending<H, H::Answer>,
    first: u64,
    count: usize,
    since: Instant,
}

impl<H: RequestHeader> RequestSender<H> {
    pub fn open(node: &Node<Service>, session: &SessionName) -> Result<Self, ConnectError> {
        let open = |error| ConnectError::open(session.as_str(), error);
        let failed = |reason: String| {
            ConnectError::transport(session.as_str(), format!("{}: {reason}", H::STREAM))
        };
        // Requests of all kinds wake the server by one event; answers have one for each kind.
        let wake = session::event(node, session, CommandHeader::STREAM, false).map_err(open)?;
        let answers = session::event(node, session, H::STREAM, false).map_err(open)?;
        let service = session::requests::<H>(node, session, false).map_err(open)?;
        let port = service
            .client_builder()
            .initial_max_slice_len(MAX_COMMANDS)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|error| failed(error.to_string()))?;
        shm::reserve(port.id().value()).map_err(|error| failed(error.to_string()))?;
        Ok(Self {
            port,
            listener: answers
                .listener_builder()
                .create()
                .map_err(|error| failed(error.to_string()))?,
            notifier: wake
                .notifier_builder()
                .default_event_id(EventId::new(EVENT_REQUEST))
                .create()
                .map_err(|error| failed(error.to_string()))?,
            service,
            sequence: 0,
        })
    }

    /// Sends commands under `header`, numbered on, waiting up to `timeout` for a place in the server's queue, and where
    /// `awaits_server` for one that comes.
    pub fn submit(
        &mut self,
        header: H,
        commands: &[Command],
        timeout: Duration,
        awaits_server: bool,
    ) -> Result<Sent<H>, SendError> {
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
        Ok(Sent {
            pending: self.deliver(header, &numbered, timeout, awaits_server)?,
            first,
            count: commands.len(),
            since: Instant::now(),
        })
    }

    fn deliver(
        &self,
        header: H,
        commands: &[Command],
        timeout: Duration,
        awaits_server: bool,
    ) -> Result<Pending<H, H::Answer>, SendError> {
        let start = Instant::now();
        let deadline = super::deadline(timeout);
        loop {
            let mut request = self
                .port
                .loan_slice_uninit(commands.len())
                .map_err(|error| SendError::Transport(error.to_string()))?;
            *request.user_header_mut() = header;
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
            if Instant::now() >= deadline || !(full || awaits_server) {
                let seconds = start.elapsed().as_secs_f64();
                return Err(if full {
                    SendError::Busy { seconds }
                } else {
                    SendError::NoServer { seconds }
                });
            }
            std::thread::sleep(RETRY_PERIOD);
        }
    }

    /// Waits up to `timeout` for the answers to what was sent, one per command; `goes_on` is asked now and then
    /// whether there is any use in waiting.
    pub fn answers(
        &self,
        sent: &Sent<H>,
        timeout: Duration,
        mut goes_on: impl FnMut() -> bool,
    ) -> Result<(H::Answer, Vec<Ack>), SendError> {
        let deadline = super::deadline(timeout);
        let pending = &sent.pending;
        loop {
            // Asked first: what the server sends before it lets go of the request is there when it has.
            let is_open = pending.is_connected();
            let response = pending
                .receive()
                .map_err(|error| SendError::Transport(error.to_string()))?;
            if let Some(response) = response {
                return sent.check((*response.user_header(), response.payload().to_vec()));
            }
            let seconds = sent.since.elapsed().as_secs_f64();
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
            let mut heard = false;
            let wait = left.min(Duration::from_millis(50));
            // Errors are interrupts: the answer is still worth its time.
            let _ = session::listen(&self.listener, wait, |_| heard = true);
            if !heard && !goes_on() {
                return Err(SendError::ServerEnded { seconds });
            }
        }
    }
}

impl<H: RequestHeader> Sent<H> {
    /// Passes on answers that are those to what was sent.
    fn check(
        &self,
        (header, acks): (H::Answer, Vec<Ack>),
    ) -> Result<(H::Answer, Vec<Ack>), SendError> {
        let sequences = self.first..self.first + self.count as u64;
        if acks.iter().map(|ack| ack.sequence).ne(sequences) {
            return Err(SendError::BadAnswer {
                count: self.count,
                answers: acks.len(),
            });
        }
        Ok((header, acks))
    }
}
