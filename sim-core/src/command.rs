//! `Command`: the only way to influence a running world from outside.

use crate::{
    materials::Material,
    scene::{Fidelity, Pose},
};

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
    /// Replaces the material of an object, of one of its regions, or of a patch of these; mass is kept (the density of the
    /// new material is ignored while running), and so is the visible shape. A solid goes over to the spatial grid where the law is
    /// none for solids, or the patch is no part of the scene.
    SetMaterial {
        /// Object id.
        object: usize,
        /// Number of the region; none for the whole object, regions included.
        region: Option<usize>,
        /// Which of its particles, by where they are now; none for all of them.
        patch: Option<Patch>,
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
    /// Takes hold of a patch of the object, pulls it elsewhere or lets it go.
    Hold {
        /// Number of whoever holds it: one patch of each object.
        holder: u64,
        /// Object id.
        object: usize,
        /// What to do.
        change: HoldChange,
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
    /// Puts an object elsewhere, at rest and as it is deformed. Who holds it lets go; what is pinned of it stays pinned.
    SetPose {
        /// Object id.
        object: usize,
        /// Where to.
        place: Place,
    },
    /// Has an object modelled as matter, as one body, as one body that stands where it is (`Static`), or with as little as
    /// [`Scene::tolerance`](crate::scene::Scene::tolerance) allows.
    SetFidelity {
        /// Object id.
        object: usize,
        /// How.
        fidelity: Fidelity,
    },
    /// Takes an object out of the world: it is neither simulated nor seen, and keeps its number.
    Remove {
        /// Object id.
        object: usize,
    },
    /// Brings an object in that was removed, or is absent from the beginning, at rest and as it was deformed.
    BringIn {
        /// Object id.
        object: usize,
        /// Where to.
        place: Place,
    },
    /// Back to the state right before the newest edit, simulated time included; the step count goes on. Edits are [`SetPose`],
    /// [`SetFidelity`], [`Remove`], [`BringIn`], [`SetMaterial`], [`SetGravity`], [`Pin`] and [`Release`].
    ///
    /// [`SetPose`]: Self::SetPose
    /// [`SetFidelity`]: Self::SetFidelity
    /// [`Remove`]: Self::Remove
    /// [`BringIn`]: Self::BringIn
    /// [`SetMaterial`]: Self::SetMaterial
    /// [`SetGravity`]: Self::SetGravity
    /// [`Pin`]: Self::Pin
    /// [`Release`]: Self::Release
    Undo,
    /// Back to the state that the newest undo left; an edit after it takes that away.
    Redo,
    /// Back to the initial state, at simulated time 0; the step count goes on.
    Reset,
}

/// Where particles get another material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Patch {
    /// Within a radius of a point.
    Ball {
        /// Its centre [m], world frame.
        point: [f64; 3],
        /// Its radius [m], > 0; widened to reach the nearest particle when it holds none.
        radius: f64,
    },
    /// In a box along the axes of the world, faces included.
    Box {
        /// Its centre [m], world frame.
        centre: [f64; 3],
        /// Half its edges [m], >= 0.
        half: [f64; 3],
    },
}

/// Where an object is put.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Its centre of mass [m], of one that is only shown the middle of its Gaussians; where it is without.
    pub position: Option<[f64; 3]>,
    /// Its mean rotation since rest, quaternion xyzw of length 1e-6 to 1e6, normalised; as it is without.
    pub rotation: Option<[f64; 4]>,
}

impl Action {
    /// Whether it changes the scene rather than its motion: [`Undo`](Self::Undo) takes it back.
    pub fn is_edit(&self) -> bool {
        matches!(
            self,
            Self::SetPose { .. }
                | Self::SetFidelity { .. }
                | Self::Remove { .. }
                | Self::BringIn { .. }
                | Self::SetMaterial { .. }
                | Self::SetGravity { .. }
                | Self::Pin { .. }
                | Self::Release { .. }
        )
    }
}

/// What an object would overlap with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// Another object, by its id.
    Object(usize),
    /// A collider, by its index.
    Collider(usize),
}

impl std::fmt::Display for Obstacle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Object(id) => write!(f, "object {id}"),
            Self::Collider(id) => write!(f, "collider {id}"),
        }
    }
}

/// What becomes of a patch that is held by a critically damped spring, `F = m (w^2 d - 2 w v)` with `w` = 31.6 rad/s and the
/// mass `m` that the object has at the patch, at most ten times its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldChange {
    /// The object's particles within `radius` of `point` are held, in place of a former patch of the same holder and object.
    Grab {
        /// Centre of the patch [m], world frame.
        point: [f64; 3],
        /// Where the spring pulls this point to [m], in the domain.
        target: [f64; 3],
        /// Radius of the patch [m], > 0; widened to reach the nearest particle when it holds none.
        radius: f64,
        /// Steps after which it is let go unless it is dragged, at most 1,000,000; 0 for 60.
        steps: u32,
    },
    /// The spring pulls elsewhere, where its end is when the coming frame ends.
    Drag {
        /// Where to [m], in the domain.
        target: [f64; 3],
    },
    /// The patch is let go.
    LetGo,
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
    /// No particle is where the material should go.
    #[error(
        "nothing of object {object} is in the box of {:?} m about {:?} m, expected at least one particle",
        half,
        centre
    )]
    NothingThere {
        /// The id sent.
        object: usize,
        /// Centre of the box [m].
        centre: [f64; 3],
        /// Half its edges [m].
        half: [f64; 3],
    },
    /// Only so many materials can be painted.
    #[error(
        "{found} parts of objects would be painted, expected at most {max}: paint with fewer materials, or undo"
    )]
    TooManyPainted {
        /// Parts there would be.
        found: usize,
        /// Parts that can be painted.
        max: usize,
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
    /// The object is not there.
    #[error("object {object} is not there: it was removed, or has yet to be brought in")]
    Removed {
        /// The id sent.
        object: usize,
    },
    /// The object is there already.
    #[error(
        "object {object} is there already: only what was removed or is absent can be brought in"
    )]
    Present {
        /// The id sent.
        object: usize,
    },
    /// There is no room.
    #[error(
        "object {object} would overlap {with} by {:.4} m: moved on by {:.4} {:.4} {:.4} m it would not",
        crate::mat3::length(*way_out), way_out[0], way_out[1], way_out[2]
    )]
    Overlap {
        /// The object.
        object: usize,
        /// With what.
        with: Obstacle,
        /// The shortest way out of it: of objects along an axis of the world, of colliders along the normal of the deepest
        /// place [m].
        way_out: [f64; 3],
    },
    /// The object would not be in the domain.
    #[error(
        "object {object} would reach {axis} = {value:.4} m, expected {min} to {max}: the domain"
    )]
    Outside {
        /// The object.
        object: usize,
        /// The axis.
        axis: char,
        /// Place of a particle along it [m].
        value: f64,
        /// Where the domain begins [m].
        min: f64,
        /// Where it ends [m].
        max: f64,
    },
    /// The object cannot be modelled so.
    #[error("object {object} cannot become {fidelity}: {why}")]
    Fidelity {
        /// The object.
        object: usize,
        /// How it was to be modelled.
        fidelity: &'static str,
        /// What stands against it.
        why: &'static str,
    },
    /// No edit was made, or all were undone, or it is too long ago.
    #[error(
        "there is no edit to undo: none was made since the start, or no state before it is kept"
    )]
    NothingToUndo,
    /// Nothing was undone since the last edit.
    #[error("there is nothing to redo: nothing was undone since the latest edit")]
    NothingToRedo,
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
    /// Whoever drags or lets go does not hold the object.
    #[error(
        "client {holder} does not hold object {object}: it has to grab it first, and a hold ends when it is not dragged for too long"
    )]
    NotHeld {
        /// The object.
        object: usize,
        /// Number of the client.
        holder: u64,
    },
    /// Only so many patches can be held.
    #[error("{max} patches are held already, expected fewer than {max}")]
    TooManyGrabs {
        /// Patches that can be held.
        max: usize,
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
