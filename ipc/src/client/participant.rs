//! A participant in lock-step: every step of the server waits for it.

use std::time::Duration;

use rustix::{io::Errno, process::Pid};

use super::{Client, ConnectError, SendError, requests::RequestSender};
use crate::schema::{
    ANY, Ack, CONTACT_COLLIDER, CONTACT_OBJECT, Command, RETURN_COMPLETE, RETURN_REFUSED,
    RETURN_TERMINATE, STEP_ADVANCE, STEP_ATTACH, STEP_DETACH, StepDone, StepRequest, UNTIL_CONTACT,
    UNTIL_EVENT, UNTIL_QUARANTINE, padded,
};

/// How long a participant that goes waits for the server to know.
const FAREWELL: Duration = Duration::from_millis(200);

/// Why a participant makes no step.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// Not attached to the session.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// No answer.
    #[error(transparent)]
    Send(#[from] SendError),
    /// The name is none.
    #[error(
        "{name:?} is no participant's name: expected 1 to 48 of the characters a-z A-Z 0-9 - _ ."
    )]
    BadName {
        /// The text.
        name: String,
    },
    /// The server does not let it.
    #[error("participant {name:?} is refused: {reason}")]
    Refused {
        /// The participant.
        name: String,
        /// What the server says.
        reason: String,
    },
}

/// Whether a participant may have this name.
///
/// # Errors
/// [`StepError::BadName`] says what is expected.
pub fn check_participant(name: &str) -> Result<(), StepError> {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
    match (1..=48).contains(&name.len()) && name.bytes().all(plain) {
        true => Ok(()),
        false => Err(StepError::BadName { name: name.into() }),
    }
}

/// What brings the answer before the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Until {
    flags: u32,
    pair_kind: u32,
    pair: [u32; 2],
    timeout_ns: u64,
}

impl Until {
    /// Two objects touch.
    pub fn contact(self, object: u32, other: u32) -> Self {
        self.pair(CONTACT_OBJECT, [object, other])
    }

    /// An object touches a collider.
    pub fn contact_with_collider(self, object: u32, collider: u32) -> Self {
        self.pair(CONTACT_COLLIDER, [object, collider])
    }

    /// An object touches anything.
    pub fn any_contact(self, object: u32) -> Self {
        self.pair(0, [object, ANY])
    }

    fn pair(self, pair_kind: u32, pair: [u32; 2]) -> Self {
        let flags = self.flags | UNTIL_CONTACT;
        Self {
            flags,
            pair_kind,
            pair,
            ..self
        }
    }

    /// Particles leave the domain, an object falls apart, or the state is set back.
    pub fn event(self) -> Self {
        let flags = self.flags | UNTIL_EVENT;
        Self { flags, ..self }
    }

    /// Particles are frozen because their state stayed bad.
    pub fn quarantine(self) -> Self {
        let flags = self.flags | UNTIL_QUARANTINE;
        Self { flags, ..self }
    }

    /// This wall time is over: others may keep it waiting.
    pub fn timeout(self, timeout: Duration) -> Self {
        let timeout_ns = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX).max(1);
        Self { timeout_ns, ..self }
    }
}

/// The answer to a request for steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Stepped {
    /// Where the simulation is, and why it returned.
    pub done: StepDone,
    /// One answer per command, in their order.
    pub acks: Vec<Ack>,
}

impl Stepped {
    /// Whether all steps were made.
    pub fn is_complete(&self) -> bool {
        self.done.cause == RETURN_COMPLETE
    }

    /// Whether the session ends.
    pub fn is_last(&self) -> bool {
        self.done.cause == RETURN_TERMINATE
    }

    /// The first command that was refused: its index, and why.
    pub fn refusal(&self) -> Option<(usize, &str)> {
        let mut refused = self.acks.iter().enumerate();
        let (index, ack) = refused.find(|(_, ack)| !ack.is_accepted())?;
        Some((index, ack.reason().unwrap_or("no reason given")))
    }
}

/// A process whose permission every step needs. Dropped, it leaves: the others go on without it.
pub struct Participant {
    requests: RequestSender<StepRequest>,
    name: String,
    client: u64,
    server: u32,
    patience: Duration,
    attached: bool,
}

impl Client {
    /// Takes part in lock-step under `name`, waiting up to `patience` for this and every later answer. From the moment
    /// when this returns the server makes no step that the participant does not ask for.
    ///
    /// A server with another pace refuses; so does one where a living participant has the name.
    ///
    /// # Errors
    /// [`StepError`] says why not.
    pub fn participate(&self, name: &str, patience: Duration) -> Result<Participant, StepError> {
        check_participant(name)?;
        let mut participant = Participant {
            requests: RequestSender::open(&self.node, &self.session)?,
            name: name.into(),
            client: client_of(name),
            server: self.hello.pid,
            patience,
            attached: false,
        };
        participant.ask(STEP_ATTACH, 0, &[], Until::default(), patience)?;
        participant.attached = true;
        Ok(participant)
    }
}

impl Participant {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number that orders its commands among those of others in a step: made from the name, so that it is the same in
    /// every run.
    pub fn client_id(&self) -> u64 {
        self.client
    }

    /// Gives it another number.
    pub fn set_client_id(&mut self, client: u64) {
        self.client = client;
    }

    /// Has `frames` steps made, with up to 32 commands that take effect at the start of the first (or at their
    /// `apply_at_step`), and waits until the last frame was sent.
    ///
    /// # Errors
    /// When there is no answer, or the request is refused as a whole; a refused command is an answer.
    pub fn step(&mut self, frames: u32, commands: &[Command]) -> Result<Stepped, StepError> {
        self.step_until(frames, commands, Until::default())
    }

    /// As [`step`](Self::step), but for what brings the answer earlier.
    ///
    /// # Errors
    /// As there.
    pub fn step_until(
        &mut self,
        frames: u32,
        commands: &[Command],
        until: Until,
    ) -> Result<Stepped, StepError> {
        self.ask(STEP_ADVANCE, frames, commands, until, self.patience)
    }

    fn ask(
        &mut self,
        kind: u32,
        frames: u32,
        commands: &[Command],
        until: Until,
        patience: Duration,
    ) -> Result<Stepped, StepError> {
        let header = StepRequest {
            client: self.client,
            pid: std::process::id(),
            count: commands.len() as u32,
            kind,
            frames,
            until: until.flags,
            pair_kind: until.pair_kind,
            pair: until.pair,
            timeout_ns: until.timeout_ns,
            participant: padded(&self.name),
        };
        // It takes part with one server: the next one knows nothing of it.
        let awaits_server = kind == STEP_ATTACH;
        let sent = self
            .requests
            .submit(header, commands, patience, awaits_server)?;
        let server = self.server;
        let (done, acks) = self.requests.answers(&sent, patience, || lives(server))?;
        if done.cause == RETURN_REFUSED {
            return Err(StepError::Refused {
                name: self.name.clone(),
                reason: done.reason().unwrap_or("no reason given").into(),
            });
        }
        Ok(Stepped { done, acks })
    }
}

impl Drop for Participant {
    fn drop(&mut self) {
        if self.attached {
            // The server notices a port that is gone as well, but takes it for a crash.
            let _ = self.ask(STEP_DETACH, 0, &[], Until::default(), FAREWELL);
        }
    }
}

/// 64-bit FNV-1a hash of the name.
fn client_of(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Whether there is a process of this number.
fn lives(pid: u32) -> bool {
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw);
    pid.is_none_or(|pid| rustix::process::test_kill_process(pid) != Err(Errno::SRCH))
}
