//! `command` and `journal`: orders to the simulation, their answers, and the record of what was applied.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::text::{TextError, padded, str_from_padded};

/// `Command::kind`: add `vector` [N s] to the momentum of `object`.
pub const COMMAND_IMPULSE: u32 = 1;
/// Impulse `vector` [N s] on the particles of `object` within `radius` of `point`.
pub const COMMAND_IMPULSE_AT: u32 = 2;
/// Give `object` the velocity `vector` [m/s] and the spin `point` [rad/s].
pub const COMMAND_SET_VELOCITY: u32 = 3;
/// Give `object`, or one region of it, the material `material`; mass stays. With a `radius` only what is within it of `point`,
/// with `vector` only what is in the box about `point` with these half edges [m].
pub const COMMAND_SET_MATERIAL: u32 = 4;
/// Set gravity to `vector` [m/s^2].
pub const COMMAND_SET_GRAVITY: u32 = 5;
/// Stop stepping before the next step.
pub const COMMAND_PAUSE: u32 = 6;
/// Step again.
pub const COMMAND_RESUME: u32 = 7;
/// Back to the initial state.
pub const COMMAND_RESET: u32 = 8;
/// Shut the server down cleanly.
pub const COMMAND_STOP: u32 = 9;

/// Move collider number `object` so that at the end of the frame its origin is at `vector` [m], turned by the rotation
/// vector `point` [rad].
pub const COMMAND_MOVE_COLLIDER: u32 = 10;
/// Hold the particles of `object` that are within `radius` of `point` now; all of them when `radius` is 0.
pub const COMMAND_PIN: u32 = 11;
/// Let go what `COMMAND_PIN` holds of `object`.
pub const COMMAND_RELEASE: u32 = 12;

/// Write a checkpoint of the state before `apply_at_step`; the answer's `reason` is the file's path.
pub const COMMAND_CHECKPOINT: u32 = 13;

/// Force `vector` [N] and torque `point` [N m] about the centre of mass on `object` during the step.
pub const COMMAND_FORCE: u32 = 14;
/// Force `vector` [N] during the step on the particles of `object` within `radius` of `point`.
pub const COMMAND_FORCE_AT: u32 = 15;
/// Move collider number `object` with velocity `vector` [m/s] and spin `point` [rad/s] during the step; then it stands.
pub const COMMAND_COLLIDER_VELOCITY: u32 = 16;
/// Keep the state in the server's memory as snapshot number `object`, in place of a former one of that number.
pub const COMMAND_SAVE: u32 = 17;
/// Back to the state of snapshot number `object`; the step count goes on.
pub const COMMAND_RESTORE: u32 = 18;
/// Make `object` steps while the server is paused, 1 to 1,000,000; answered when the last frame was sent.
pub const COMMAND_STEP: u32 = 19;
/// Have a replay go to `apply_at_step`, or to the first recorded step behind it; servers that simulate refuse it.
pub const COMMAND_SEEK: u32 = 20;
/// Hold the particles of `object` that are within `radius` of `point` by a spring that pulls the point to `vector` [m], for
/// `material.region` steps without `COMMAND_DRAG`, 0 for 60.
pub const COMMAND_GRAB: u32 = 21;
/// Pull what the sender holds of `object` to `vector` [m], where the spring's end is when the step ends.
pub const COMMAND_DRAG: u32 = 22;
/// Let go what the sender holds of `object`.
pub const COMMAND_LET_GO: u32 = 23;
/// Put `object` at rest with its centre of mass at `vector` [m], turned since rest by the rotation vector `point` [rad];
/// `material.region` is 0 or `POSE_*` flags.
pub const COMMAND_SET_POSE: u32 = 24;
/// Model `object` as `material.region` says: 1 as one body that stands, 2 as matter, 3 with as little as allowed, 4 as one
/// body.
pub const COMMAND_SET_FIDELITY: u32 = 25;
/// Take `object` out of the world; it keeps its number.
pub const COMMAND_REMOVE: u32 = 26;
/// Bring `object` in that was removed or is absent from the beginning, at a pose as of `COMMAND_SET_POSE`.
pub const COMMAND_BRING_IN: u32 = 27;
/// Back to the state right before the newest edit; the step count goes on.
pub const COMMAND_UNDO: u32 = 28;
/// Back to the state that the newest `COMMAND_UNDO` left; the step count goes on.
pub const COMMAND_REDO: u32 = 29;
/// Drop the orders that wait for their step, at once: `object` 0 those of the sender's `client` number, 1 those of all.
pub const COMMAND_CANCEL: u32 = 30;

/// Kinds of commands with their names, for people and for recordings.
const COMMAND_NAMES: [(u32, &str); 30] = [
    (COMMAND_IMPULSE, "impulse"),
    (COMMAND_IMPULSE_AT, "impulse_at"),
    (COMMAND_SET_VELOCITY, "set_velocity"),
    (COMMAND_SET_MATERIAL, "set_material"),
    (COMMAND_SET_GRAVITY, "set_gravity"),
    (COMMAND_PAUSE, "pause"),
    (COMMAND_RESUME, "resume"),
    (COMMAND_RESET, "reset"),
    (COMMAND_STOP, "stop"),
    (COMMAND_MOVE_COLLIDER, "move_collider"),
    (COMMAND_PIN, "pin"),
    (COMMAND_RELEASE, "release"),
    (COMMAND_CHECKPOINT, "checkpoint"),
    (COMMAND_FORCE, "force"),
    (COMMAND_FORCE_AT, "force_at"),
    (COMMAND_COLLIDER_VELOCITY, "collider_velocity"),
    (COMMAND_SAVE, "save"),
    (COMMAND_RESTORE, "restore"),
    (COMMAND_STEP, "step"),
    (COMMAND_SEEK, "seek"),
    (COMMAND_GRAB, "grab"),
    (COMMAND_DRAG, "drag"),
    (COMMAND_LET_GO, "let_go"),
    (COMMAND_SET_POSE, "set_pose"),
    (COMMAND_SET_FIDELITY, "set_fidelity"),
    (COMMAND_REMOVE, "remove"),
    (COMMAND_BRING_IN, "bring_in"),
    (COMMAND_UNDO, "undo"),
    (COMMAND_REDO, "redo"),
    (COMMAND_CANCEL, "cancel"),
];

/// Name of a kind of command, `unknown` where this version has none.
pub fn command_name(kind: u32) -> &'static str {
    let known = COMMAND_NAMES.iter().find(|(known, _)| *known == kind);
    known.map_or("unknown", |(_, name)| name)
}

/// Flag of a pose: the object keeps its place, and `vector` is not read.
pub const POSE_KEEP_PLACE: u32 = 1;
/// Flag of a pose: the object keeps its rotation, and `point` is not read.
pub const POSE_KEEP_ROTATION: u32 = 2;

/// Law and parameters of a material; `docs/wire-format.md` lists the laws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.MaterialSpec")]
#[repr(C)]
pub struct MaterialSpec {
    /// Constitutive law, 1 to 10.
    pub law: u32,
    /// 0 for the whole object, `n` for its region `n`, counted from 1. Of `COMMAND_GRAB` a number of steps, of
    /// `COMMAND_SET_POSE` and `COMMAND_BRING_IN` flags, of `COMMAND_SET_FIDELITY` a level.
    pub region: u32,
    /// Young's modulus [Pa]; not read for fluid and rigid matter.
    pub youngs_modulus: f64,
    /// Poisson's ratio; not read for fluid and rigid matter.
    pub poisson_ratio: f64,
    /// What else the law needs, in the order of `docs/wire-format.md`; the rest zero.
    pub parameters: [f64; 4],
}

/// One order. Fields that a kind does not name are zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.Command")]
#[repr(C)]
pub struct Command {
    /// `COMMAND_*`.
    pub kind: u32,
    /// Object id, or another number; see the kinds.
    pub object: u32,
    /// The sender's running number.
    pub sequence: u64,
    /// Step at whose start it takes effect; 0 or a past step means the next one.
    pub apply_at_step: u64,
    /// Main vector; see the kinds.
    pub vector: [f64; 3],
    /// Point [m], or the second vector; see the kinds.
    pub point: [f64; 3],
    /// Radius [m].
    pub radius: f64,
    /// For `COMMAND_SET_MATERIAL`; of other kinds `region` alone, where they say so.
    pub material: MaterialSpec,
}

/// User header of a request with commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.CommandHeader")]
#[repr(C)]
pub struct CommandHeader {
    /// Random number that identifies the sender for the life of its process.
    pub client: u64,
    /// Sender's process id.
    pub pid: u32,
    /// Commands in the request.
    pub count: u32,
}

/// Answer to one command; a response holds one per command of the request, in the same order.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.Ack")]
#[repr(C)]
pub struct Ack {
    /// Sequence of the command answered.
    pub sequence: u64,
    /// Step at whose start it takes effect.
    pub applied_at_step: u64,
    /// `ACK_*`.
    pub status: u32,
    /// Zero.
    pub reserved: u32,
    /// For refusals a sentence with expected and actual values, for checkpoints the path; UTF-8, zero-padded.
    pub reason: [u8; 168],
}

/// The command takes effect at `applied_at_step`.
pub const ACK_ACCEPTED: u32 = 1;
/// The command is refused and changes nothing; see `reason`.
pub const ACK_REFUSED: u32 = 2;

/// One entry of `journal`: a command as it was applied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.AppliedCommand")]
#[repr(C)]
pub struct AppliedCommand {
    /// Step at whose start it took effect.
    pub step: u64,
    /// Who sent it.
    pub client: u64,
    /// The command.
    pub command: Command,
}

/// User header of `journal`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.JournalHeader")]
#[repr(C)]
pub struct JournalHeader {
    /// Step at whose start the commands took effect.
    pub step: u64,
    /// As in `frame`.
    pub epoch: u64,
    /// Commands journalled in this epoch before this message; a jump shows that messages were lost.
    pub first: u64,
    /// Commands in this message.
    pub count: u32,
    /// Zero.
    pub reserved: u32,
}

/// Commands that one request and one journal message hold at most.
pub const MAX_COMMANDS: usize = 32;

impl Ack {
    /// The command with this `sequence` takes effect at the start of `step`.
    pub fn accepted(sequence: u64, step: u64) -> Self {
        Self {
            sequence,
            applied_at_step: step,
            status: ACK_ACCEPTED,
            reserved: 0,
            reason: [0; 168],
        }
    }

    /// The command with this `sequence` takes effect at the start of `step` and makes the file at `path`, which has
    /// at most 168 bytes.
    pub fn accepted_with_file(sequence: u64, step: u64, path: &str) -> Self {
        Self {
            reason: padded(path),
            ..Self::accepted(sequence, step)
        }
    }

    /// The command with this `sequence` is refused; a longer `reason` is cut at a character.
    pub fn refused(sequence: u64, reason: &str) -> Self {
        Self {
            sequence,
            applied_at_step: 0,
            status: ACK_REFUSED,
            reserved: 0,
            reason: padded(reason),
        }
    }

    /// Whether the command takes effect.
    pub fn is_accepted(&self) -> bool {
        self.status == ACK_ACCEPTED
    }

    /// Why the command was refused; empty when accepted.
    pub fn reason(&self) -> Result<&str, TextError> {
        str_from_padded(&self.reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_command_has_its_name() {
        let mut count = 0;
        for line in include_str!("command.rs").lines() {
            let constant = line.strip_prefix("pub const COMMAND_");
            let Some((name, kind)) = constant.and_then(|rest| rest.split_once(": u32 = ")) else {
                continue;
            };
            let kind = kind.trim_end_matches(';').parse().expect("a number");
            assert_eq!(command_name(kind), name.to_lowercase());
            count += 1;
        }
        assert_eq!(count, COMMAND_NAMES.len());
        assert_eq!(command_name(u32::MAX), "unknown");
    }
}
