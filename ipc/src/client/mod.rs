//! The watching side of a session: attach to a server, read its streams, send it commands.

mod changes;
mod commands;
mod error;
mod origin;
mod participant;
mod reader;
mod requests;
mod scene;
mod status;

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use iceoryx2::{node::Node, prelude::PortFactory};

pub use changes::ChangesReader;
pub use commands::{CommandSender, Unanswered};
pub use error::{ConnectError, ReadError, SendError};
pub use participant::{Participant, StepError, Stepped, Until, check_participant};
pub use reader::{
    Changes, ContactsReader, Frame, FrameReader, JournalReader, Message, ObjectsReader,
    StreamHeader, StreamReader,
};
pub use scene::{SceneReader, SceneView};
pub use status::{StatusReader, heartbeat_age};

use crate::{
    Domain, LimitReached, Service,
    domain::other_transports,
    limits::FEW_FILES,
    list_sessions,
    schema::{Hello, WIRE_VERSION, schema_hash},
    session::{self, HelloService, OpenError, SessionName},
    shm,
};

/// How often a client looks again for what is not there yet.
const RETRY_PERIOD: Duration = Duration::from_millis(5);

/// When a wait of `timeout` from now is over; one that no clock can tell is over after a century.
fn deadline(timeout: Duration) -> Instant {
    const CENTURY: Duration = Duration::from_secs(100 * 365 * 86_400);
    let now = Instant::now();
    now.checked_add(timeout).unwrap_or(now + CENTURY)
}

/// An attached process. Readers and senders made from it outlive it, and a restart of the server.
pub struct Client {
    domain: Domain,
    session: SessionName,
    node: Node<Service>,
    hello: Hello,
    hello_service: Arc<HelloService>,
}

impl Client {
    /// Attaches to `session`, waiting up to `timeout` for its server. `role` (a few plain characters) names the
    /// process in listings.
    pub fn connect(
        domain: &Domain,
        session: &str,
        role: &str,
        timeout: Duration,
    ) -> Result<Self, ConnectError> {
        let session = SessionName::new(session)?;
        let available = shm::available_bytes();
        if available < error::MIN_FREE_BYTES {
            return Err(ConnectError::ShmFull { available });
        }
        let node = domain.join(role)?;
        let deadline = deadline(timeout);
        let (hello, hello_service) = loop {
            let greeted = read_hello(domain, &node, &session);
            let error = match greeted.and_then(|(hello, service)| {
                is_complete(&node, &session, hello).map(|hello| (hello, service))
            }) {
                Ok(greeting) => break greeting,
                Err(error) => error,
            };
            if Instant::now() >= deadline {
                // A connection that fails for want of a descriptor looks like silence.
                let silence = matches!(error, ConnectError::Timeout { .. });
                return Err(match LimitReached::files(FEW_FILES).filter(|_| silence) {
                    Some(limit) => ConnectError::Limit {
                        session: session.as_str().into(),
                        limit,
                    },
                    None => error,
                });
            }
            std::thread::sleep(RETRY_PERIOD);
        };
        if hello.wire_version != WIRE_VERSION {
            return Err(ConnectError::OtherWireVersion {
                session: session.as_str().into(),
                server: hello.wire_version,
                server_release: hello
                    .server_version()
                    .unwrap_or("of unknown release")
                    .into(),
                pid: hello.pid,
            });
        }
        if hello.schema_hash != schema_hash() {
            return Err(ConnectError::OtherLayout {
                session: session.as_str().into(),
                server: hello.schema_hash,
                client: schema_hash(),
                pid: hello.pid,
            });
        }
        Ok(Self {
            domain: domain.clone(),
            session,
            node,
            hello,
            hello_service: Arc::new(hello_service),
        })
    }

    /// Name of the session.
    pub fn session(&self) -> &str {
        self.session.as_str()
    }

    /// The domain attached to.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The server found when attaching.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// Reads frames: `depth` 1 for always the newest, up to 64 for a queue that loses none.
    pub fn frames(&self, depth: usize) -> Result<FrameReader, ConnectError> {
        StreamReader::open(self, session::FRAME, depth)
    }

    /// Reads what changes from step to step: `depth` as for frames. It begins with a complete message, and wakes with
    /// the frames.
    pub fn changes(&self, depth: usize) -> Result<ChangesReader, ConnectError> {
        ChangesReader::open(self, depth)
    }

    /// Reads objects: `depth` as for frames. It wakes with the frames.
    pub fn objects(&self, depth: usize) -> Result<ObjectsReader, ConnectError> {
        StreamReader::open(self, session::OBJECTS, depth)
    }

    /// Reads the contacts of every step: `depth` as for frames. It wakes with the frames.
    pub fn contacts(&self, depth: usize) -> Result<ContactsReader, ConnectError> {
        StreamReader::open(self, session::CONTACTS, depth)
    }

    /// Reads the journal of applied commands, from the oldest that the server still keeps.
    pub fn journal(&self) -> Result<JournalReader, ConnectError> {
        StreamReader::open(self, session::JOURNAL, session::JOURNAL.max_depth)
    }

    /// Reads the server's status.
    pub fn status(&self) -> Result<StatusReader, ConnectError> {
        StatusReader::open(self)
    }

    /// Maps the scene, waiting up to `timeout` for the server to publish it; a [`SceneReader`] does so bit by bit.
    pub fn scene(&self, timeout: Duration) -> Result<SceneView, ConnectError> {
        SceneReader::default().any(self, timeout)
    }

    /// Sends commands, under a random client number.
    pub fn commands(&self) -> Result<CommandSender, ConnectError> {
        CommandSender::open(&self.node, &self.session, None)
    }

    /// Sends commands under a client number of the caller's choice, which orders them among those of others in a step.
    pub fn commands_as(&self, client: u64) -> Result<CommandSender, ConnectError> {
        CommandSender::open(&self.node, &self.session, Some(client))
    }
}

/// Passes `hello` on when the server has made the last of its services, so that all can be opened; a server
/// of another version has others, and its hello says enough.
fn is_complete(
    node: &Node<Service>,
    session: &SessionName,
    hello: Hello,
) -> Result<Hello, ConnectError> {
    let ours = hello.wire_version == WIRE_VERSION && hello.schema_hash == schema_hash();
    if ours && let Err(OpenError::Absent) = session::event(node, session, "command", false) {
        return Err(ConnectError::Timeout {
            session: session.as_str().into(),
            what: "its services",
            seconds: 0.0,
        });
    }
    Ok(hello)
}

/// The hello of a living server; it comes with the next turn of the server's monitor.
fn read_hello(
    domain: &Domain,
    node: &Node<Service>,
    session: &SessionName,
) -> Result<(Hello, HelloService), ConnectError> {
    let no_server = || ConnectError::NoServer {
        session: session.as_str().into(),
        root: domain.root().into(),
        others: list_sessions(domain),
    };
    let failed = |reason: String| ConnectError::transport(session.as_str(), reason);
    let service = session::hello(node, session, false).map_err(|error| match error {
        OpenError::Absent => no_server(),
        OpenError::Corrupted => ConnectError::OtherTransport {
            session: session.as_str().into(),
            root: domain.root().into(),
            others: other_transports(&domain.config()),
        },
        other => ConnectError::open(session.as_str(), other),
    })?;
    let subscriber = service
        .subscriber_builder()
        .buffer_size(1)
        .create()
        .map_err(|error| failed(format!("hello: {error}")))?;
    let deadline = Instant::now() + Duration::from_millis(500);
    loop {
        let sample = subscriber
            .receive()
            .map_err(|error| failed(error.to_string()))?;
        if let Some(sample) = sample {
            return Ok((*sample.payload(), service));
        }
        if service.dynamic_config().number_of_publishers() == 0 {
            return Err(no_server());
        }
        if Instant::now() >= deadline {
            return Err(ConnectError::Timeout {
                session: session.as_str().into(),
                what: "its greeting",
                seconds: 0.5,
            });
        }
        std::thread::sleep(RETRY_PERIOD);
    }
}
