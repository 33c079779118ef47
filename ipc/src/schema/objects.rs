//! `objects`: the state of every object after a step; small, for control loops.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// One object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ObjectState")]
#[repr(C)]
pub struct ObjectState {
    /// Object id.
    pub id: u32,
    /// How it is modelled at present: 1 static, 2 MPM, 3 asleep, 4 rigid, 6 nothing is left of it, 7
    /// removed.
    pub fidelity: u32,
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass [m].
    pub com: [f64; 3],
    /// Rotation since rest, unit quaternion xyzw.
    pub rotation: [f64; 4],
    /// Velocity of the centre of mass [m/s].
    pub linear_velocity: [f64; 3],
    /// Angular velocity [rad/s].
    pub angular_velocity: [f64; 3],
    /// Inertia about the centre of mass xx xy xz yy yz zz [kg m^2].
    pub inertia: [f64; 6],
    /// Effective radius [m].
    pub radius: f64,
    /// Kinetic energy [J].
    pub kinetic_energy: f64,
    /// Elastic energy [J].
    pub elastic_energy: f64,
    /// Impulse from colliders and other objects during the step [N s].
    pub contact_impulse: [f64; 3],
}

/// User header of `objects`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ObjectsHeader")]
#[repr(C)]
pub struct ObjectsHeader {
    /// Step count, as in `frame`.
    pub step: u64,
    /// Simulated time [s].
    pub sim_time: f64,
    /// As in `frame`.
    pub epoch: u64,
    /// Objects in this message.
    pub count: u32,
    /// Zero.
    pub reserved: u32,
    /// Hash of the complete simulation state, as in `frame`; here also of steps whose frame was skipped.
    pub state_hash: u64,
}
