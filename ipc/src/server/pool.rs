//! How much memory a session takes, and how many frames its pool gets.

use super::{CreateError, SceneBlocks, commands::response_slots};
use crate::{
    schema::{
        Ack, AppliedCommand, CommandHeader, Contact, GaussianState, MAX_COMMANDS, ObjectState,
        Status, StepRequest,
    },
    session::{FRAME, MAX_ACKS, MAX_ATTACHED, MAX_SUBSCRIBERS, STATUS},
    shm::{self, ReserveError},
};

/// Frames that are worth having when they are small.
const COMFORTABLE_BYTES: u64 = 256 << 20;
/// One being written, one kept for late joiners, two each for two viewers, and some for a recorder's queue.
const FEWEST_SLOTS: usize = 8;
const USUAL_SLOTS: usize = 16;
/// Two recorders with full queues and a few viewers.
const MOST_SLOTS: usize = 160;
/// One is kept for late joiners while the next is written.
const FEWEST_ASKED_SLOTS: usize = 2;
/// With every reader's queue full and as many held as may be, one kept and one being written: more are never used.
const MOST_ASKED_SLOTS: usize = MAX_SUBSCRIBERS * (FRAME.max_depth + FRAME.max_held) + 2;
/// Room for what iceoryx2 keeps per service and connection.
const OVERHEAD_BYTES: u64 = 8 << 20;
/// System header, frame header and alignment of a chunk.
const CHUNK_OVERHEAD: usize = 192;

/// Objects messages kept: a full queue of each depth, and what readers hold.
pub(super) const OBJECTS_SLOTS: usize = 128;
/// Contacts messages kept.
pub(super) const CONTACTS_SLOTS: usize = 80;
/// Contacts in a message at most, per object and in any case: bodies have few neighbours.
const CONTACTS_PER_OBJECT: usize = 12;
const FEWEST_CONTACTS: usize = 16;
/// Journal messages kept: the history, and what readers hold.
pub(super) const JOURNAL_SLOTS: usize = 320;
/// Status messages kept: what waits for each reader and what it holds may all be different ones.
pub(super) const STATUS_SLOTS: usize = MAX_ATTACHED * (STATUS.max_depth + STATUS.max_held) + 2;

/// What a session needs room for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoolPlan {
    /// Gaussians in a frame at most.
    pub gaussian_count: usize,
    /// Objects in a message at most.
    pub object_count: usize,
    /// Bytes of all scene blocks.
    pub scene_bytes: u64,
    /// Frames in the pool, 2 to 2306; `None` chooses by frame size and the memory there is (16 to 160, never below 8).
    pub frame_slots: Option<usize>,
}

impl PoolPlan {
    /// Room for the frames of `scene`.
    pub fn new(scene: &SceneBlocks) -> Self {
        Self {
            gaussian_count: scene.gaussians.len(),
            object_count: scene.objects.len(),
            scene_bytes: scene.bytes(),
            frame_slots: None,
        }
    }

    fn frame_bytes(&self) -> u64 {
        (self.gaussian_count * size_of::<GaussianState>() + CHUNK_OVERHEAD) as u64
    }

    /// Contacts in a message at most.
    pub(super) fn contact_count(&self) -> usize {
        (CONTACTS_PER_OBJECT * self.object_count).max(FEWEST_CONTACTS)
    }

    /// Shared memory that the session takes with a pool of `slots` frames [byte].
    pub fn required_bytes(&self, slots: usize) -> u64 {
        let messages = |slots, item: usize, count| (slots * (item * count + CHUNK_OVERHEAD)) as u64;
        slots as u64 * self.frame_bytes()
            + messages(OBJECTS_SLOTS, size_of::<ObjectState>(), self.object_count)
            + messages(JOURNAL_SLOTS, size_of::<AppliedCommand>(), MAX_COMMANDS)
            + messages(STATUS_SLOTS, size_of::<Status>(), 1)
            + messages(CONTACTS_SLOTS, size_of::<Contact>(), self.contact_count())
            + messages(
                response_slots::<CommandHeader>(),
                size_of::<Ack>(),
                MAX_ACKS,
            )
            + messages(response_slots::<StepRequest>(), size_of::<Ack>(), MAX_ACKS)
            + self.scene_bytes
            + OVERHEAD_BYTES
    }

    /// Frames in the pool, or why they do not fit.
    pub(super) fn slots(&self, available: u64) -> Result<usize, CreateError> {
        let possible = FEWEST_ASKED_SLOTS..=MOST_ASKED_SLOTS;
        if let Some(slots) = self.frame_slots.filter(|slots| !possible.contains(slots)) {
            return Err(CreateError::FrameSlots {
                slots,
                min: FEWEST_ASKED_SLOTS,
                max: MOST_ASKED_SLOTS,
            });
        }
        let usual = (COMFORTABLE_BYTES / self.frame_bytes()) as usize;
        let wanted = self
            .frame_slots
            .unwrap_or(usual.clamp(USUAL_SLOTS, MOST_SLOTS));
        let fewest = self.frame_slots.unwrap_or(FEWEST_SLOTS);
        (fewest..=wanted)
            .rev()
            .find(|&slots| self.required_bytes(slots) <= available)
            .ok_or(CreateError::ShmTooSmall {
                required: self.required_bytes(fewest),
                available,
            })
    }
}

/// Makes the system set aside every page of the data segment of the port `id`.
pub(super) fn reserve(id: u128) -> Result<(), CreateError> {
    shm::reserve(id).map_err(|error| match error {
        ReserveError::TooSmall {
            required,
            available,
        } => CreateError::ShmTooSmall {
            required,
            available,
        },
        other => CreateError::Transport {
            what: "reserve shared memory",
            reason: other.to_string(),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: PoolPlan = PoolPlan {
        gaussian_count: 100_000,
        object_count: 3,
        scene_bytes: 1 << 20,
        frame_slots: None,
    };

    #[test]
    fn the_pool_shrinks_with_the_memory_and_then_refuses() {
        assert_eq!(PLAN.slots(u64::MAX).unwrap(), 41);
        assert_eq!(PLAN.slots(PLAN.required_bytes(20)).unwrap(), 20);
        assert_eq!(PLAN.slots(PLAN.required_bytes(FEWEST_SLOTS)).unwrap(), 8);
        let too_small = PLAN.required_bytes(FEWEST_SLOTS) - 1;
        let error = PLAN.slots(too_small).unwrap_err();
        assert!(matches!(
            error,
            CreateError::ShmTooSmall { required, available }
                if required == too_small + 1 && available == too_small
        ));
    }

    #[test]
    fn an_explicit_number_of_slots_is_kept_or_refused() {
        let plan = PoolPlan {
            frame_slots: Some(3),
            ..PLAN
        };
        assert_eq!(plan.slots(u64::MAX).unwrap(), 3);
        assert!(plan.slots(plan.required_bytes(2)).is_err());
    }

    #[test]
    fn a_pool_that_publishes_nothing_or_is_never_used_is_refused() {
        let slots = |frame_slots| {
            let plan = PoolPlan {
                frame_slots: Some(frame_slots),
                ..PLAN
            };
            plan.slots(u64::MAX)
        };
        assert_eq!(slots(2).unwrap(), 2);
        assert_eq!(slots(MOST_ASKED_SLOTS).unwrap(), 2306);
        for asked in [0, 1, MOST_ASKED_SLOTS + 1, usize::MAX / 64, usize::MAX] {
            let error = slots(asked).unwrap_err().to_string();
            let said = [&asked.to_string(), "2 to 2306"];
            assert!(said.iter().all(|part| error.contains(*part)), "{error}");
        }
    }
}
