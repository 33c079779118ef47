//! `Command`: the only way to influence a running world from outside.

use crate::{materials::Material, scene::Pose};

/// One order from a client. Commands of a step are applied in the order of
/// (`apply_at_step`, `client`, `sequence`), so that a command log replays to the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Command {
    /// Who sent it.
    pub client: u64,
    /// The sender's own running number.
    pub sequence: u64,
    /// Step at whose start it takes effect; a past step means the next one.
    pub apply_at_step: u64,
    /// What to do.
    pub action: Action,
}

/// What a command does.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Adds `impulse / mass` to the velocity of every particle of the object.
    Impulse {
        /// Object id.
        object: usize,
        /// Total impulse [N s].
        impulse: [f64; 3],
    },
    /// Spreads the impulse over the object's particles within `radius` of `point`, as equal velocity change.
    ImpulseAt {
        /// Object id.
        object: usize,
        /// Total impulse [N s].
        impulse: [f64; 3],
        /// Centre of the touched region [m], world frame.
        point: [f64; 3],
        /// Its radius [m], > 0; widened to reach the nearest particle when it holds none.
        radius: f64,
    },
    /// Gives the object a rigid velocity field about its centre of mass.
    SetVelocity {
        /// Object id.
        object: usize,
        /// Velocity of the centre of mass [m/s].
        linear: [f64; 3],
        /// Angular velocity [rad/s].
        angular: [f64; 3],
    },
    /// Replaces the material of an object or of one of its regions; mass is kept (the density of the new material
    /// is ignored while running), and so is the visible shape.
    SetMaterial {
        /// Object id.
        object: usize,
        /// Number of the region; none for the whole object, regions included.
        region: Option<usize>,
        /// New law and parameters.
        material: Material,
    },
    /// Replaces the gravitational acceleration [m/s^2].
    SetGravity {
        /// New value.
        gravity: [f64; 3],
    },
    /// Moves a collider to a pose that it reaches at the end of the coming frame, at constant velocity and spin;
    /// there it stays. Its own motion ends.
    MoveCollider {
        /// Index of the collider.
        collider: usize,
        /// New pose; the rotation is normalised.
        pose: Pose,
    },
    /// Holds the object's particles that are within `radius` of `point` now, besides those held already.
    Pin {
        /// Object id.
        object: usize,
        /// Centre of the region [m], world frame.
        point: [f64; 3],
        /// Its radius [m], > 0; infinite for the whole object.
        radius: f64,
    },
    /// Lets go what commands hold of the object.
    Release {
        /// Object id.
        object: usize,
    },
    /// A force and a torque that act on the object during the coming frame, in every substep: it gains the momentum
    /// `force` times the length of the frame, and the angular momentum `torque` times it.
    Force {
        /// Object id.
        object: usize,
        /// Force [N], as the same acceleration of every particle.
        force: [f64; 3],
        /// Torque about the centre of mass [N m], as the accelerations of a rigid body.
        torque: [f64; 3],
    },
    /// A force that acts during the coming frame on the object's particles within `radius` of `point`.
    ForceAt {
        /// Object id.
        object: usize,
        /// Force [N], as equal acceleration of these particles.
        force: [f64; 3],
        /// Centre of the touched region [m], world frame.
        point: [f64; 3],
        /// Its radius [m], > 0; widened to reach the nearest particle when it holds none.
        radius: f64,
    },
    /// Moves a collider at constant velocity and spin during the coming frame; then it stands. Its own motion ends.
    ColliderVelocity {
        /// Index of the collider.
        collider: usize,
        /// Velocity of its origin [m/s].
        linear: [f64; 3],
        /// Angular velocity [rad/s], less than half a turn per frame.
        angular: [f64; 3],
    },
    /// Keeps the state as it is now under a number, in place of a former one.
    Save {
        /// The number.
        snapshot: u32,
    },
    /// Back to a state that was kept, simulated time included; the step count goes on.
    Restore {
        /// The number.
        snapshot: u32,
    },
    /// Back to the initial state, at simulated time 0; the step count goes on.
    Reset,
}

/// Why a command is refused. A refused command changes nothing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// The object id is not in the scene.
    #[error("object {object} does not exist: the scene has objects 0..{count}")]
    UnknownObject {
        /// The id sent.
        object: usize,
        /// Objects in the scene.
        count: usize,
    },
    /// The region is not in the object.
    #[error("object {object} has no region {region}: it has regions 0..{count}")]
    UnknownRegion {
        /// The object.
        object: usize,
        /// The region sent.
        region: usize,
        /// Regions of the object.
        count: usize,
    },
    /// The collider is not in the scene.
    #[error("collider {collider} does not exist: the scene has colliders 0..{count}")]
    UnknownCollider {
        /// The index sent.
        collider: usize,
        /// Colliders in the scene.
        count: usize,
    },
    /// The object is only shown.
    #[error("object {object} is static and cannot be moved or changed")]
    StaticObject {
        /// The id sent.
        object: usize,
    },
    /// All particles of the object were taken out.
    #[error(
        "nothing is left of object {object} that could be moved or changed: its {particles} particles left the domain or \
         were frozen"
    )]
    NothingLeft {
        /// The id sent.
        object: usize,
        /// Particles that it had.
        particles: usize,
    },
    /// No torque can turn particles on a line.
    #[error("object {object} cannot be turned by a torque: its particles lie on a line")]
    TooThin {
        /// The object.
        object: usize,
    },
    /// There is no state of this number.
    #[error(
        "snapshot {snapshot} is not there: {saved}; a state is kept once the step of its order was made"
    )]
    UnknownSnapshot {
        /// The number sent.
        snapshot: u32,
        /// What there is.
        saved: String,
    },
    /// Memory is for so many states.
    #[error(
        "snapshot {snapshot} would be one too many: expected at most {max}, or the number of one to replace"
    )]
    TooManySnapshots {
        /// The number sent.
        snapshot: u32,
        /// States that can be kept.
        max: usize,
    },
    /// Contact between spheres moves particles, which a rigid object does not have.
    #[error(
        "object {object} cannot become rigid: contact = \"com_sphere\" is for objects that deform"
    )]
    RigidSphere {
        /// The object.
        object: usize,
    },
    /// A number is NaN or infinite.
    #[error("{field} is {value}, expected a finite number")]
    NotFinite {
        /// Name of the field.
        field: &'static str,
        /// Value sent.
        value: f64,
    },
    /// A number is outside its valid range.
    #[error("{field} is {value}, expected {min} to {max}")]
    OutOfRange {
        /// Name of the field.
        field: &'static str,
        /// Value sent.
        value: f64,
        /// Smallest valid value.
        min: f64,
        /// Largest valid value.
        max: f64,
    },
}
