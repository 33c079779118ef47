//! `frame`: the state of every Gaussian after a step.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// One Gaussian: one cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.GaussianState")]
#[repr(C)]
#[repr(align(64))]
pub struct GaussianState {
    /// Centre [m], world frame.
    pub position: [f32; 3],
    /// Base colour and opacity, RGBA, 0..=255, not premultiplied.
    pub color: [u8; 4],
    /// Covariance xx xy xz yy yz zz [m^2], world frame.
    pub covariance: [f32; 6],
    /// Object id.
    pub object: u32,
    /// Index of this Gaussian in the `scene` blocks.
    pub index: u32,
    /// World-from-asset rotation (polar part of F times the placement), unit quaternion xyzw: evaluate the
    /// spherical harmonics of the `scene` blocks in the view direction turned back by it.
    pub rotation: [f32; 4],
}

/// User header of `frame`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.FrameHeader")]
#[repr(C)]
pub struct FrameHeader {
    /// Step count; consecutive frames differ by 1, anything else is a gap.
    pub step: u64,
    /// Simulated time at the end of the step [s].
    pub sim_time: f64,
    /// Size of the last substep [s].
    pub dt: f64,
    /// Identifies the published scene; a client that sees a new epoch re-reads it.
    pub epoch: u64,
    /// Hash of the complete simulation state.
    pub state_hash: u64,
    /// `CLOCK_MONOTONIC` when the frame was sent [ns].
    pub publish_ns: u64,
    /// Gaussians in this frame.
    pub count: u32,
    /// Substeps in this step.
    pub substeps: u32,
    /// `FRAME_FLAG_*`.
    pub flags: u32,
    /// Zero.
    pub reserved: [u32; 5],
}

/// The state was set back to the initial one in this step.
pub const FRAME_FLAG_RESET: u32 = 1;
/// The server was paused when it sent this frame: no step follows before it is resumed. A pause that comes later is
/// told by `status` alone.
pub const FRAME_FLAG_PAUSED: u32 = 2;
/// This is the last frame of the session.
pub const FRAME_FLAG_LAST: u32 = 4;
/// The state was set back to that of a snapshot in this step.
pub const FRAME_FLAG_RESTORED: u32 = 8;
