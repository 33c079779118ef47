//! What varies in time, grouped by the phase that writes it, and the memory that steps work in.
//!
//! A step borrows the groups one by one: what a phase does not get it cannot change. All groups are saved in checkpoints.

pub(crate) mod away;
pub(crate) mod in_contact;
pub(crate) mod rigid;
pub(crate) mod sleep;

use serde::{Deserialize, Serialize};

use crate::{
    bodies::{body::Body, shape::Shape, warm_start::CachedImpulse},
    colliders::{Paths, Substep, rules::Pins, touch::ParticleConditions},
    coupling::{near::Watch, sweeps::WarmStart},
    grid::Grid,
    interruption::Interruption,
    ledger::Ledger,
    materials::{Material, limits::DeformationBounds},
    model::{Model, Painted},
    particles::{Backup, Block, Extremes, Motion, Particles},
    scene::{Fidelity, Pose},
    solid::{advance::Scratch, state::SolidState},
};
use away::Away;
use in_contact::InContact;
use rigid::RigidBody;
use sleep::SleepState;

/// What varies in time.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct State {
    /// Written where a frame ends.
    pub progress: Progress,
    /// Written by commands, before a frame.
    pub commanded: Commanded,
    /// How every object is modelled. Written before the substeps of a frame.
    pub levels: Vec<SleepState>,
    /// Written by the sort, the particle pass and the guard.
    pub matter: Matter,
    /// Written by the grid pass and the guard.
    pub motion: GridMotion,
    /// Pairs in contact. Written by contact on the grid, and by solids.
    pub in_contact: InContact,
    /// Written by the rigid bodies.
    pub bodies: RigidBodies,
    /// Per object, where it is a solid on a grid of its own. Written by their substeps.
    pub solids: Vec<Option<SolidState>>,
    /// Per object, whether it was a solid that has gone over to the spatial grid. Written before the substeps of a frame.
    pub gone_over: Vec<bool>,
}

/// What frames leave behind.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Progress {
    /// Frames stepped since the world was made.
    pub steps: u64,
    /// Simulated time [s].
    pub sim_time: f64,
    /// Momentum of every object after the latest frame and the commands since [kg m/s].
    pub momentum: Vec<[f64; 3]>,
}

/// What commands may change.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Commanded {
    /// Gravitational acceleration [m/s^2].
    pub gravity: [f64; 3],
    /// Material of every part, painted ones last.
    pub materials: Vec<Material>,
    /// Parts that commands painted, in the order they came to be.
    pub painted: Vec<Painted>,
    /// What commands made of each collider.
    pub paths: Paths,
    /// Particles that are held in place, per object.
    pub pins: Pins,
    /// Patches that are held by springs, in the order they were taken hold of.
    pub grabs: Vec<Grab>,
    /// Per object how it is to be modelled, where that is not what the scene says.
    pub fidelity: Vec<Option<Fidelity>>,
    /// Objects that are not there at present, per object.
    pub away: Vec<Option<Away>>,
    /// Per object that is only shown the rigid motion from where it is in the scene, where there is one.
    pub shown: Vec<Option<Pose>>,
}

/// A patch of an object that somebody holds by a spring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Grab {
    pub object: usize,
    /// Number of whoever holds it.
    pub holder: u64,
    /// Its particles, ascending.
    pub particles: Vec<u32>,
    /// Where each of them is in the hand [m]: from the centre of the patch when it was taken, turned since then as the patch has.
    pub places: Vec<[f64; 3]>,
    /// From the point that was taken hold of to the centre of the patch [m].
    pub offset: [f64; 3],
    /// Where the spring pulls the point to when the frame begins, and when it ends [m].
    pub from: [f64; 3],
    pub target: [f64; 3],
    /// Steps that it lasts without a drag, and how many of them are left.
    pub steps: u32,
    pub steps_left: u32,
}

/// Deformable matter.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Matter {
    /// Particles in blocks.
    pub particles: Particles,
    /// Parts whose visible deformation is not, or was not always, the elastic one.
    pub shaped: Vec<bool>,
    /// Particles that are simulated.
    pub live: usize,
    /// Particles taken out so far, in the order it happened.
    pub removed: Vec<u32>,
    /// How far any particle is out of its block, along one axis [cells]; infinite where a sort is due anyhow.
    pub drift: f64,
    /// Per part the extremes of its particles after the latest substep.
    pub extremes: Vec<Extremes>,
}

/// What velocities of particles and nodes are relative to, and how fast they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct GridMotion {
    /// Velocity that those of particles and nodes are relative to [cells/s]: all that gravity adds goes here, in
    /// double precision.
    pub frame_velocity: [f64; 3],
    /// Largest velocity component on the grid in the latest substep [cells/s].
    pub max_speed: f64,
    /// Time by which velocities of particles are behind positions, see [`kick`](crate::kinematics::kick) [s]: half a
    /// substep, nothing where they begin to move.
    pub velocity_offset: f64,
}

/// The groups that substeps change.
pub(crate) struct Moving<'a> {
    pub matter: &'a mut Matter,
    pub motion: &'a mut GridMotion,
    pub in_contact: &'a mut InContact,
    pub bodies: &'a mut RigidBodies,
    pub solids: &'a mut [Option<SolidState>],
}

impl State {
    /// What substeps read, and what they change, in a frame that may be interrupted.
    pub fn split<'a>(
        &'a mut self,
        model: &'a Model,
        interruption: &'a Interruption<'a>,
    ) -> (Given<'a>, Moving<'a>) {
        let given = Given {
            interruption,
            model,
            commanded: &self.commanded,
            levels: &self.levels,
            time: self.progress.sim_time,
        };
        let moving = Moving {
            matter: &mut self.matter,
            motion: &mut self.motion,
            in_contact: &mut self.in_contact,
            bodies: &mut self.bodies,
            solids: &mut self.solids,
        };
        (given, moving)
    }

    /// Whether an object sleeps.
    pub fn sleeps(&self, object: usize) -> bool {
        self.levels[object].is_asleep()
    }

    /// Blocks of an object's particles, awake or not, as of the last sort.
    pub fn blocks_of_particles(&self, object: usize) -> &[Block] {
        if let Some(particles) = self.levels[object].sleeping() {
            return &particles.blocks;
        }
        let blocks = &self.matter.particles.blocks;
        let field = object as u32;
        let first = blocks.partition_point(|b| b.field < field);
        let end = blocks.partition_point(|b| b.field <= field);
        &blocks[first..end]
    }
}

/// Rigid bodies.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RigidBodies {
    /// Per object.
    pub of: Vec<Option<RigidBody>>,
    /// Per object the shape of its body: made from its members, so not saved.
    #[serde(skip)]
    pub shapes: Vec<Option<Shape>>,
    /// Forces between bodies, and colliders, in the latest substep: where the next one begins its search.
    pub warm_start: Vec<CachedImpulse>,
    /// Impulses of the latest frame; not part of a checkpoint.
    #[serde(skip)]
    pub ledger: Ledger,
}

impl RigidBodies {
    /// Whether there is any.
    pub fn any(&self) -> bool {
        self.of.iter().any(Option::is_some)
    }

    /// The body of an object and its shape.
    pub fn get(&self, object: usize) -> Option<(&RigidBody, &Shape)> {
        Some((self.of[object].as_ref()?, self.shapes[object].as_ref()?))
    }

    /// Where all of them are.
    pub fn places(&self) -> Vec<Option<Body>> {
        let bodies = self.of.iter();
        bodies.map(|rigid| rigid.as_ref().map(|r| r.body)).collect()
    }
}

/// What phases of a substep read and leave alone.
#[derive(Clone, Copy)]
pub(crate) struct Given<'a> {
    pub model: &'a Model,
    /// See [`State::commanded`].
    pub commanded: &'a Commanded,
    /// See [`State::levels`].
    pub levels: &'a [SleepState],
    /// Simulated time where the frame begins [s].
    pub time: f64,
    /// Whether the frame has to end before it is done.
    pub interruption: &'a Interruption<'a>,
}

impl<'a> Given<'a> {
    /// What substeps read of a model and a state.
    pub fn new(model: &'a Model, state: &'a State) -> Self {
        Self {
            model,
            commanded: &state.commanded,
            levels: &state.levels,
            time: state.progress.sim_time,
            interruption: Interruption::never(),
        }
    }

    /// Conditions on particles in a substep, and in the one after it; none where nothing acts on particles.
    pub fn particle_conditions(
        &self,
        now: Substep,
        next: Substep,
    ) -> Option<ParticleConditions<'a>> {
        let (model, commanded) = (self.model, self.commanded);
        ParticleConditions::new(
            &model.boundaries,
            &commanded.paths,
            &model.rules,
            &commanded.pins,
            now,
            next,
            commanded.gravity,
        )
    }

    /// Whether the particles of a part are joined to a rigid body.
    pub fn is_joined(&self, part: usize) -> bool {
        let object = self.model.parts[part].object;
        self.commanded.materials[part].law.is_rigid()
            || matches!(self.fidelity_of(object), Fidelity::Rigid | Fidelity::Static)
            || self.levels[object].proxy.is_some()
    }

    /// How an object is to be modelled.
    pub fn fidelity_of(&self, object: usize) -> Fidelity {
        self.commanded.fidelity[object].unwrap_or(self.model.scene.objects[object].fidelity)
    }

    /// Whether an object may be modelled with less than all of its particles.
    pub fn is_automatic(&self, object: usize) -> bool {
        self.model.scene.contact.method.tells_apart() && self.fidelity_of(object) == Fidelity::Auto
    }

    /// Whether a part has particles that move.
    pub fn is_simulated(&self, part: usize) -> bool {
        let object = self.model.parts[part].object;
        let is_solid = self.model.lagrangian[object].is_some();
        self.model.has_particles(part)
            && !is_solid
            && !self.is_joined(part)
            && !self.levels[object].is_asleep()
    }

    /// Whether an object's nodes move, where it is a solid: it neither sleeps nor moves as a body.
    pub fn is_moving_solid(&self, object: usize) -> bool {
        let level = &self.levels[object];
        self.model.lagrangian[object].is_some() && !level.is_asleep() && level.proxy.is_none()
    }

    /// Whether a command or a rule of the scene, now or later, has a say in how an object moves.
    pub fn is_ruled(&self, object: usize) -> bool {
        let mut particles = self.model.scene.objects[object].particles.clone();
        let rules = &self.model.rules;
        self.commanded.pins[object].is_some()
            || self
                .commanded
                .grabs
                .iter()
                .any(|grab| grab.object == object)
            || particles.any(|p| rules.concern_after(self.time, p as u32))
    }

    /// Bound of the substep of a part by the speed of sound, where it is deformed within `bounds` [s].
    pub fn critical_dt(&self, part: usize, bounds: &DeformationBounds) -> f64 {
        let material = &self.commanded.materials[part];
        self.model.critical_dt(part, material, bounds)
    }

    /// Frame velocity after a transfer in which forces act for `kick` [s]: gravity and damping are its own [cells/s].
    pub fn frame_velocity_after(&self, before: [f64; 3], kick: f64) -> [f64; 3] {
        let keep = self.model.velocity_kept(kick) as f32;
        std::array::from_fn(|a| {
            let pulled = kick * self.commanded.gravity[a] / self.model.scene.dx;
            (before[a] + pulled) * f64::from(keep)
        })
    }
}

/// Scratch memory that lives as long as a world.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    pub grid: Grid,
    /// Where sorting writes to.
    pub sorted: Particles,
    /// Particles at the start of the segment.
    pub backup: Backup,
    /// Per block, whether a rule names one of its particles; empty when there is no rule.
    pub concerned: Vec<bool>,
    /// Per prescribed motion its largest speed in this frame [cells/s].
    pub prescribed: Vec<f64>,
    /// Smallest and largest block index.
    pub extent: [[i32; 3]; 2],
    /// Velocities at the end of the segment, until it is accepted.
    pub motion: Vec<Motion>,
    /// Boxes around solids when the frame began, per object [m].
    pub solid_boxes: Vec<Option<[[f64; 3]; 2]>>,
    /// Energy [J] and mass [kg] that edits of the coming frame brought into the world.
    pub edited: [f64; 2],
    /// Of solids, per object; made when they first move.
    pub solids: Vec<Option<Scratch>>,
    /// Solids at the start of the segment.
    pub solids_before: Vec<Option<SolidState>>,
    /// What matter on the grid and solids exchanged in the substep before.
    pub at_solids: WarmStart,
    /// How near particles are to what is off the grid, per object.
    pub watches: Vec<Watch>,
    /// Substeps of the latest frame [s], for comparison with the reference solver.
    pub substeps: Vec<f64>,
}
