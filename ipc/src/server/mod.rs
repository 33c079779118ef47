//! The serving side of a session: frames written in place, scene, objects, journal, status, commands.

mod changes;
mod commands;
mod error;
mod frame;
mod lock;
mod monitor;
mod nodes;
mod pool;
mod publish;
mod repeated;
mod scene;
mod status;

use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use iceoryx2::{
    node::Node,
    port::{notifier::Notifier, publisher::PublisherCreateError},
    prelude::{EventId, PortFactory},
};

pub use changes::{ChangesLoan, ChangesReaders};
pub use commands::{Answer, Asked, Departed, Reply};
pub use error::{CreateError, LoanRefused, PublishError};
pub use frame::FrameLoan;
pub use pool::PoolPlan;
pub use scene::SceneBlocks;

use crate::{
    Domain, LimitReached, Service,
    limits::SERVER_FILES,
    schema::{
        Ack, AppliedCommand, ChangesHeader, CommandHeader, Contact, ContactsHeader, FrameHeader,
        GaussianState, Hello, JournalHeader, MAX_COMMANDS, ObjectState, ObjectsHeader, Status,
        StepDone, StepRequest,
    },
    session::{self, EVENT_SAMPLE, PubSub, SERVER_ROLE, SessionName},
    shm,
};
use changes::ChangesPort;
use commands::{RequestPort, Wake};
use lock::SessionLock;
use monitor::Monitor;
use nodes::Fallen;
use publish::{Publisher, copy_and_send, publisher};
use status::StatusPort;

/// All ports of a serving process. Dropping it ends the session.
pub struct ServerPorts {
    // First, so that no other thread uses the ports when they go.
    monitor: Monitor,
    frame: Arc<Publisher<GaussianState, FrameHeader>>,
    frame_notifier: Arc<Notifier<Service>>,
    changes: ChangesPort,
    objects: Arc<Publisher<ObjectState, ObjectsHeader>>,
    contacts: Arc<Publisher<Contact, ContactsHeader>>,
    contacts_service: PubSub<Contact, ContactsHeader>,
    journal: Arc<Publisher<AppliedCommand, JournalHeader>>,
    status: Arc<StatusPort>,
    wake: Wake,
    steps: RequestPort<StepRequest>,
    commands: RequestPort<CommandHeader>,
    session: SessionName,
    root: PathBuf,
    node: Node<Service>,
    plan: PoolPlan,
    slots: usize,
    epoch: u64,
    journalled: u64,
    _hello: Arc<iceoryx2::port::publisher::Publisher<Service, Hello, ()>>,
    // Last: the services are gone before another server makes its own.
    _lock: SessionLock,
}

impl ServerPorts {
    /// Takes `session` in `domain`, makes its services and sets all their memory aside.
    pub fn create(domain: &Domain, session: &str, plan: &PoolPlan) -> Result<Self, CreateError> {
        Self::create_replay(domain, session, plan, [0; 2])
    }

    /// Like [`create`](Self::create), for a replay of a recording with this first and last step.
    pub fn create_replay(
        domain: &Domain,
        session: &str,
        plan: &PoolPlan,
        recorded: [u64; 2],
    ) -> Result<Self, CreateError> {
        let session = SessionName::new(session)?;
        let name = session.as_str().to_owned();
        Self::make(domain, session, plan, recorded).map_err(|error| error.explained(&name))
    }

    fn make(
        domain: &Domain,
        session: SessionName,
        plan: &PoolPlan,
        recorded: [u64; 2],
    ) -> Result<Self, CreateError> {
        // Now: later, a reader that cannot be connected to would look like one that is not there.
        if let Some(limit) = LimitReached::files(SERVER_FILES) {
            return Err(CreateError::Limit {
                session: session.as_str().into(),
                limit,
            });
        }
        let node = domain.join(SERVER_ROLE)?;
        let lock = SessionLock::take(domain, &session)?;
        let epoch = lock.epoch();
        let greeting = Hello {
            recorded_first: recorded[0],
            recorded_last: recorded[1],
            ..Hello::of_this_program(epoch)
        };
        let hello = greet(&node, &session, greeting)?;

        let slots = plan.slots(shm::available_bytes())?;
        let frame = publisher(
            &node,
            &session,
            session::FRAME,
            plan.gaussian_count,
            slots,
            slots,
        )?;
        frame::touch_every_page(&frame, plan.gaussian_count, slots)?;
        let size = (plan.object_count, plan.gaussian_count);
        let changes = ChangesPort::create(&node, &session, size, slots)?;
        let objects = publisher(
            &node,
            &session,
            session::OBJECTS,
            plan.object_count,
            pool::OBJECTS_SLOTS,
            1,
        )?;
        let contacts = publisher(
            &node,
            &session,
            session::CONTACTS,
            plan.contact_count(),
            pool::CONTACTS_SLOTS,
            1,
        )?;
        let contacts_service = session::pub_sub(&node, &session, session::CONTACTS, false)
            .map_err(|error| CreateError::open(session.as_str(), "find a service", error))?;
        let journal = publisher(
            &node,
            &session,
            session::JOURNAL,
            MAX_COMMANDS,
            pool::JOURNAL_SLOTS,
            1,
        )?;
        let status = Arc::new(StatusPort::create(&node, &session, epoch)?);
        let frame_notifier = Arc::new(sample_notifier(&node, &session, session::FRAME.name)?);
        let fallen = Fallen::default();
        let steps = RequestPort::create(&node, &session, &fallen)?;
        // The last of the services: who finds its event finds all.
        let commands = RequestPort::create(&node, &session, &fallen)?;
        let wake = Wake::create(&node, &session)?;
        let monitor = Monitor::start(
            domain,
            vec![
                hello.clone(),
                frame.clone(),
                objects.clone(),
                contacts.clone(),
                journal.clone(),
                status.publisher(),
            ],
            status.clone(),
            fallen,
            lock.entry().clone(),
        )?;
        Ok(Self {
            monitor,
            frame,
            frame_notifier,
            changes,
            objects,
            contacts,
            contacts_service,
            journal,
            status,
            wake,
            steps,
            commands,
            session,
            root: domain.root().into(),
            node,
            plan: *plan,
            slots,
            epoch,
            journalled: 0,
            _hello: hello,
            _lock: lock,
        })
    }

    /// Name of the session.
    pub fn session(&self) -> &str {
        self.session.as_str()
    }

    /// Identifies this run and its published scene; every header carries it.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Frames in the pool.
    pub fn frame_slots(&self) -> usize {
        self.slots
    }

    /// Memory for a frame of `count` Gaussians, to be written in place. Never blocks.
    pub fn loan_frame(&self, count: usize) -> Result<FrameLoan, LoanRefused> {
        if count > self.plan.gaussian_count {
            return Err(LoanRefused::TooLarge {
                count,
                max: self.plan.gaussian_count,
            });
        }
        let loan = FrameLoan::new(
            &self.frame,
            &self.frame_notifier,
            count,
            self.epoch,
            self.slots,
        );
        if let Err(LoanRefused::PoolInUse { .. }) = loan {
            // Perhaps the readers that hold the pool are dead.
            self.monitor.ask_cleanup();
        }
        loan
    }

    /// Like [`loan_frame`](Self::loan_frame), but waits up to `timeout` for readers to give memory back.
    pub fn loan_frame_within(
        &self,
        count: usize,
        timeout: Duration,
    ) -> Result<FrameLoan, LoanRefused> {
        let deadline = Instant::now() + timeout;
        loop {
            match self.loan_frame(count) {
                Err(LoanRefused::PoolInUse { .. }) if Instant::now() < deadline => {
                    std::thread::sleep(Duration::from_millis(1));
                    self.monitor.update_connections();
                }
                other => return other,
            }
        }
    }

    /// Who reads `changes` now. Memory for messages is set aside when there is somebody for the first time; where it
    /// cannot be had, that is nobody.
    pub fn changes_readers(&mut self) -> ChangesReaders {
        let readers = self.changes.readers();
        if readers == ChangesReaders::None {
            return readers;
        }
        match self.changes.open(&self.node, &self.session) {
            Ok(port) => {
                self.monitor.add(port);
                readers
            }
            Err(error) => {
                self.changes.fail(&error);
                ChangesReaders::None
            }
        }
    }

    /// Whether there is memory for `changes`, as far as is known.
    pub fn can_send_changes(&self) -> bool {
        !self.changes.has_failed()
    }

    /// Memory for a message of `changes` with so many rows and Gaussians. Never blocks.
    pub fn loan_changes(
        &self,
        objects: usize,
        gaussians: usize,
    ) -> Result<ChangesLoan, LoanRefused> {
        let loan = self.changes.loan(objects, gaussians, self.epoch);
        if let Err(LoanRefused::PoolInUse { .. }) = loan {
            self.monitor.ask_cleanup();
        }
        loan
    }

    /// Publishes a message of `changes`; `epoch`, `count`, `objects` and `publish_ns` are filled in. `wakes` readers where no
    /// frame follows that does.
    pub fn send_changes(
        &self,
        loan: ChangesLoan,
        header: &ChangesHeader,
        wakes: bool,
    ) -> Result<(), PublishError> {
        loan.send(header)?;
        if wakes {
            notify(&self.frame_notifier);
        }
        Ok(())
    }

    /// Publishes the objects of a step; `epoch` and `count` are filled in.
    pub fn publish_objects(
        &mut self,
        header: &ObjectsHeader,
        objects: &[ObjectState],
    ) -> Result<(), PublishError> {
        let header = ObjectsHeader {
            epoch: self.epoch,
            count: objects.len() as u32,
            reserved: 0,
            ..*header
        };
        copy_and_send(
            &self.objects,
            session::OBJECTS.name,
            self.plan.object_count,
            header,
            objects,
        )
    }

    /// Whether anybody reads `contacts`.
    pub fn contacts_are_read(&self) -> bool {
        self.contacts_service
            .dynamic_config()
            .number_of_subscribers()
            > 0
    }

    /// Publishes the contacts of a step, the strongest where they do not fit a message; `epoch`, `count` and `total`
    /// are filled in.
    pub fn publish_contacts(
        &mut self,
        header: &ContactsHeader,
        contacts: &[Contact],
    ) -> Result<(), PublishError> {
        let most = self.plan.contact_count();
        let size = |c: &Contact| c.impulse.iter().map(|x| x * x).sum::<f64>();
        let mut kept = contacts.to_vec();
        if kept.len() > most {
            kept.sort_by(|a, b| size(b).total_cmp(&size(a)));
            kept.truncate(most);
        }
        let header = ContactsHeader {
            epoch: self.epoch,
            count: kept.len() as u32,
            total: contacts.len() as u32,
            ..*header
        };
        copy_and_send(&self.contacts, session::CONTACTS.name, most, header, &kept)
    }

    /// Publishes commands that took effect at the start of `step`, in the order of their application.
    pub fn publish_journal(
        &mut self,
        step: u64,
        commands: &[AppliedCommand],
    ) -> Result<(), PublishError> {
        for chunk in commands.chunks(MAX_COMMANDS) {
            let header = JournalHeader {
                step,
                epoch: self.epoch,
                first: self.journalled,
                count: chunk.len() as u32,
                reserved: 0,
            };
            copy_and_send(
                &self.journal,
                session::JOURNAL.name,
                MAX_COMMANDS,
                header,
                chunk,
            )?;
            self.journalled += chunk.len() as u64;
        }
        Ok(())
    }

    /// Publishes the scene for clients of now and later, in place of a former one.
    pub fn publish_scene(&mut self, scene: &SceneBlocks) -> Result<(), CreateError> {
        let ports = scene.publish(&self.node, &self.session, self.epoch)?;
        self.monitor.set_scene(ports);
        Ok(())
    }

    /// Publishes the newest status; `heartbeat_ns`, `epoch`, `pid` and `frame_readers` are filled in. It is sent
    /// again every 100 ms until the next, whatever the caller is doing.
    pub fn update_status(&self, status: &Status) -> Result<(), PublishError> {
        self.status.update(status)
    }

    /// Hands waiting requests to `answer`, one of each client in turn, until there are none or it has no time for
    /// more. Returns the number answered at once.
    pub fn poll_commands(&mut self, answer: impl FnMut(Asked) -> Reply) -> usize {
        self.commands.poll(answer)
    }

    /// Hands those requests to `answer` that are the first of their client and, by their commands, `cannot_wait`, while others have to:
    /// amid a frame.
    pub fn poll_urgent(
        &mut self,
        cannot_wait: impl Fn(&[crate::schema::Command]) -> bool,
        answer: impl FnMut(Asked) -> Reply,
    ) {
        self.commands.poll_urgent(cannot_wait, answer);
    }

    /// Answers the request of `ticket`, to which the reply was [`Reply::Later`]: one answer per command. Nothing
    /// happens if its sender is gone.
    pub fn answer(&mut self, ticket: u64, acks: Vec<Ack>) {
        self.commands.answer(ticket, acks);
    }

    /// The ports that sent commands and have gone since the last look. A port shows as gone when requests are looked for;
    /// that of a dead process when that is noticed, after some 100 ms.
    pub fn departed(&mut self) -> Vec<Departed> {
        // Who takes part is watched by `participant_ports`.
        self.steps.departed();
        self.commands.departed()
    }

    /// Sleeps until a request comes, a signal arrives or `timeout` is over; says whether to look for requests. Does
    /// not sleep while there are requests that [`Reply::NotYet`] left waiting.
    pub fn wait(&self, timeout: Duration) -> bool {
        self.commands.is_waiting() || self.wait_for_participants(timeout)
    }

    /// As [`wait`](Self::wait), though commands wait that [`Reply::NotYet`] put off: says whether to look for requests of
    /// participants.
    pub fn wait_for_participants(&self, timeout: Duration) -> bool {
        self.steps.is_waiting() || self.wake.wait(timeout)
    }

    /// Hands waiting requests of participants to `answer`, as [`poll_commands`](Self::poll_commands) does. The header of
    /// an answer gets `epoch` and `count`.
    pub fn poll_steps(
        &mut self,
        mut answer: impl FnMut(Asked<StepRequest>) -> Reply<(StepDone, Vec<Ack>)>,
    ) -> usize {
        let epoch = self.epoch;
        self.steps.poll(|asked| match answer(asked) {
            Reply::Now((done, acks)) => Reply::Now((StepDone { epoch, ..done }, acks)),
            other => other,
        })
    }

    /// Answers a request of a participant, to which the reply was [`Reply::Later`].
    pub fn answer_steps(&mut self, ticket: u64, (done, acks): (StepDone, Vec<Ack>)) {
        let epoch = self.epoch;
        self.steps
            .answer(ticket, (StepDone { epoch, ..done }, acks));
    }

    /// Whether the sender of the request of `ticket` on `step` still waits for its answer.
    pub fn participant_waits(&self, ticket: u64) -> bool {
        self.steps.is_held(ticket)
    }

    /// The ports on `step` that are attached; that of a dead process goes when the process is noticed, after some 100 ms.
    pub fn participant_ports(&mut self) -> impl Iterator<Item = u128> {
        self.steps.ports()
    }

    /// Why the session has to end, if somebody removed the files by which others find it: a second server could take its name,
    /// and nobody could end it but by a signal. It is noticed within 100 ms.
    ///
    /// # Errors
    /// [`PublishError::Lost`] then.
    pub fn check_place(&self) -> Result<(), PublishError> {
        match self.monitor.is_lost() {
            false => Ok(()),
            true => Err(PublishError::Lost {
                session: self.session().into(),
                root: self.root.clone(),
            }),
        }
    }

    /// Serves late joiners now; without, they wait for the monitor's next look, 20 ms at most.
    pub fn maintain(&self) {
        self.monitor.update_connections();
    }
}

/// Says who serves the session.
fn greet(
    node: &Node<Service>,
    session: &SessionName,
    greeting: Hello,
) -> Result<Arc<iceoryx2::port::publisher::Publisher<Service, Hello, ()>>, CreateError> {
    const WHAT: &str = "make the hello service";
    let failed = |reason: String| CreateError::Transport { what: WHAT, reason };
    let service = session::hello(node, session, true)
        .map_err(|error| CreateError::open(session.as_str(), WHAT, error))?;
    let mut attempts = 0;
    let publisher = loop {
        match service.publisher_builder().max_loaned_samples(1).create() {
            Ok(publisher) => break publisher,
            // The session is ours, so this is the place of a server that died.
            Err(PublisherCreateError::ExceedsMaxSupportedPublishers) if attempts < 20 => {
                attempts += 1;
                node.try_cleanup_dead_nodes();
                std::thread::sleep(Duration::from_millis(50));
            }
            Err(error) => return Err(failed(error.to_string())),
        }
    };
    pool::reserve(publisher.id().value())?;
    let hello = publisher
        .loan_uninit()
        .map_err(|error| failed(error.to_string()))?
        .write_payload(greeting);
    hello.send().map_err(|error| failed(error.to_string()))?;
    Ok(Arc::new(publisher))
}

fn sample_notifier(
    node: &Node<Service>,
    session: &SessionName,
    stream: &'static str,
) -> Result<Notifier<Service>, CreateError> {
    session::event(node, session, stream, true)
        .map_err(|error| CreateError::open(session.as_str(), "make an event service", error))?
        .notifier_builder()
        .default_event_id(EventId::new(EVENT_SAMPLE))
        .create()
        .map_err(|error| CreateError::Transport {
            what: "make a notifier",
            reason: error.to_string(),
        })
}

/// A wake-up that fails only costs the sleeper time.
fn notify(notifier: &Notifier<Service>) {
    if let Err(error) = notifier.notify() {
        tracing::debug!(?error, "a listener was not woken");
    }
}
