//! Requests with commands, and their answers.

use std::time::{Duration, Instant};

use iceoryx2::{
    active_request::ActiveRequest,
    node::Node,
    port::{listener::Listener, notifier::Notifier, server::Server},
    prelude::{BackpressureStrategy, EventId},
};

use super::{CreateError, notify, pool};
use crate::{
    Service,
    schema::{Ack, Command, CommandHeader},
    session::{self, EVENT_REQUEST, EVENT_RESPONSE, MAX_ACKS, SessionName},
};

/// Requests answered in one call at most.
const MAX_PER_POLL: usize = 64;
/// Responses in preparation or not yet taken by their clients.
const RESPONSE_SLOTS: usize = 128;

type Request = ActiveRequest<Service, [Command], CommandHeader, [Ack], ()>;

pub(super) struct CommandPort {
    server: Server<Service, [Command], CommandHeader, [Ack], ()>,
    listener: Listener<Service>,
    notifier: Notifier<Service>,
}

impl CommandPort {
    pub fn create(node: &Node<Service>, session: &SessionName) -> Result<Self, CreateError> {
        let open = |error| CreateError::open(session.as_str(), "make the command service", error);
        let failed = |reason: String| CreateError::Transport {
            what: "make the command port",
            reason,
        };
        let server = session::commands(node, session, true)
            .map_err(open)?
            .server_builder()
            .initial_max_slice_len(MAX_ACKS)
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .override_response_preallocation(|_| RESPONSE_SLOTS)
            .create()
            .map_err(|error| failed(error.to_string()))?;
        pool::reserve(server.id().value())?;
        let event = session::event(node, session, "command", true).map_err(open)?;
        Ok(Self {
            server,
            listener: event
                .listener_builder()
                .create()
                .map_err(|error| failed(error.to_string()))?,
            notifier: event
                .notifier_builder()
                .default_event_id(EventId::new(EVENT_RESPONSE))
                .create()
                .map_err(|error| failed(error.to_string()))?,
        })
    }

    pub fn poll(
        &mut self,
        mut answer: impl FnMut(&CommandHeader, &[Command]) -> Vec<Ack>,
    ) -> usize {
        let mut answered = 0;
        while answered < MAX_PER_POLL {
            match self.server.receive() {
                Ok(Some(request)) => respond(&request, &mut answer),
                Ok(None) => break,
                Err(error) => {
                    tracing::warn!(?error, "a request could not be received");
                    break;
                }
            }
            answered += 1;
        }
        if answered > 0 {
            notify(&self.notifier);
        }
        answered
    }

    pub fn wait(&self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        loop {
            let mut request = false;
            let left = deadline.saturating_duration_since(Instant::now());
            let heard = session::listen(&self.listener, left, |id| request |= id == EVENT_REQUEST);
            // An interrupt counts as a wake-up, so that the program can look at its signals.
            if request || heard.is_err() {
                return true;
            }
            if left.is_zero() {
                return false;
            }
        }
    }
}

fn respond(request: &Request, answer: &mut impl FnMut(&CommandHeader, &[Command]) -> Vec<Ack>) {
    let header = *request.user_header();
    let commands = request.payload();
    let mut acks = if header.count as usize == commands.len() && commands.len() <= MAX_ACKS {
        answer(&header, commands)
    } else {
        let reason = format!(
            "the header announces {} commands, the request holds {}, expected equal and at most {MAX_ACKS}",
            header.count,
            commands.len()
        );
        let refuse = |command: &Command| Ack::refused(command.sequence, &reason);
        commands.iter().take(MAX_ACKS).map(refuse).collect()
    };
    for command in commands.iter().take(MAX_ACKS).skip(acks.len()) {
        acks.push(Ack::refused(command.sequence, "the server gave no answer"));
    }
    acks.truncate(commands.len().min(MAX_ACKS));
    match request.loan_slice_uninit(acks.len()) {
        Ok(response) => {
            if let Err(error) = response.write_from_slice(&acks).send() {
                tracing::warn!(?error, pid = header.pid, "an answer was not delivered");
            }
        }
        Err(error) => tracing::warn!(?error, pid = header.pid, "no memory for an answer"),
    }
}
