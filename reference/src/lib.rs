//! The scalar `f64` solver: the oracle of the tests and the reference of the accuracy charts.
//!
//! Explicit MLS-MPM (Hu et al. 2018) with quadratic B-splines, the affine transfer of APIC (Jiang et al. 2015)
//! and leapfrog steps, written from the equations, one particle and one node at a time. No guard: a time step
//! beyond the stability limit blows up, as it must. Springs that clients hold are not in it: it is an oracle of scenes.

mod commands;
mod grid;
mod motion;
pub mod solid;
mod substep;
mod time_step;

use std::collections::BTreeMap;

use cosplat_sim_core::{
    Interruption, ObjectState,
    colliders::{Boundaries, Paths, Pins, Rules},
    command::Command,
    expression::GRADIENT_STEP,
    mat3::Mat3,
    materials::Material,
    moments::{ParticleArrays, bodies_of, object_moments, total_momentum},
    report::{Level, StepReport},
    scene::{DomainPolicy, Fidelity, Part, Scene},
};
pub use time_step::TimeStep;

/// A scene in motion, in double precision and scene order.
#[derive(Clone, Debug)]
pub struct ReferenceWorld {
    scene: Scene,
    /// Particle state.
    pub particles: Particles,
    gravity: [f64; 3],
    parts: Vec<Part>,
    materials: Vec<Material>,
    steps: u64,
    sim_time: f64,
    /// How far velocities are behind positions [s], see [`kick`](cosplat_sim_core::kinematics::kick).
    lag: f64,
    boundaries: Boundaries,
    paths: Paths,
    rules: Rules,
    pins: Pins,
    /// States that commands keep.
    snapshots: BTreeMap<u32, ReferenceWorld>,
}

/// Particle state, SI units, world frame.
#[derive(Clone, Debug, Default)]
pub struct Particles {
    /// Mass [kg]; 0 once a particle has left the domain.
    pub mass: Vec<f64>,
    /// Rest volume `V0` [m^3]; 0 once a particle has left the domain.
    pub volume: Vec<f64>,
    /// Position [m].
    pub position: Vec<[f64; 3]>,
    /// Velocity [m/s].
    pub velocity: Vec<[f64; 3]>,
    /// Affine velocity `C` [1/s], row-major.
    pub affine: Vec<[[f64; 3]; 3]>,
    /// Visible deformation gradient, row-major.
    pub deformation: Vec<[[f64; 3]; 3]>,
    /// Elastic deformation gradient `F`, row-major.
    pub elastic: Vec<[[f64; 3]; 3]>,
    /// The laws' own number, see [`Trial`].
    pub memory: Vec<f64>,
}

impl Particles {
    /// Borrowed for moments and probes.
    pub fn arrays(&self) -> ParticleArrays<'_, f64> {
        ParticleArrays {
            volume: &self.volume,
            position: &self.position,
            velocity: &self.velocity,
            affine: &self.affine,
            deformation: &self.deformation,
            elastic: &self.elastic,
            memory: &self.memory,
        }
    }

    fn set_affine(&mut self, p: usize, affine: Option<[f64; 9]>) {
        if let Some(c) = affine {
            self.affine[p] = std::array::from_fn(|i| std::array::from_fn(|j| c[3 * i + j]));
        }
    }

    fn at_rest(scene: &Scene) -> Self {
        let count = scene.particles.position.len();
        let mut particles = Self {
            mass: vec![0.0; count],
            volume: scene.particles.volume.clone(),
            position: scene.particles.position.clone(),
            velocity: vec![[0.0; 3]; count],
            affine: vec![[[0.0; 3]; 3]; count],
            deformation: vec![Mat3::identity().0; count],
            elastic: vec![Mat3::identity().0; count],
            memory: vec![0.0; count],
        };
        for (id, object) in scene.objects.iter().enumerate() {
            for p in object.particles.clone() {
                particles.mass[p] = object.density_of(p) * particles.volume[p];
            }
            // Bodies are no business of the grid: there is nothing to compare.
            for part in object.parts(id).filter(|part| part.material.law.is_rigid()) {
                particles.mass[part.particles.clone()].fill(0.0);
                particles.volume[part.particles].fill(0.0);
            }
            particles.set_affine_motion(
                object.particles.clone(),
                object.linear_velocity,
                Mat3(object.velocity_gradient),
            );
            if let Some(field) = &object.velocity {
                let h = GRADIENT_STEP * scene.dx;
                for p in object.particles.clone() {
                    let x = scene.particles.position[p];
                    let (own, grown) = (field.at(x, 0.0), field.gradient(x, 0.0, h));
                    for a in 0..3 {
                        particles.velocity[p][a] += own[a];
                        for b in 0..3 {
                            particles.affine[p][a][b] += grown[a][b];
                        }
                    }
                }
            }
        }
        particles
    }
}

impl ReferenceWorld {
    /// The scene at time 0.
    pub fn new(scene: &Scene) -> Self {
        Self {
            particles: Particles::at_rest(scene),
            gravity: scene.gravity,
            materials: scene
                .parts()
                .into_iter()
                .map(|part| part.material)
                .collect(),
            parts: scene.parts(),
            steps: 0,
            sim_time: 0.0,
            lag: 0.0,
            boundaries: Boundaries::new(scene, 1.0),
            paths: vec![None; scene.colliders.len()],
            rules: Rules::new(scene, 1.0),
            pins: vec![None; scene.objects.len()],
            snapshots: BTreeMap::new(),
            scene: scene.clone(),
        }
    }

    /// Applies the commands, then advances by `frame_dt` [s] with substeps of the scene's `cfl`.
    pub fn step(&mut self, frame_dt: f64, commands: &[Command]) -> StepReport {
        let whole = self.step_unless(Interruption::never(), frame_dt, commands);
        whole.unwrap_or_default()
    }

    /// The same, unless it is interrupted: then nothing is returned, and the world is amid the frame, not to be stepped again.
    pub fn step_unless(
        &mut self,
        interruption: &Interruption<'_>,
        frame_dt: f64,
        commands: &[Command],
    ) -> Option<StepReport> {
        let mut frame = self.begin(commands, frame_dt);
        let stops = self.scene.conditions.domain_policy == DomainPolicy::Stop;
        let before = stops.then(|| self.clone());
        let mut remaining = frame_dt;
        while remaining > 0.0 {
            if interruption.is_due() {
                return None;
            }
            let limit = self.time_step();
            // Equal shares of what is left, so that a frame never ends in a sliver.
            let shares = (remaining / limit.dt).ceil().max(1.0);
            let dt = remaining / shares;
            let cause = if shares > 1.0 { limit } else { TimeStep::FRAME };
            self.substep(dt, cause, &mut frame);
            remaining = if shares > 1.0 { remaining - dt } else { 0.0 };
        }
        if let Some(before) = before
            && !frame.report.left_domain.is_empty()
        {
            *self = before;
            frame.report = StepReport {
                left_domain: frame.report.left_domain,
                stopped: true,
                ..StepReport::default()
            };
        }
        Some(self.finish(frame))
    }

    /// Applies the commands, then takes exactly these substeps [s]: for comparison with another solver.
    pub fn step_with(&mut self, substeps: &[f64], commands: &[Command]) -> StepReport {
        let mut frame = self.begin(commands, substeps.iter().sum());
        for &dt in substeps {
            self.substep(dt, TimeStep::FRAME, &mut frame);
        }
        self.finish(frame)
    }

    /// The largest allowed substep now, the scene's `cfl` included, and what limits it.
    pub fn time_step(&self) -> TimeStep {
        time_step::time_step(&self.scene, &self.parts, &self.materials, &self.particles)
    }
}

/// What has to be remembered from the start of a frame to its end.
struct Frame {
    report: StepReport,
    start_time: f64,
    length: f64,
    start_momentum: Vec<[f64; 3]>,
    start_lag: f64,
}

impl ReferenceWorld {
    fn begin(&mut self, commands: &[Command], length: f64) -> Frame {
        self.apply(commands);
        Frame {
            report: StepReport::default(),
            start_time: self.sim_time,
            length,
            start_momentum: self.objects().iter().map(momentum).collect(),
            start_lag: self.lag,
        }
    }

    fn finish(&mut self, frame: Frame) -> StepReport {
        self.steps += 1;
        if !frame.report.stopped {
            for path in self.paths.iter_mut().flatten() {
                path.from = path.to;
            }
        }
        let mut report = frame.report;
        // How long forces acted.
        let elapsed = self.sim_time - frame.start_time + frame.start_lag - self.lag;
        let mut start_momentum = frame.start_momentum;
        for (object, impulse) in self.rules.given(frame.start_time, self.sim_time) {
            for i in 0..3 {
                start_momentum[object][i] += impulse[i];
            }
        }
        self.rules.commanded.clear();
        report.step = self.steps;
        report.sim_time = self.sim_time;
        report.particle_updates_full = report.particle_updates;
        report.objects = self.objects();
        for (object, start) in report.objects.iter_mut().zip(&start_momentum) {
            let end = momentum(object);
            object.contact_impulse = std::array::from_fn(|i| {
                end[i] - start[i] - object.mass * self.gravity[i] * elapsed
            });
            report.kinetic_energy += object.kinetic_energy;
            report.elastic_energy += object.elastic_energy;
            for i in 0..3 {
                report.potential_energy -= object.mass * self.gravity[i] * object.com[i];
            }
        }
        (report.linear_momentum, report.angular_momentum) = total_momentum(&report.objects);
        report
    }

    /// Moments of every object.
    pub fn objects(&self) -> Vec<ObjectState> {
        let particles = self.particles.arrays();
        (0..self.scene.objects.len())
            .map(|id| {
                let bodies = bodies_of(id, &self.parts, &self.materials);
                let state = object_moments(&particles, &bodies, self.scene.dx);
                let level = match self.scene.objects[id].fidelity {
                    Fidelity::Static => Level::Static,
                    _ if state.mass <= 0.0 => Level::Gone,
                    _ => Level::Mpm,
                };
                ObjectState { level, ..state }
            })
            .collect()
    }
}

fn momentum(object: &ObjectState) -> [f64; 3] {
    object.linear_velocity.map(|v| v * object.mass)
}

#[cfg(test)]
mod tests;
