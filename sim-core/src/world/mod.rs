//! `World`: a scene in motion on the fast solver.

mod arrange;
mod bodies;
mod boundary_checks;
mod bounds;
mod checkpoint;
mod coherence;
mod commands;
mod edit;
mod error;
mod extremes;
mod fidelity;
mod frame;
mod going_over;
mod grab;
mod hash;
mod holding;
mod initial;
mod measure;
mod outside;
mod overlap;
mod paint;
mod place;
mod proxy;
mod published;
mod quarantine;
mod recast;
mod scene_checks;
mod segment;
mod settling;
mod solid_checks;
mod solid_levels;
mod solids;
mod spheres;
mod touching;
mod undo;
mod visible;

#[cfg(test)]
mod tests;

use std::{collections::BTreeMap, time::Instant};

pub use checkpoint::CheckpointError;
pub use error::WorldError;
pub use visible::{Form, Placed, Visible};

use crate::{
    colliders::Substep,
    command::Command,
    interruption::Interruption,
    materials::Material,
    model::Model,
    moments::ParticleArrays,
    report::StepReport,
    scene::{Pose, Scene},
    simd::Isa,
    state::{Given, State, Workspace},
};
use frame::Frame;
use published::Published;
use undo::History;
use visible::Sight;

/// A scene in motion: 3D MLS-MPM with APIC transfers, quadratic B-splines and leapfrog steps in `f32`, on
/// the current rayon pool. Same scene and commands give the same bits on any thread count and instruction set.
#[derive(Debug)]
pub struct World {
    /// What never changes, and what is made of materials when they do.
    model: Model,
    /// What varies in time.
    state: State,
    /// Memory to work in.
    workspace: Workspace,
    /// Particles in scene order.
    published: Published,
    /// Of the latest step.
    report: StepReport,
    /// States that commands keep, as checkpoints.
    snapshots: BTreeMap<u32, Vec<u8>>,
    /// States before edits, and those that undoing left.
    history: History,
    /// What was seen of the objects.
    sight: Sight,
}

impl World {
    /// Per object of a scene, whether it may have a grid of its own, whatever [`solver`](crate::scene::Object::solver) it has;
    /// [`WorldError::Solid`] says what does not go with it.
    pub fn check_lagrangian(scene: &Scene) -> Vec<Result<(), WorldError>> {
        solid_checks::check_all(scene)
    }

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
        scene_checks::validate(scene)
    }

    /// Like [`new`](Self::new) on a chosen instruction set: for tests and measurements, results are the same.
    ///
    /// # Errors
    /// Those of [`new`](Self::new), and when the processor lacks `isa`.
    pub fn with_isa(scene: Scene, isa: Isa) -> Result<Self, WorldError> {
        if !isa.is_available() {
            return Err(WorldError::NoSuchIsa(isa));
        }
        scene_checks::validate(&scene)?;
        let objects = scene.objects.len();
        let mut world = Self {
            model: Model::new(scene, isa),
            state: State::default(),
            workspace: Workspace::default(),
            published: Published::default(),
            report: StepReport::default(),
            snapshots: BTreeMap::new(),
            history: History::default(),
            sight: Sight::new(objects),
        };
        world.reset();
        world.update_sight();
        world.report = world.measure(&Frame::new(0.0));
        Ok(world)
    }

    /// What substeps read.
    fn given(&self) -> Given<'_> {
        Given::new(&self.model, &self.state)
    }

    /// The scene as it was given.
    pub fn scene(&self) -> &Scene {
        &self.model.scene
    }

    /// Applies the commands, then advances by `frame_dt` [s], > 0; other lengths only apply the commands.
    ///
    /// Commands act in the order of (`apply_at_step`, `client`, `sequence`) and all of them now: the caller
    /// hands over those that are due. One that [`check`](Self::check) refuses is passed over whole.
    pub fn step(&mut self, frame_dt: f64, commands: &[Command]) -> StepReport {
        let whole = self.step_unless(Interruption::never(), frame_dt, commands);
        whole.unwrap_or_else(|| self.report.clone())
    }

    /// The same, unless it is interrupted: then nothing is returned, and the world is amid the frame. Its [`report`](Self::report) and
    /// whatever it publishes are those of the step before, and it must not be stepped, nor saved, again.
    pub fn step_unless(
        &mut self,
        interruption: &Interruption<'_>,
        frame_dt: f64,
        commands: &[Command],
    ) -> Option<StepReport> {
        let start = Instant::now();
        let mut frame = Frame::new(frame_dt);

        // The one place where the outside acts on the state.
        self.workspace.edited = [0.0; 2];
        self.apply(commands, &mut frame);
        frame.tally.timings.commands = start.elapsed().as_secs_f64();

        // Model no more than the scene needs, and no solid that has flowed too far for its grid.
        self.let_solids_go_over(&mut frame);
        self.update_model_levels(&mut frame);

        // Segments of substeps: bound dt, sort if due, then P2G, grid, contact, bodies, G2P and guard.
        let before = self.before_stop();
        self.state.in_contact.ledger.clear();
        self.state.bodies.ledger.clear();
        self.set_springs(frame.length);
        self.advance(&mut frame, interruption);
        if interruption.was_due() {
            return None;
        }
        self.stop(before, &mut frame);

        // Particles back to scene order; moments, energies, hash.
        let measuring = Instant::now();
        self.publish();
        self.end_frame(&frame);
        self.model.rules.commanded.clear();
        self.end_springs();
        self.state.progress.steps += 1;
        self.state.progress.sim_time += frame.length;
        let mut report = self.measure(&frame);
        report.timings.moments = measuring.elapsed().as_secs_f64();
        report.timings.total = start.elapsed().as_secs_f64();
        self.report = report;
        Some(self.report.clone())
    }

    /// Brings particles back to scene order.
    fn publish(&mut self) {
        let (particles, frame_velocity) = (
            &self.state.matter.particles,
            self.state.motion.frame_velocity,
        );
        self.published
            .update(particles, frame_velocity, self.model.scene.dx);
        self.publish_bodies();
        self.publish_solids();
        self.update_sight();
    }

    /// The latest report; before the first step that of the initial state, step 0.
    pub fn report(&self) -> &StepReport {
        &self.report
    }

    /// Particle positions [m], world frame, in scene order.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.published.position
    }

    /// Particle velocities [m/s] in scene order: of half a substep before, where a particle is not part of a body or a solid.
    pub fn velocities(&self) -> &[[f32; 3]] {
        &self.published.velocity
    }

    /// Substeps of the latest frame [s].
    pub fn substeps(&self) -> &[f64] {
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
        let part = self
            .model
            .parts
            .iter()
            .position(|part| part.object == object);
        &self.state.commanded.materials[part.expect("every object has a part")]
    }

    /// Current pose of a collider [m].
    ///
    /// # Panics
    /// When `collider` is not an index into the scene's colliders, like slice indexing.
    pub fn collider_pose(&self, collider: usize) -> Pose {
        let now = Substep {
            time: self.state.progress.sim_time,
            dt: 0.0,
            kick: 0.0,
            frame_start: self.state.progress.sim_time,
            frame_length: 0.0,
        };
        let paths = &self.state.commanded.paths;
        self.model.boundaries.pose(collider, paths, &now, now.time)
    }

    /// Current gravitational acceleration [m/s^2].
    pub fn gravity(&self) -> [f64; 3] {
        self.state.commanded.gravity
    }
}
