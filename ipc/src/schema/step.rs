//! `step`: lock-step. A participant asks for steps with commands, and is answered when they are made and published.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::text::{TextError, padded, str_from_padded};

/// User header of a request on `step`; the payload is the commands that go with it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.StepRequest")]
#[repr(C)]
pub struct StepRequest {
    /// Number that orders the commands of a step and stands in the journal; see `docs/wire-format.md`.
    pub client: u64,
    /// Sender's process id.
    pub pid: u32,
    /// Commands in the request.
    pub count: u32,
    /// `STEP_*`.
    pub kind: u32,
    /// Steps asked for, 1 to 1,000,000; 0 for `STEP_ATTACH` and `STEP_DETACH`.
    pub frames: u32,
    /// Sum of `UNTIL_*`: what brings the answer before the last of these steps.
    pub until: u32,
    /// For `UNTIL_CONTACT`: what `pair[1]` is, `CONTACT_*`; 0 for either.
    pub pair_kind: u32,
    /// For `UNTIL_CONTACT`: object and other; `ANY` for whichever.
    pub pair: [u32; 2],
    /// Wall time after which the answer comes with the steps made until then [ns]; 0 for no limit.
    pub timeout_ns: u64,
    /// Name, 1 to 48 of the characters a-z A-Z 0-9 - _ . , zero-padded.
    pub participant: [u8; 48],
}

/// The sender takes part from now on, and every step waits for it. Without commands.
pub const STEP_ATTACH: u32 = 1;
/// The sender permits `frames` steps; the answer comes after the last frame was sent.
pub const STEP_ADVANCE: u32 = 2;
/// The sender takes part no more. Without commands.
pub const STEP_DETACH: u32 = 3;

/// Answer at the end of a step in which `pair` touches.
pub const UNTIL_CONTACT: u32 = 1;
/// Answer at the end of a step with an event: particles left the domain, an object fell apart, the state was set back.
pub const UNTIL_EVENT: u32 = 2;
/// Answer at the end of a step in which particles were frozen because their state stayed bad.
pub const UNTIL_QUARANTINE: u32 = 4;

/// Any object or collider.
pub const ANY: u32 = u32::MAX;

/// Most steps in a request.
pub const MAX_STEPS: u32 = 1_000_000;

/// User header of an answer on `step`; the payload is one `Ack` per command, in the same order.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.StepDone")]
#[repr(C)]
pub struct StepDone {
    /// Steps completed by the server; the frame of this step was sent.
    pub step: u64,
    /// Simulated time at the end of it [s].
    pub sim_time: f64,
    /// As in `frame`.
    pub epoch: u64,
    /// Hash of the state after it, as in `frame`.
    pub state_hash: u64,
    /// Wall time that the server spent on the steps of this request, publishing included [ns].
    pub step_ns: u64,
    /// Steps made for this request.
    pub frames: u32,
    /// `RETURN_*`.
    pub cause: u32,
    /// Answers in the payload.
    pub count: u32,
    /// For `RETURN_CONTACT`: what `contact[1]` is, `CONTACT_*`.
    pub contact_kind: u32,
    /// For `RETURN_CONTACT`: object and other.
    pub contact: [u32; 2],
    /// For all causes but `RETURN_COMPLETE` a sentence; UTF-8, zero-padded.
    pub reason: [u8; 128],
}

/// All was done as asked.
pub const RETURN_COMPLETE: u32 = 1;
/// The pair touches.
pub const RETURN_CONTACT: u32 = 2;
/// An event; `reason` says which.
pub const RETURN_EVENT: u32 = 3;
/// Particles were frozen.
pub const RETURN_QUARANTINE: u32 = 4;
/// The server ends, and no step follows.
pub const RETURN_TERMINATE: u32 = 5;
/// `timeout_ns` is over; `reason` names who was waited for.
pub const RETURN_TIMEOUT: u32 = 6;
/// The request is refused, all of its commands with it; `reason` says why.
pub const RETURN_REFUSED: u32 = 7;

impl Default for StepRequest {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl Default for StepDone {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl StepRequest {
    /// Name of the participant.
    pub fn participant(&self) -> Result<&str, TextError> {
        str_from_padded(&self.participant)
    }
}

impl StepDone {
    /// An answer with this cause and nothing else.
    pub fn of_cause(cause: u32, reason: &str) -> Self {
        Self {
            cause,
            reason: padded(reason),
            ..Self::zeroed()
        }
    }

    /// Why the answer came; empty for `RETURN_COMPLETE`.
    pub fn reason(&self) -> Result<&str, TextError> {
        str_from_padded(&self.reason)
    }
}
