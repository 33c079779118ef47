//! Readers of the streams that come with every step.

use std::{
    fmt::Debug,
    sync::Arc,
    time::{Duration, Instant},
};

use iceoryx2::{
    port::{
        ReceiveError,
        listener::Listener,
        subscriber::{Subscriber, SubscriberCreateError},
    },
    prelude::ZeroCopySend,
    sample::Sample,
};

use super::{Client, ConnectError, ReadError, origin::Origin};
use crate::{
    Service,
    schema::{
        AppliedCommand, ChangeSlot, ChangesHeader, Contact, ContactsHeader, FrameHeader,
        GaussianState, JournalHeader, ObjectState, ObjectsHeader,
    },
    session::{self, PubSub, Stream},
};

/// What readers need to know about a message.
pub trait StreamHeader: Copy + Debug + Default + ZeroCopySend + 'static {
    /// Identifies the server's run; grows with every start.
    fn epoch(&self) -> u64;
    /// Elements announced.
    fn count(&self) -> usize;
    /// The number that this message has in its run.
    fn number(&self) -> u64;
    /// The number that the next message has.
    fn next_number(&self) -> u64;
}

/// Headers of streams with one message per step, which its step numbers.
macro_rules! numbered_by_step {
    ($($header:ty),*) => {$(
        impl StreamHeader for $header {
            fn epoch(&self) -> u64 {
                self.epoch
            }
            fn count(&self) -> usize {
                self.count as usize
            }
            fn number(&self) -> u64 {
                self.step
            }
            fn next_number(&self) -> u64 {
                self.step.wrapping_add(1)
            }
        }
    )*};
}

numbered_by_step!(FrameHeader, ChangesHeader, ObjectsHeader, ContactsHeader);

impl StreamHeader for JournalHeader {
    fn epoch(&self) -> u64 {
        self.epoch
    }
    fn count(&self) -> usize {
        self.count as usize
    }
    fn number(&self) -> u64 {
        self.first
    }
    fn next_number(&self) -> u64 {
        self.first.wrapping_add(u64::from(self.count))
    }
}

/// A frame, read where the server wrote it.
pub type Frame = Message<GaussianState, FrameHeader>;
/// Reader of `frame`.
pub type FrameReader = StreamReader<GaussianState, FrameHeader>;
/// What changed in a step, read where the server wrote it.
pub type Changes = Message<ChangeSlot, ChangesHeader>;
/// Reader of `objects`.
pub type ObjectsReader = StreamReader<ObjectState, ObjectsHeader>;
/// Reader of `contacts`.
pub type ContactsReader = StreamReader<Contact, ContactsHeader>;
/// Reader of `journal`; a message's `missed` counts commands.
pub type JournalReader = StreamReader<AppliedCommand, JournalHeader>;

/// A message in the server's memory. Holding it keeps the memory from reuse, also when its reader is gone: drop it soon, or copy.
#[derive(Debug)]
pub struct Message<T: Debug + ZeroCopySend + 'static, H: StreamHeader> {
    sample: Sample<Service, [T], H>,
    /// The publisher takes back what subscribers hold that are gone.
    _subscriber: Arc<Subscriber<Service, [T], H>>,
    missed: u64,
    new_run: bool,
}

impl<T: Debug + ZeroCopySend, H: StreamHeader> Message<T, H> {
    /// The header.
    pub fn header(&self) -> &H {
        self.sample.user_header()
    }

    /// The elements.
    pub fn items(&self) -> &[T] {
        self.sample.payload()
    }

    /// Steps (of the journal: commands) between the message read before and this one.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Whether this is the first message after the server was started anew: read the scene again.
    pub fn is_new_run(&self) -> bool {
        self.new_run
    }
}

impl Message<GaussianState, FrameHeader> {
    /// The Gaussians.
    pub fn gaussians(&self) -> &[GaussianState] {
        self.items()
    }
}

/// A queue of messages. It stays attached when the server goes, and carries on with the next one.
pub struct StreamReader<T: Debug + ZeroCopySend + 'static, H: StreamHeader> {
    subscriber: Arc<Subscriber<Service, [T], H>>,
    origin: Origin<T, H>,
    event: session::Event,
    /// Made at the first wait: a reader that only looks costs the server no wake-ups.
    listener: Option<Listener<Service>>,
    stream: Stream,
    depth: usize,
    epoch: u64,
    next_number: u64,
    missed: u64,
    runs: u64,
}

impl<T: Debug + ZeroCopySend, H: StreamHeader> StreamReader<T, H> {
    pub(super) fn open(
        client: &Client,
        stream: Stream,
        depth: usize,
    ) -> Result<Self, ConnectError> {
        let (node, session) = (&client.node, &client.session);
        let open = |error| ConnectError::open(session.as_str(), error);
        let failed = |reason: String| {
            ConnectError::transport(session.as_str(), format!("{}: {reason}", stream.name))
        };
        // One event wakes for all that a step publishes; the frame comes last.
        let event = session::event(node, session, session::FRAME.name, false).map_err(open)?;
        let depth = depth.clamp(1, stream.max_depth);
        let service = session::pub_sub::<T, H>(node, session, stream, false).map_err(open)?;
        let subscriber =
            subscribe(&service, stream, depth).map_err(|error| failed(error.to_string()))?;
        Ok(Self {
            subscriber: Arc::new(subscriber),
            origin: Origin::new(client.hello_service.clone(), service),
            event,
            listener: None,
            stream,
            depth,
            epoch: 0,
            next_number: 0,
            missed: 0,
            runs: 0,
        })
    }

    /// The next message, waiting up to `timeout` for it; `None` if there was none.
    pub fn next(&mut self, timeout: Duration) -> Result<Option<Message<T, H>>, ReadError> {
        let deadline = super::deadline(timeout);
        loop {
            while let Some(sample) = self.receive()? {
                if let Some(message) = self.accept(sample)? {
                    return Ok(Some(message));
                }
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            if !self.sleep(left.min(LONGEST_WAIT))? {
                return Ok(None);
            }
        }
    }

    /// Waits for an event; false after an interrupt, so that the program can look at its signals.
    fn sleep(&mut self, timeout: Duration) -> Result<bool, ReadError> {
        let Some(listener) = &self.listener else {
            let listener = self.event.listener_builder().create();
            self.listener = Some(
                listener
                    .map_err(|error| ReadError::transport(self.stream.name, error.to_string()))?,
            );
            // What was sent until now made no event: look again first.
            return Ok(true);
        };
        Ok(session::listen(listener, timeout, |_| {}).is_ok())
    }

    /// Joins anew: what is on its way is left, and the server takes this reader for another one.
    pub(super) fn rejoin(&mut self) -> Result<(), ReadError> {
        let subscriber = subscribe(self.origin.stream(), self.stream, self.depth)
            .map_err(|error| ReadError::transport(self.stream.name, error.to_string()))?;
        self.subscriber = Arc::new(subscriber);
        Ok(())
    }

    /// Steps (of the journal: commands) missed since this reader was made.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Runs of the server seen, the present one included.
    pub fn runs(&self) -> u64 {
        self.runs
    }

    fn receive(&self) -> Result<Option<Sample<Service, [T], H>>, ReadError> {
        self.subscriber.receive().map_err(|error| match error {
            ReceiveError::ExceedsMaxBorrows => ReadError::TooManyHeld {
                stream: self.stream.name,
                max: self.stream.max_held,
            },
            other => ReadError::transport(self.stream.name, other.to_string()),
        })
    }

    /// Checks a message and counts what is missing before it; `None` for leftovers of an older run, and for what
    /// is not the server's.
    fn accept(
        &mut self,
        sample: Sample<Service, [T], H>,
    ) -> Result<Option<Message<T, H>>, ReadError> {
        if !self.origin.is_servers(sample.origin()) {
            return Ok(None);
        }
        let header = sample.user_header();
        if header.count() != sample.payload().len() {
            return Err(ReadError::Malformed {
                stream: self.stream.name,
                announced: header.count(),
                actual: sample.payload().len(),
            });
        }
        if header.epoch() < self.epoch {
            return Ok(None);
        }
        let new_run = header.epoch() > self.epoch;
        let missed = if new_run {
            0
        } else {
            header.number().saturating_sub(self.next_number)
        };
        self.runs += u64::from(new_run);
        self.missed += missed;
        self.epoch = header.epoch();
        self.next_number = header.next_number();
        Ok(Some(Message {
            // The very first message starts a run, but not a new one.
            new_run: new_run && self.runs > 1,
            _subscriber: self.subscriber.clone(),
            sample,
            missed,
        }))
    }
}

fn subscribe<T: Debug + ZeroCopySend, H: StreamHeader>(
    service: &PubSub<T, H>,
    stream: Stream,
    depth: usize,
) -> Result<Subscriber<Service, [T], H>, SubscriberCreateError> {
    service
        .subscriber_builder()
        .buffer_size(depth)
        .history_request(stream.history.min(depth))
        .create()
}

/// A message may come without a wake-up: history after joining.
const LONGEST_WAIT: Duration = Duration::from_millis(20);
