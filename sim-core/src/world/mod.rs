//! `World`: a scene in motion on the fast solver.

mod bodies;
mod boundary_checks;
mod checkpoint;
mod coherence;
mod commands;
mod edit;
mod error;
mod extremes;
mod fidelity;
mod frame;
mod hash;
mod initial;
mod nodes;
mod outside;
mod pace;
mod passes;
mod pieces;
mod published;
mod settling;
mod spheres;
mod stand_in;
mod time_step;

#[cfg(test)]
mod tests;

use std::time::Instant;

pub use checkpoint::CheckpointError;
pub use error::WorldError;
use serde::{Deserialize, Serialize};

use crate::{
    bodies::{engine::Remembered, shape::Shape},
    colliders::{
        Boundaries, Paths, Substep,
        rules::{Pins, Rules},
    },
    command::Command,
    contact::Episodes,
    grid::Grid,
    materials::Material,
    moments::{ParticleArrays, bodies_of, object_moments, total_momentum},
    particles::{Backup, Extremes, Motion, Particles},
    report::StepReport,
    scene::{Part, Pose, Scene},
    simd::Isa,
};
use bodies::Rigid;
use fidelity::Standing;
use frame::Frame;
use initial::half_spacings;
use published::Published;

/// A scene in motion: 3D MLS-MPM with APIC transfers, quadratic B-splines and leapfrog steps in `f32`, on
/// the current rayon pool. Same scene and commands give the same bits on any thread count and instruction set.
#[derive(Debug)]
pub struct World {
    scene: Scene,
    parts: Vec<Part>,
    /// Mass of the heaviest particle [kg]: the solver's unit.
    mass_unit: f64,
    isa: Isa,
    boundaries: Boundaries,
    /// The same boundaries in metres: what bodies meet.
    solids: Boundaries,
    /// How far every particle of the scene reaches from its centre, as colliders see it [cells].
    half_spacings: Vec<f64>,
    /// Per part the stretch from which on it may tear.
    bridged: Vec<f64>,
    /// Shapes of bodies, per object; those of objects without a body mean nothing.
    shapes: Vec<Option<Shape>>,
    rules: Rules,
    state: State,
    workspace: Workspace,
    published: Published,
    report: StepReport,
}

/// What varies in time.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct State {
    /// Frames stepped since the world was made.
    steps: u64,
    /// Simulated time [s].
    sim_time: f64,
    /// How far velocities of particles are behind positions, see [`kick`](crate::kinematics::kick) [s]: half a substep,
    /// nothing where they begin to move.
    lag: f64,
    /// The same per object: objects may take substeps of their own.
    lags: Vec<f64>,
    /// Gravitational acceleration [m/s^2].
    gravity: [f64; 3],
    /// Current material of every part.
    materials: Vec<Material>,
    /// Parts whose visible deformation is not, or was not always, the elastic one.
    shaped: Vec<bool>,
    /// Particles in blocks.
    particles: Particles,
    /// Particles that are simulated.
    live: usize,
    /// How far any particle is out of its block, along one axis [cells]; infinite where a sort is due anyhow.
    drift: f64,
    /// Per part the extremes of its particles after the latest substep.
    extremes: Vec<Extremes>,
    /// Velocity that those of particles and nodes are relative to [cells/s]: all that gravity adds goes here, in
    /// double precision.
    carrier: [f64; 3],
    /// Largest velocity component on the grid in the latest substep [cells/s].
    grid_speed: f64,
    /// Particles taken out so far, in the order it happened.
    removed: Vec<u32>,
    /// What commands made of each collider.
    paths: Paths,
    /// What commands hold, per object.
    pins: Pins,
    /// Bodies, per object.
    rigid: Vec<Option<Rigid>>,
    /// Forces between bodies, and colliders, in the latest substep.
    pressing: Vec<Remembered>,
    /// How every object is modelled.
    standing: Vec<Standing>,
    /// Pairs of objects in contact.
    episodes: Episodes,
    /// Momentum of every object after the latest frame and the commands since [kg m/s].
    momentum: Vec<[f64; 3]>,
}

/// Scratch memory that lives as long as the world.
#[derive(Debug, Default)]
struct Workspace {
    grid: Grid,
    /// Where sorting writes to.
    sorted: Particles,
    /// Particles at the start of the segment.
    backup: Backup,
    /// Per block, whether a rule names one of its particles; empty when there is no rule.
    concerned: Vec<bool>,
    /// Per prescribed motion its largest speed in this frame [cells/s].
    prescribed: Vec<f64>,
    /// Smallest and largest block index.
    extent: [[i32; 3]; 2],
    /// Objects that were stretched by as much as tears them, see [`pieces`]; empty while none was.
    strained: Vec<bool>,
    /// Velocities at the end of the segment, until it is accepted.
    motion: Vec<Motion>,
    /// Pairs of bodies, and colliders behind the last of them, in contact after the latest substep.
    body_pairs: Vec<[u32; 2]>,
    /// Substeps of the latest frame [s], for comparison with the reference solver.
    #[cfg(test)]
    substeps: Vec<f64>,
}

impl World {
    /// The scene at time 0, on the best instruction set of this processor.
    ///
    /// # Errors
    /// [`WorldError`] where the scene holds a number or range that cannot be simulated.
    pub fn new(scene: Scene) -> Result<Self, WorldError> {
        Self::with_isa(scene, Isa::detect())
    }

    /// Whether a scene can be simulated.
    ///
    /// # Errors
    /// Those of [`new`](Self::new).
    pub fn check_scene(scene: &Scene) -> Result<(), WorldError> {
        error::validate(scene)
    }

    /// Like [`new`](Self::new) on a chosen instruction set: for tests and measurements, results are the same.
    ///
    /// # Errors
    /// Those of [`new`](Self::new), and when the processor lacks `isa`.
    pub fn with_isa(scene: Scene, isa: Isa) -> Result<Self, WorldError> {
        if !isa.is_available() {
            return Err(WorldError::NoSuchIsa(isa));
        }
        error::validate(&scene)?;
        let mut world = Self {
            isa,
            parts: scene.parts(),
            bridged: pieces::bridged(&scene, &scene.parts()),
            half_spacings: half_spacings(&scene),
            boundaries: Boundaries::new(&scene, scene.dx),
            solids: Boundaries::new(&scene, 1.0),
            shapes: vec![],
            rules: Rules::new(&scene, scene.dx),
            mass_unit: 1.0,
            state: State::default(),
            workspace: Workspace::default(),
            published: Published::default(),
            report: StepReport::default(),
            scene,
        };
        world.mass_unit = world.heaviest_particle();
        world.reset();
        world.report = world.measure(&Frame::new(0.0));
        Ok(world)
    }

    /// The scene as it was given.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Applies the commands, then advances by `frame_dt` [s], > 0; other lengths only apply the commands.
    ///
    /// Commands act in the order of (`apply_at_step`, `client`, `sequence`) and all of them now: the caller
    /// hands over those that are due. One that [`check`](Self::check) refuses is passed over whole.
    pub fn step(&mut self, frame_dt: f64, commands: &[Command]) -> StepReport {
        let start = Instant::now();
        let mut frame = Frame::new(frame_dt);

        // The one place where the outside acts on the state.
        self.apply(commands);
        frame.timings.commands = start.elapsed().as_secs_f64();

        // Model no more than the scene needs.
        self.settle_fidelity(&mut frame);

        // Bound dt, sort if due, then P2G, grid, G2P and guard per substep.
        let before = self.before_stop();
        self.advance(&mut frame);
        self.stop(before, &mut frame);

        // Particles back to scene order; moments, energies, hash.
        let measuring = Instant::now();
        self.publish();
        self.settle(&frame);
        self.state.steps += 1;
        self.state.sim_time += frame.length;
        let mut report = self.measure(&frame);
        report.timings.moments = measuring.elapsed().as_secs_f64();
        report.timings.total = start.elapsed().as_secs_f64();
        self.report = report;
        self.report.clone()
    }

    /// Brings particles back to scene order.
    fn publish(&mut self) {
        let (particles, carrier) = (&self.state.particles, self.state.carrier);
        self.published.update(particles, carrier, self.scene.dx);
        self.publish_bodies();
    }

    /// The latest report; before the first step that of the initial state, step 0.
    pub fn report(&self) -> &StepReport {
        &self.report
    }

    /// Particle positions [m], world frame, in scene order.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.published.position
    }

    /// Particle velocities [m/s] in scene order: of half a substep before, where a particle is not part of a body.
    pub fn velocities(&self) -> &[[f32; 3]] {
        &self.published.velocity
    }

    /// Substeps of the latest frame [s].
    #[cfg(test)]
    pub(crate) fn substeps(&self) -> &[f64] {
        &self.workspace.substeps
    }

    /// Affine velocities `C` [1/s], row-major, in scene order.
    pub fn affine(&self) -> &[[f32; 9]] {
        &self.published.affine
    }

    /// Deformation gradients `F`, row-major, in scene order.
    pub fn deformations(&self) -> &[[f32; 9]] {
        &self.published.deformation
    }

    /// Complete particle state in scene order, for moments and probes.
    pub fn arrays(&self) -> ParticleArrays<'_, f32> {
        self.published.arrays()
    }

    /// Current material of an object, outside its regions.
    ///
    /// # Panics
    /// When `object` is not an object id of the scene, like slice indexing.
    pub fn material(&self, object: usize) -> &Material {
        let part = self.parts.iter().position(|part| part.object == object);
        &self.state.materials[part.expect("every object has a part")]
    }

    /// Current pose of a collider [m].
    ///
    /// # Panics
    /// When `collider` is not an index into the scene's colliders, like slice indexing.
    pub fn collider_pose(&self, collider: usize) -> Pose {
        let now = Substep {
            time: self.state.sim_time,
            dt: 0.0,
            kick: 0.0,
            frame_start: self.state.sim_time,
            frame_length: 0.0,
        };
        let paths = &self.state.paths;
        self.boundaries.pose(collider, paths, &now, now.time)
    }

    /// Current gravitational acceleration [m/s^2].
    pub fn gravity(&self) -> [f64; 3] {
        self.state.gravity
    }

    /// Report of the current state and of what `frame` did.
    fn measure(&mut self, frame: &Frame) -> StepReport {
        let arrays = self.published.arrays();
        let mut report = frame.report(&self.state);
        let before = &self.report.objects;
        for id in 0..self.scene.objects.len() {
            let bodies = bodies_of(id, &self.parts, &self.state.materials);
            let mut state = match before.get(id) {
                Some(old) if self.state.sleeps(id) => *old,
                _ => match self.body_state(id) {
                    Some(state) => state,
                    None => object_moments(&arrays, &bodies, self.scene.dx),
                },
            };
            state.level = self.level(id, state.mass);
            let whole = self.mass_of_body(id);
            let kicked = frame.kicked.get(id).copied().unwrap_or(0.0);
            // What left with particles that were taken out is no contact.
            let kept = match before.get(id) {
                Some(old) if old.mass > 0.0 => Some(state.mass / old.mass),
                _ => None,
            };
            for a in 0..3 {
                let momentum = state.mass * state.linear_velocity[a];
                let pulled = whole * frame.length + (state.mass - whole) * kicked;
                let weight = self.state.gravity[a] * pulled;
                if let Some(kept) = kept {
                    let expected = kept * self.state.momentum[id][a] + weight;
                    state.contact_impulse[a] = momentum - expected;
                }
                self.state.momentum[id][a] = momentum;
                report.potential_energy -= state.mass * self.state.gravity[a] * state.com[a];
            }
            report.kinetic_energy += state.kinetic_energy;
            report.elastic_energy += state.elastic_energy;
            report.objects.push(state);
        }
        report.particle_updates_full = self
            .updates_of_full_mpm(frame.length, report.substeps)
            .max(report.particle_updates);
        let ended = self.state.episodes.take_closed();
        let (unit, dx) = (self.mass_unit, self.scene.dx);
        report.contacts = ended.iter().map(|e| nodes::episode(e, unit, dx)).collect();
        (report.linear_momentum, report.angular_momentum) = total_momentum(&report.objects);
        report.state_hash = hash::state_hash(&self.published, &self.state);
        report.torn = self.torn(|id| report.objects[id].level);
        report
    }
}
