//! `status`: the newest health figures, for monitors.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Newest status of the server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.Status")]
#[repr(C)]
pub struct Status {
    /// Steps completed.
    pub step: u64,
    /// Simulated time [s].
    pub sim_time: f64,
    /// `CLOCK_MONOTONIC` of this update [ns]; a client that sees it stand still calls the server dead.
    pub heartbeat_ns: u64,
    /// Identifies the published scene.
    pub epoch: u64,
    /// Steps per wall second, mean over about the last second [1/s].
    pub steps_per_second: f64,
    /// Simulated seconds per wall second, same window.
    pub real_time_factor: f64,
    /// Particle-substeps executed / those of full MPM, since start.
    pub modelled_fraction: f64,
    /// Smallest substep of the last step [s].
    pub dt: f64,
    /// Kinetic energy [J].
    pub kinetic_energy: f64,
    /// Elastic energy [J].
    pub elastic_energy: f64,
    /// Potential energy [J].
    pub potential_energy: f64,
    /// Linear momentum [kg m/s].
    pub linear_momentum: [f64; 3],
    /// Angular momentum about the origin [kg m^2/s].
    pub angular_momentum: [f64; 3],
    /// Frames published.
    pub frames_published: u64,
    /// Frames not published because no memory was free.
    pub frames_skipped: u64,
    /// Substeps rolled back.
    pub rollbacks: u64,
    /// Particles that left the domain.
    pub particles_left: u64,
    /// Particles quarantined.
    pub particles_quarantined: u64,
    /// Commands accepted.
    pub commands_accepted: u64,
    /// Commands refused.
    pub commands_refused: u64,
    /// Hash of the state after the last step.
    pub state_hash: u64,
    /// What limited `dt`: 0 frame, 1 sound speed, 2 velocity, 3 deformation.
    pub dt_limit: u32,
    /// Object that limited `dt`; `u32::MAX` = none.
    pub dt_object: u32,
    /// `SERVER_*`.
    pub server_state: u32,
    /// Server's process id.
    pub pid: u32,
    /// Readers of `frame` and of `changes`.
    pub frame_readers: u32,
    /// Whether the server sends `changes` to those who read it: 1, else 0.
    pub has_changes: u32,
    /// Work that springs of clients did on what they hold, since start [J].
    pub spring_work: f64,
    /// Energy that edits brought into the world, since start [J].
    pub edit_energy: f64,
    /// Mass that edits brought into the world, since start [kg].
    pub edit_mass: f64,
    /// Wall time of a step, mean over about the last second; 0 while nothing is known [s].
    pub step_seconds: f64,
    /// Shares of it, 0..=1: particles, grid, contact on the grid, coupling, solids, their contact, measuring them, rigid bodies, sort,
    /// publish; what is left to 1 is between them.
    pub phase_shares: [f64; PHASES.len()],
    /// Shares of the processor time of all objects, 0..=1, of the three that take most, the dearest first, over the same steps.
    pub cost_shares: [f64; 3],
    /// Their substeps per step.
    pub cost_substeps: [f64; 3],
    /// The smallest of these; 0 where there are none [s].
    pub cost_dt: [f64; 3],
    /// Which objects they are; `u32::MAX` = none.
    pub cost_objects: [u32; 3],
    /// What limited `cost_dt`, as `dt_limit`.
    pub cost_limits: [u32; 3],
    /// Most points of their surfaces that touched something where a step ended; 0 where that is not known.
    pub cost_points: [u32; 3],
    /// Zero.
    pub reserved: u32,
}

/// Phases of a step: `phase_shares` of the status have their order.
pub const PHASES: [&str; 10] = [
    "particles",
    "grid",
    "contact",
    "coupling",
    "solids",
    "solid contact",
    "solid measuring",
    "bodies",
    "sort",
    "publish",
];

/// The server is stepping.
pub const SERVER_RUNNING: u32 = 1;
/// The server is paused.
pub const SERVER_PAUSED: u32 = 2;
/// The server is shutting down.
pub const SERVER_STOPPING: u32 = 3;
/// The server waits for participants in lock-step.
pub const SERVER_WAITING: u32 = 4;
