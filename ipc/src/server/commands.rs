//! Requests with commands, on `command` and on `step`, and their answers.
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

use super::{CreateError, nodes::Fallen, notify, pool, repeated::Repeated};
use crate::{
    Service,
    schema::{Ack, Command, CommandHeader, RETURN_REFUSED, StepDone},
    session::{
        self, EVENT_REQUEST, EVENT_RESPONSE, MAX_ACKS, RequestHeader, Requests, SessionName,
    },
};

/// Answers in memory at most: each request of each client may have one that waits and one that is held, and one is
/// being written. No client can take those of others.
pub(super) const fn response_slots<H: RequestHeader>() -> usize {
    H::MAX_CLIENTS * H::MAX_ACTIVE * 2 + 1
}

type Request<H, R> = ActiveRequest<Service, [Command], H, [Ack], R>;

/// A request as the server sees it.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'a, H = CommandHeader> {
    /// Names the request, for an answer that comes later.
    pub ticket: u64,
    /// The sender's port, as long as it lives; a process may have several.
    pub port: u128,
    /// Who sent it.
    pub header: &'a H,
    /// What is ordered.
    pub commands: &'a [Command],
}

/// What the server makes of a request.
#[derive(Clone, Debug, PartialEq)]
pub enum Reply<A = Vec<Ack>> {
    /// One answer per command, on `step` with a header.
    Now(A),
    /// The answers follow, see [`ServerPorts::answer`](super::ServerPorts::answer).
    Later,
    /// There is no time for it now: it stays the first in line.
    NotYet,
}

/// A port that sent requests and is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Departed {
    /// The sender's port, as in [`Asked`].
    pub port: u128,
    /// Whether its process died, as far as this one saw.
    pub died: bool,
}

/// The requests of one client, the oldest first.
struct Line<H: RequestHeader> {
    client: UniqueClientId,
    requests: VecDeque<Request<H, H::Answer>>,
}

/// Where requests with the header `H` come in.
pub(super) struct RequestPort<H: RequestHeader> {
    server: Server<Service, [Command], H, [Ack], H::Answer>,
    service: Requests<H, H::Answer>,
    notifier: Notifier<Service>,
    /// Clients whose requests wait for their turn, in the order of turns.
    lines: VecDeque<Line<H>>,
    /// Requests that are answered later, by ticket.
    held: BTreeMap<u64, Request<H, H::Answer>>,
    next_ticket: u64,
    /// Clients when last looked, and the numbers of their nodes.
    clients: Vec<(UniqueClientId, u128)>,
    /// Clients that have gone since somebody asked.
    departed: Vec<Departed>,
    fallen: Fallen,
    lost: Repeated,
}

impl<H: RequestHeader> RequestPort<H> {
    pub fn create(
        node: &Node<Service>,
        session: &SessionName,
        fallen: &Fallen,
    ) -> Result<Self, CreateError> {
        let open = |error| CreateError::open(session.as_str(), "make a request service", error);
        let failed = |reason: String| CreateError::Transport {
            what: "make a request port",
            reason: format!("{}: {reason}", H::STREAM),
        };
        let service = session::requests::<H>(node, session, true).map_err(open)?;
        let server = service
            .server_builder()
            .initial_max_slice_len(MAX_ACKS)
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .override_response_preallocation(|_| response_slots::<H>())
            .create()
            .map_err(|error| failed(error.to_string()))?;
        pool::reserve(server.id().value())?;
        let event = session::event(node, session, H::STREAM, true).map_err(open)?;
        Ok(Self {
            server,
            service,
            notifier: event
                .notifier_builder()
                .default_event_id(EventId::new(EVENT_RESPONSE))
                .create()
                .map_err(|error| failed(error.to_string()))?,
            lines: VecDeque::new(),
            held: BTreeMap::new(),
            next_ticket: 0,
            clients: Vec::new(),
            departed: Vec::new(),
            fallen: fallen.clone(),
            lost: Repeated::new("answers were lost"),
        })
    }

    /// Hands requests to `answer`, one of each client in turn, until there are none or it has no time for one.
    pub fn poll<A: Answer<H::Answer>>(
        &mut self,
        mut answer: impl FnMut(Asked<H>) -> Reply<A>,
    ) -> usize {
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
                    Reply::Now(said) => {
                        self.respond(&request, said);
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

    /// Hands the requests to `answer` that are the first of their client and `cannot_wait`; others stay in line.
    pub fn poll_urgent<A: Answer<H::Answer>>(
        &mut self,
        cannot_wait: impl Fn(&[Command]) -> bool,
        mut answer: impl FnMut(Asked<H>) -> Reply<A>,
    ) {
        self.line_up();
        self.forget_the_gone();
        let is_urgent = |request: &Request<H, H::Answer>| cannot_wait(request.payload());
        let lines = self.lines.iter_mut();
        let urgent = lines.filter_map(|line| line.requests.pop_front_if(|one| is_urgent(one)));
        let urgent: Vec<_> = urgent.collect();
        let any = !urgent.is_empty();
        for request in urgent.into_iter().filter(|one| one.is_connected()) {
            match ask(&request, self.next_ticket, &mut answer) {
                Reply::Now(said) => self.respond(&request, said),
                Reply::Later | Reply::NotYet => {
                    self.held.insert(self.next_ticket, request);
                }
            }
            self.next_ticket += 1;
        }
        if any {
            notify(&self.notifier);
        }
    }

    /// Answers the request of `ticket`; nothing happens if its sender is gone.
    pub fn answer(&mut self, ticket: u64, said: impl Answer<H::Answer>) {
        self.forget_the_gone();
        if let Some(request) = self.held.remove(&ticket)
            && request.is_connected()
        {
            self.respond(&request, said);
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
            clients.push((details.client_id, details.node_id.value()));
            CallbackProgression::Continue
        });
        if clients != self.clients {
            let is_there = |client: UniqueClientId| clients.iter().any(|(id, _)| *id == client);
            self.lines.retain(|line| is_there(line.client));
            self.held.retain(|_, request| is_there(request.origin()));
            let gone = self.clients.iter().filter(|(id, _)| !is_there(*id));
            self.departed.extend(gone.map(|(id, node)| Departed {
                port: id.value(),
                died: self.fallen.contains(*node),
            }));
            self.clients = clients;
        }
        self.held.retain(|_, request| request.is_connected());
    }

    /// Whether requests wait for their turn.
    pub fn is_waiting(&self) -> bool {
        !self.lines.is_empty()
    }

    /// Whether the request of `ticket` waits for its answer, and its sender with it.
    pub fn is_held(&self, ticket: u64) -> bool {
        let request = self.held.get(&ticket);
        request.is_some_and(|request| request.is_connected())
    }

    /// The ports that are attached.
    pub fn ports(&mut self) -> impl Iterator<Item = u128> {
        self.forget_the_gone();
        self.clients.iter().map(|(client, _)| client.value())
    }

    /// The ports that have gone since the last look.
    pub fn departed(&mut self) -> Vec<Departed> {
        std::mem::take(&mut self.departed)
    }

    /// Sends one answer per command of `request`.
    fn respond(&mut self, request: &Request<H, H::Answer>, said: impl Answer<H::Answer>) {
        let (answer, mut acks) = said.parts();
        let (header, commands) = (*request.user_header(), request.payload());
        for command in commands.iter().take(MAX_ACKS).skip(acks.len()) {
            acks.push(Ack::refused(command.sequence, "the server gave no answer"));
        }
        acks.truncate(commands.len().min(MAX_ACKS));
        let sent = match request.loan_slice_uninit(acks.len()) {
            Ok(mut response) => {
                *response.user_header_mut() = answer;
                let response = response.write_from_slice(&acks);
                response.send().map_err(|error| error.to_string())
            }
            Err(error) => Err(error.to_string()),
        };
        if let Err(error) = sent {
            let pid = header.pid();
            self.lost
                .warn(Instant::now(), &format!("that to process {pid}: {error}"));
        }
    }
}

/// What a request is answered with: perhaps a header, and one answer per command.
pub trait Answer<R> {
    /// Header and answers.
    fn parts(self) -> (R, Vec<Ack>);

    /// Refuses a request that contradicts itself.
    fn refusal(reason: &str, acks: Vec<Ack>) -> Self;
}

impl Answer<()> for Vec<Ack> {
    fn parts(self) -> ((), Vec<Ack>) {
        ((), self)
    }

    fn refusal(_: &str, acks: Vec<Ack>) -> Self {
        acks
    }
}

impl Answer<StepDone> for (StepDone, Vec<Ack>) {
    fn parts(self) -> (StepDone, Vec<Ack>) {
        let (done, acks) = self;
        let count = acks.len() as u32;
        (StepDone { count, ..done }, acks)
    }

    fn refusal(reason: &str, acks: Vec<Ack>) -> Self {
        (StepDone::of_cause(RETURN_REFUSED, reason), acks)
    }
}

/// What requests of all kinds wake the server by.
pub(super) struct Wake(Listener<Service>);

impl Wake {
    pub fn create(node: &Node<Service>, session: &SessionName) -> Result<Self, CreateError> {
        let event = session::event(node, session, CommandHeader::STREAM, true)
            .map_err(|error| CreateError::open(session.as_str(), "make an event service", error))?;
        let listener = event.listener_builder().create();
        let listener = listener.map_err(|error| CreateError::Transport {
            what: "make a listener",
            reason: error.to_string(),
        })?;
        Ok(Self(listener))
    }

    /// Sleeps until a request was sent, a signal arrives or `timeout` is over; false for the last.
    pub fn wait(&self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        loop {
            let mut request = false;
            let left = deadline.saturating_duration_since(Instant::now());
            let heard = session::listen(&self.0, left, |id| request |= id == EVENT_REQUEST);
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
fn ask<H: RequestHeader, A: Answer<H::Answer>>(
    request: &Request<H, H::Answer>,
    ticket: u64,
    answer: &mut impl FnMut(Asked<H>) -> Reply<A>,
) -> Reply<A> {
    let (header, commands) = (request.user_header(), request.payload());
    if header.count() == commands.len() && commands.len() <= MAX_ACKS {
        return answer(Asked {
            ticket,
            port: request.origin().value(),
            header,
            commands,
        });
    }
    let reason = format!(
        "the header announces {} commands, the request holds {}, expected equal and at most {MAX_ACKS}",
        header.count(),
        commands.len()
    );
    let refuse = |command: &Command| Ack::refused(command.sequence, &reason);
    let acks = commands.iter().take(MAX_ACKS).map(refuse).collect();
    Reply::Now(A::refusal(&reason, acks))
}
