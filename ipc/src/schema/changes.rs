//! `changes`: what of a frame is not as it was in the one before.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// 64 bytes of a `changes` message: rows first, then Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ChangeSlot")]
#[repr(C)]
#[repr(align(64))]
pub struct ChangeSlot {
    /// As many whole slots as the `ObjectChange` rows take, one after the other; then one `GaussianState` each.
    pub words: [u64; 8],
}

/// How one object has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ObjectChange")]
#[repr(C)]
pub struct ObjectChange {
    /// Object id.
    pub object: u32,
    /// `CHANGE_*`.
    pub kind: u32,
    /// Its first Gaussian in the frame.
    pub first: u32,
    /// Its Gaussians.
    pub count: u32,
    /// The slot of its first Gaussian in this message; 0 for `CHANGE_PLACED`.
    pub slot: u32,
    /// Zero.
    pub reserved: u32,
    /// Where its own frame has its origin [m]; zeros for `CHANGE_GAUSSIANS`.
    pub position: [f64; 3],
    /// World-from-own rotation, unit quaternion xyzw; zeros for `CHANGE_GAUSSIANS`.
    pub rotation: [f64; 4],
}

/// User header of `changes`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ChangesHeader")]
#[repr(C)]
pub struct ChangesHeader {
    /// Step count, as in `frame`.
    pub step: u64,
    /// Simulated time at the end of the step [s].
    pub sim_time: f64,
    /// Size of the last substep [s].
    pub dt: f64,
    /// As in `frame`.
    pub epoch: u64,
    /// Hash of the complete simulation state, as in `frame`.
    pub state_hash: u64,
    /// `CLOCK_MONOTONIC` when the message was sent [ns].
    pub publish_ns: u64,
    /// The step of the message that this one builds on; its own step where it is complete by itself.
    pub since: u64,
    /// Slots in this message.
    pub count: u32,
    /// `ObjectChange` rows in it.
    pub objects: u32,
    /// Gaussians of the whole frame.
    pub gaussians: u32,
    /// Substeps in this step.
    pub substeps: u32,
    /// `FRAME_FLAG_*`.
    pub flags: u32,
    /// Zero.
    pub reserved: u32,
}

/// All of the object is as its own frame had it last, at another place.
pub const CHANGE_PLACED: u32 = 1;
/// The object's Gaussians follow, in the world frame.
pub const CHANGE_GAUSSIANS: u32 = 2;
/// The object's Gaussians follow, in its own frame, and its place: what `CHANGE_PLACED` refers to from now on.
pub const CHANGE_FORM: u32 = 3;

impl ChangesHeader {
    /// Whether the message holds the whole frame.
    pub fn is_complete(&self) -> bool {
        self.since == self.step
    }

    /// Header of the frame that comes of this message and those that it builds on.
    pub fn frame(&self) -> super::FrameHeader {
        super::FrameHeader {
            step: self.step,
            sim_time: self.sim_time,
            dt: self.dt,
            epoch: self.epoch,
            state_hash: self.state_hash,
            publish_ns: self.publish_ns,
            count: self.gaussians,
            substeps: self.substeps,
            flags: self.flags,
            reserved: [0; 5],
        }
    }
}

/// Slots that the rows of so many objects take.
pub fn row_slots(objects: usize) -> usize {
    (objects * size_of::<ObjectChange>()).div_ceil(size_of::<ChangeSlot>())
}
