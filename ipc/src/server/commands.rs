//! Requests with commands, and their answers.
//!
//! Each client has a line of its own, and the lines take turns: who sends much waits behind its own requests,
//! not in front of those of others.

use std::{
    collections::{BTreeMap, VecDeque},
    time::{Duration, Instant},
};

use iceoryx2::{
    active_request::ActiveRequest,
    identifiers::UniqueClientId,
    node::Node,
    port::{ReceiveError, listener::Listener, notifier::Notifier, server::Server},
    prelude::{BackpressureStrategy, CallbackProgression, EventId, PortFactory},
};

use super::{CreateError, notify, pool, repeated::Repeated};
use crate::{
    Service,
    schema::{Ack, Command, CommandHeader},
    session::{
        self, Commands, EVENT_REQUEST, EVENT_RESPONSE, MAX_ACKS, MAX_ACTIVE_REQUESTS, MAX_CLIENTS,
        SessionName,
    },
};

/// Answers in memory at most: each request of each client may have one that waits and one that is held, and one is
/// being written. No client can take those of others.
pub(super) const RESPONSE_SLOTS: usize = MAX_CLIENTS * MAX_ACTIVE_REQUESTS * 2 + 1;

type Request = ActiveRequest<Service, [Command], CommandHeader, [Ack], ()>;

/// A request as the server sees it.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'a> {
    /// Names the request, for an answer that comes later.
    pub ticket: u64,
    /// Who sent it.
    pub header: &'a CommandHeader,
    /// What is ordered.
    pub commands: &'a [Command],
}

/// What the server makes of a request.
#[derive(Clone, Debug, PartialEq)]
pub enum Reply {
    /// One answer per command.
    Now(Vec<Ack>),
    /// The answers follow, see [`ServerPorts::answer`](super::ServerPorts::answer).
    Later,
    /// There is no time for it now: it stays the first in line.
    NotYet,
}

/// The requests of one client, the oldest first.
struct Line {
    client: UniqueClientId,
    requests: VecDeque<Request>,
}

pub(super) struct CommandPort {
    server: Server<Service, [Command], CommandHeader, [Ack], ()>,
    service: Commands,
    listener: Listener<Service>,
    notifier: Notifier<Service>,
    /// Clients whose requests wait for their turn, in the order of turns.
    lines: VecDeque<Line>,
    /// Requests that are answered later, by ticket.
    held: BTreeMap<u64, Request>,
    next_ticket: u64,
    /// Clients when last looked.
    clients: Vec<UniqueClientId>,
    lost: Repeated,
}

impl CommandPort {
    pub fn create(node: &Node<Service>, session: &SessionName) -> Result<Self, CreateError> {
        let open = |error| CreateError::open(session.as_str(), "make the command service", error);
        let failed = |reason: String| CreateError::Transport {
            what: "make the command port",
            reason,
        };
        let service = session::commands(node, session, true).map_err(open)?;
        let server = service
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
            service,
            listener: event
                .listener_builder()
                .create()
                .map_err(|error| failed(error.to_string()))?,
            notifier: event
                .notifier_builder()
                .default_event_id(EventId::new(EVENT_RESPONSE))
                .create()
                .map_err(|error| failed(error.to_string()))?,
            lines: VecDeque::new(),
            held: BTreeMap::new(),
            next_ticket: 0,
            clients: Vec::new(),
            lost: Repeated::new("answers were lost"),
        })
    }

    /// Hands requests to `answer`, one of each client in turn, until there are none or it has no time for one.
    pub fn poll(&mut self, mut answer: impl FnMut(Asked) -> Reply) -> usize {
        self.line_up();
        let mut answered = 0;
        loop {
            self.forget_the_gone();
            let Some(mut line) = self.lines.pop_front() else {
                break;
            };
            let Some(request) = line.requests.pop_front() else {
                continue;
            };
            // Whoever does not wait any more gave up before anything happened.
            if request.is_connected() {
                match ask(&request, self.next_ticket, &mut answer) {
                    Reply::Now(acks) => {
                        self.respond(&request, acks);
                        answered += 1;
                    }
                    Reply::Later => {
                        self.held.insert(self.next_ticket, request);
                    }
                    Reply::NotYet => {
                        line.requests.push_front(request);
                        self.lines.push_front(line);
                        break;
                    }
                }
                self.next_ticket += 1;
            }
            self.lines.push_back(line);
        }
        if answered > 0 {
            notify(&self.notifier);
        }
        answered
    }

    /// Answers the request of `ticket`; nothing happens if its sender is gone.
    pub fn answer(&mut self, ticket: u64, acks: Vec<Ack>) {
        self.forget_the_gone();
        if let Some(request) = self.held.remove(&ticket)
            && request.is_connected()
        {
            self.respond(&request, acks);
            notify(&self.notifier);
        }
    }

    /// Puts what has come into the lines.
    fn line_up(&mut self) {
        loop {
            self.forget_the_gone();
            let request = match self.server.receive() {
                Ok(Some(request)) => request,
                // Clients may have so many unanswered requests and no more.
                Ok(None) | Err(ReceiveError::ExceedsMaxBorrows) => return,
                Err(error) => {
                    self.lost
                        .warn(Instant::now(), &format!("not received: {error}"));
                    return;
                }
            };
            let client = request.origin();
            match self.lines.iter_mut().find(|line| line.client == client) {
                Some(line) => line.requests.push_back(request),
                None => self.lines.push_back(Line {
                    client,
                    requests: VecDeque::from([request]),
                }),
            }
        }
    }

    /// Drops the requests of clients that are gone. A request names its client by a place in a table that
    /// iceoryx2 (0.10.0) gives to the next one as soon as it looks: kept until then, it would be answered to, or
    /// close the request of, somebody else. So this comes before everything that makes iceoryx2 look.
    fn forget_the_gone(&mut self) {
        let mut clients = Vec::with_capacity(self.clients.len());
        self.service.dynamic_config().list_clients(|details| {
            clients.push(details.client_id);
            CallbackProgression::Continue
        });
        if clients != self.clients {
            self.lines.retain(|line| clients.contains(&line.client));
            self.held
                .retain(|_, request| clients.contains(&request.origin()));
            self.clients = clients;
        }
        self.held.retain(|_, request| request.is_connected());
    }

    /// Sends one answer per command of `request`.
    fn respond(&mut self, request: &Request, mut acks: Vec<Ack>) {
        let (header, commands) = (*request.user_header(), request.payload());
        for command in commands.iter().take(MAX_ACKS).skip(acks.len()) {
            acks.push(Ack::refused(command.sequence, "the server gave no answer"));
        }
        acks.truncate(commands.len().min(MAX_ACKS));
        let sent = match request.loan_slice_uninit(acks.len()) {
            Ok(response) => response
                .write_from_slice(&acks)
                .send()
                .map_err(|error| error.to_string()),
            Err(error) => Err(error.to_string()),
        };
        if let Err(error) = sent {
            let pid = header.pid;
            self.lost
                .warn(Instant::now(), &format!("that to process {pid}: {error}"));
        }
    }

    pub fn wait(&self, timeout: Duration) -> bool {
        if !self.lines.is_empty() {
            return true;
        }
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

/// What `answer` makes of `request`, if that is one.
fn ask(request: &Request, ticket: u64, answer: &mut impl FnMut(Asked) -> Reply) -> Reply {
    let (header, commands) = (request.user_header(), request.payload());
    if header.count as usize == commands.len() && commands.len() <= MAX_ACKS {
        return answer(Asked {
            ticket,
            header,
            commands,
        });
    }
    let reason = format!(
        "the header announces {} commands, the request holds {}, expected equal and at most {MAX_ACKS}",
        header.count,
        commands.len()
    );
    let refuse = |command: &Command| Ack::refused(command.sequence, &reason);
    Reply::Now(commands.iter().take(MAX_ACKS).map(refuse).collect())
}
