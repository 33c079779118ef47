//! The services of one session: names, quality of service, and what can go wrong when one is opened.

use std::{fmt::Debug, time::Duration};

use iceoryx2::{
    node::NodeView,
    port::listener::{Listener, ListenerWaitError},
    prelude::*,
    service::{
        builder::{
            event::{EventOpenError, EventOpenOrCreateError},
            publish_subscribe::{PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError},
            request_response::{RequestResponseOpenError, RequestResponseOpenOrCreateError},
        },
        port_factory::{event, publish_subscribe, request_response},
    },
};

use crate::{
    Domain, Service,
    remains::make,
    schema::{
        Ack, Command, CommandHeader, Hello, MAX_COMMANDS, StepDone, StepRequest, WIRE_VERSION,
    },
    sweeper,
};

/// The name of the node that serves.
pub(crate) const SERVER_ROLE: &str = "server";
/// Event id: a request was sent.
pub(crate) const EVENT_REQUEST: usize = 1;
/// Event id: a response was sent.
pub(crate) const EVENT_RESPONSE: usize = 2;
/// Event id: a sample was sent.
pub(crate) const EVENT_SAMPLE: usize = 3;
/// Requests that a client may have unanswered.
pub(crate) const MAX_ACTIVE_REQUESTS: usize = 16;
/// The same of a participant in lock-step: one that waits for its steps, and the one with which it leaves.
pub(crate) const MAX_ACTIVE_STEPS: usize = 2;
/// Participants at most.
pub(crate) const MAX_PARTICIPANTS: usize = 32;
/// Senders of commands at most: as many as participants, and some for who looks after them.
pub(crate) const MAX_SENDERS: usize = MAX_PARTICIPANTS + 8;

/// Quality of service of a publish-subscribe stream.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stream {
    pub name: &'static str,
    pub history: usize,
    pub max_depth: usize,
    pub max_held: usize,
    pub max_readers: usize,
}

pub(crate) const FRAME: Stream = Stream {
    name: "frame",
    history: 1,
    max_depth: 64,
    max_held: 8,
    max_readers: MAX_SUBSCRIBERS,
};
/// Who joins gets a complete message, so that no old one has to be kept.
pub(crate) const CHANGES: Stream = Stream {
    name: "changes",
    history: 0,
    ..FRAME
};
pub(crate) const OBJECTS: Stream = Stream {
    name: "objects",
    ..FRAME
};
pub(crate) const CONTACTS: Stream = Stream {
    name: "contacts",
    ..FRAME
};
pub(crate) const STATUS: Stream = Stream {
    name: "status",
    history: 1,
    max_depth: 1,
    max_held: 2,
    max_readers: MAX_ATTACHED,
};
pub(crate) const JOURNAL: Stream = Stream {
    name: "journal",
    history: 256,
    max_depth: 256,
    max_held: 2,
    max_readers: MAX_SUBSCRIBERS,
};
pub(crate) const SCENE_GAUSSIANS: Stream = scene("scene/gaussians");
pub(crate) const SCENE_SH: Stream = scene("scene/sh");
pub(crate) const SCENE_OBJECTS: Stream = scene("scene/objects");
pub(crate) const SCENE_FEATURES: Stream = scene("scene/features");
pub(crate) const SCENE_SOURCE: Stream = scene("scene/source");
pub(crate) const SCENE_FILES: Stream = scene("scene/files");

const fn scene(name: &'static str) -> Stream {
    Stream {
        name,
        history: 1,
        max_depth: 1,
        max_held: 4,
        max_readers: MAX_ATTACHED,
    }
}

/// Subscribers of a stream at most.
pub(crate) const MAX_SUBSCRIBERS: usize = 32;
/// The same of what all who are attached read for as long as they are: greeting, status and scene. It is more than there can be
/// participants or readers, so that whoever wants to give an order finds a place.
pub(crate) const MAX_ATTACHED: usize = 64;
/// Listeners and notifiers of an event at most: one of each participant, each sender, and each reader.
pub(crate) const MAX_ENDS: usize = MAX_PARTICIPANTS + MAX_SENDERS + MAX_SUBSCRIBERS;
/// The server, a replay or a tunnel, and a dead server that is not cleaned up yet.
const MAX_PUBLISHERS: usize = 4;
/// Processes that use a service at most.
pub(crate) const MAX_NODES: usize = 72;

pub(crate) type PubSub<T, H> = publish_subscribe::PortFactory<Service, [T], H>;
/// Commands with the header `H`, answered with the header `R`.
pub(crate) type Requests<H, R> = request_response::PortFactory<Service, [Command], H, [Ack], R>;
pub(crate) type HelloService = publish_subscribe::PortFactory<Service, Hello, ()>;
pub(crate) type Event = event::PortFactory<Service>;

/// A session's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SessionName(String);

/// The text is no session name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} is not a session name: expected 1 to 64 of the characters a-z A-Z 0-9 - _ .")]
pub struct BadSessionName {
    /// The text.
    pub name: String,
}

/// Passes a session's name on: for command lines, so that a wrong one is refused before anything takes time.
///
/// # Errors
/// When it is none.
pub fn session_name(text: &str) -> Result<String, BadSessionName> {
    SessionName::new(text).map(|name| name.0)
}

impl SessionName {
    pub fn new(name: &str) -> Result<Self, BadSessionName> {
        let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
        if name.is_empty() || name.len() > 64 || !name.bytes().all(plain) {
            return Err(BadSessionName { name: name.into() });
        }
        Ok(Self(name.into()))
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }

    fn service(&self, stream: &str) -> Result<ServiceName, OpenError> {
        let name = format!("cosplat/{}/v{WIRE_VERSION}/{stream}", self.0);
        ServiceName::new(&name).map_err(|error| OpenError::Other(format!("{name}: {error:?}")))
    }

    fn hello(&self) -> Result<ServiceName, OpenError> {
        let name = format!("cosplat/{}/hello", self.0);
        ServiceName::new(&name).map_err(|error| OpenError::Other(format!("{name}: {error:?}")))
    }
}

/// Why a service could not be opened or created.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum OpenError {
    /// Nobody made it yet, or it is about to go or to come: worth another try.
    Absent,
    /// Another release of iceoryx2 made it, or its files are damaged.
    Corrupted,
    /// The types or the quality of service differ.
    Incompatible(String),
    /// Anything else.
    Other(String),
}

macro_rules! classify {
    ($($error:ident)*) => {
        $(impl From<$error> for OpenError {
            fn from(error: $error) -> Self {
                Self::classify(&error)
            }
        })*
    };
}

classify! {
    EventOpenError EventOpenOrCreateError PublishSubscribeOpenError PublishSubscribeOpenOrCreateError
    RequestResponseOpenError RequestResponseOpenOrCreateError
}

impl OpenError {
    /// The error types of the patterns are separate but name their variants alike.
    fn classify(error: &impl Debug) -> Self {
        let text = format!("{error:?}");
        let has = |part: &str| text.contains(part);
        if has("DoesNotExist")
            || has("IsMarkedForDestruction")
            || has("HangsInCreation")
            || has("IsBeingCreated")
            || has("SystemInFlux")
        {
            Self::Absent
        } else if has("Corrupted") || has("VersionMismatch") {
            Self::Corrupted
        } else if has("Incompatible") || has("DoesNotSupport") || has("AlreadyExists") {
            Self::Incompatible(text)
        } else {
            Self::Other(text)
        }
    }
}

/// Publish-subscribe service of a stream: `create` for servers, otherwise it must exist.
pub(crate) fn pub_sub<T, H>(
    node: &Node<Service>,
    session: &SessionName,
    stream: Stream,
    create: bool,
) -> Result<PubSub<T, H>, OpenError>
where
    T: Debug + ZeroCopySend + 'static,
    H: Debug + ZeroCopySend + 'static,
{
    let name = session.service(stream.name)?;
    let builder = node
        .service_builder(&name)
        .publish_subscribe::<[T]>()
        .user_header::<H>()
        .enable_safe_overflow(true);
    if !create {
        return Ok(builder.open()?);
    }
    let builder = builder
        .history_size(stream.history)
        .subscriber_max_buffer_size(stream.max_depth)
        .subscriber_max_borrowed_samples(stream.max_held)
        .max_subscribers(stream.max_readers)
        .max_publishers(MAX_PUBLISHERS)
        .max_nodes(MAX_NODES);
    make(node, &name, MessagingPattern::PublishSubscribe, || {
        Ok(builder.clone().open_or_create()?)
    })
}

/// The `hello` service; one publisher, so that a session has one server.
pub(crate) fn hello(
    node: &Node<Service>,
    session: &SessionName,
    create: bool,
) -> Result<HelloService, OpenError> {
    let name = session.hello()?;
    let builder = node.service_builder(&name).publish_subscribe::<Hello>();
    if !create {
        return Ok(builder.open()?);
    }
    let builder = builder
        .history_size(1)
        .subscriber_max_buffer_size(1)
        .subscriber_max_borrowed_samples(1)
        .max_subscribers(MAX_ATTACHED)
        .max_publishers(1)
        .max_nodes(MAX_NODES);
    make(node, &name, MessagingPattern::PublishSubscribe, || {
        Ok(builder.clone().open_or_create()?)
    })
}

/// Event service of a stream.
pub(crate) fn event(
    node: &Node<Service>,
    session: &SessionName,
    stream: &str,
    create: bool,
) -> Result<Event, OpenError> {
    let name = session.service(stream)?;
    let builder = node.service_builder(&name).event();
    if !create {
        return Ok(builder.open()?);
    }
    let builder = builder
        .max_listeners(MAX_ENDS)
        .max_notifiers(MAX_ENDS)
        .max_nodes(MAX_NODES);
    make(node, &name, MessagingPattern::Event, || {
        Ok(builder.clone().open_or_create()?)
    })
}

/// Collects events for up to `timeout`; an interrupt is an error.
pub(crate) fn listen(
    listener: &Listener<Service>,
    timeout: Duration,
    mut heard: impl FnMut(usize),
) -> Result<(), ListenerWaitError> {
    let callback = |event: EventActivation| heard(event.id.as_value());
    // A socket takes a timeout that rounds to zero for "for ever".
    if timeout < Duration::from_micros(10) {
        listener.try_wait(callback)?;
    } else {
        listener.timed_wait(callback, timeout)?;
    }
    Ok(())
}

/// Header of requests with commands, and what goes with it.
pub(crate) trait RequestHeader: Copy + Debug + Default + ZeroCopySend + 'static {
    /// Header of the answers.
    type Answer: Copy + Debug + Default + ZeroCopySend + 'static;
    /// Name of the service.
    const STREAM: &'static str;
    /// Requests that a client may have unanswered.
    const MAX_ACTIVE: usize;
    /// Clients at most.
    const MAX_CLIENTS: usize;
    /// Commands announced.
    fn count(&self) -> usize;
    /// Sender's process id.
    fn pid(&self) -> u32;
}

impl RequestHeader for CommandHeader {
    type Answer = ();
    const STREAM: &'static str = "command";
    const MAX_ACTIVE: usize = MAX_ACTIVE_REQUESTS;
    const MAX_CLIENTS: usize = MAX_SENDERS;
    fn count(&self) -> usize {
        self.count as usize
    }
    fn pid(&self) -> u32 {
        self.pid
    }
}

impl RequestHeader for StepRequest {
    type Answer = StepDone;
    const STREAM: &'static str = "step";
    const MAX_ACTIVE: usize = MAX_ACTIVE_STEPS;
    const MAX_CLIENTS: usize = MAX_PARTICIPANTS;
    fn count(&self) -> usize {
        self.count as usize
    }
    fn pid(&self) -> u32 {
        self.pid
    }
}

/// The request-response service with headers `H`.
pub(crate) fn requests<H: RequestHeader>(
    node: &Node<Service>,
    session: &SessionName,
    create: bool,
) -> Result<Requests<H, H::Answer>, OpenError> {
    let name = session.service(H::STREAM)?;
    let builder = node
        .service_builder(&name)
        .request_response::<[Command], [Ack]>()
        .request_user_header::<H>()
        .response_user_header::<H::Answer>()
        .enable_safe_overflow_for_requests(false)
        .enable_safe_overflow_for_responses(false)
        .enable_fire_and_forget_requests(false);
    if !create {
        return Ok(builder.open()?);
    }
    let builder = builder
        .max_active_requests_per_client(H::MAX_ACTIVE)
        .max_loaned_requests(1)
        .max_response_buffer_size(1)
        .max_borrowed_responses_per_pending_response(1)
        .max_clients(H::MAX_CLIENTS)
        .max_servers(2)
        .max_nodes(MAX_NODES);
    make(node, &name, MessagingPattern::RequestResponse, || {
        Ok(builder.clone().open_or_create()?)
    })
}

/// Elements of a response at most.
pub(crate) const MAX_ACKS: usize = MAX_COMMANDS;

/// A session that somebody serves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SessionInfo {
    /// Name of the session.
    pub name: String,
    /// Process id of its server.
    pub pid: u32,
}

/// The sessions served in `domain`, by name.
pub fn list_sessions(domain: &Domain) -> Vec<SessionInfo> {
    sweeper::watch(domain);
    let mut sessions = Vec::new();
    let listed = <Service as iceoryx2::service::Service>::list(&domain.config(), |service| {
        let name = service.static_details.name().as_str();
        let session = name
            .strip_prefix("cosplat/")
            .and_then(|rest| rest.strip_suffix("/hello"));
        let nodes = service.dynamic_details.iter().flat_map(|d| &d.nodes);
        if let (Some(session), Some(pid)) = (session, server_pid(nodes)) {
            sessions.push(SessionInfo {
                name: session.into(),
                pid,
            });
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        tracing::debug!(?error, "services cannot be listed");
    }
    sessions.sort_by(|a, b| a.name.cmp(&b.name));
    sessions
}

/// Process id of the living server among `nodes`.
fn server_pid<'a>(nodes: impl IntoIterator<Item = &'a NodeState<Service>>) -> Option<u32> {
    nodes.into_iter().find_map(|node| match node {
        NodeState::Alive(view) => view
            .details()
            .as_ref()
            .filter(|details| details.name().as_str() == format!("cosplat-{SERVER_ROLE}"))
            .map(|details| details.process_id().value() as u32),
        _ => None,
    })
}
