//! The scalar `f64` reference solver: the oracle of the tests and the reference of the accuracy charts.
//!
//! Explicit MLS-MPM (Hu et al. 2018) with quadratic B-splines, the affine transfer of APIC (Jiang et al. 2015)
//! and leapfrog steps, written from the equations, one particle and one node at a time. No guard: a time step
//! beyond the stability limit blows up, as it must.

mod commands;
mod grid;
mod motion;
mod time_step;

use crate::{
    colliders::{
        Boundaries, Paths, Substep,
        approach::Nearest,
        edge::tell_edges,
        rules::{Pins, Rules},
        sweep::Way,
        touch::{ANCHOR, Touch},
    },
    command::Command,
    expression::GRADIENT_STEP,
    kinematics::kick,
    mat3::Mat3,
    materials::{Coefficients, Material, Trial},
    moments::{ParticleArrays, bodies_of, object_moments, total_momentum},
    report::{Level, StepReport},
    scene::{Aabb, DomainPolicy, Fidelity, Part, Scene},
};
use grid::{Grid, Stencil};
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
    /// How far velocities are behind positions [s], see [`kick`].
    lag: f64,
    boundaries: Boundaries,
    paths: Paths,
    rules: Rules,
    pins: Pins,
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
            scene: scene.clone(),
        }
    }

    /// Applies the commands, then advances by `frame_dt` [s] with substeps of the scene's `cfl`.
    pub fn step(&mut self, frame_dt: f64, commands: &[Command]) -> StepReport {
        let mut frame = self.begin(commands, frame_dt);
        let stops = self.scene.conditions.domain_policy == DomainPolicy::Stop;
        let before = stops.then(|| self.clone());
        let mut remaining = frame_dt;
        while remaining > 0.0 {
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
        self.finish(frame)
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

    fn substep(&mut self, dt: f64, cause: TimeStep, frame: &mut Frame) {
        let [kick, lag] = kick(self.lag, dt, self.scene.cfl);
        self.lag = lag;
        let (frame_start, frame_length) = (frame.start_time, frame.length);
        let report = &mut frame.report;
        let (dx, particles) = (self.scene.dx, &mut self.particles);
        let substep = Substep {
            time: self.sim_time,
            dt,
            kick,
            frame_start,
            frame_length,
        };
        let touch = Touch::new(
            &self.boundaries,
            &self.paths,
            &self.rules,
            &self.pins,
            substep,
            substep,
            self.gravity,
        );
        let mut held = vec![false; particles.mass.len()];
        if let Some(touch) = &touch {
            for p in 0..particles.mass.len() {
                let (x, v) = (particles.position[p], particles.velocity[p]);
                if let Some(touched) = touch.before(p as u32, x, v) {
                    particles.velocity[p] = touched.v;
                    particles.set_affine(p, touched.affine);
                    held[p] = touched.affine.is_some();
                }
            }
        }
        let keep = self.scene.conditions.damping_factor(kick);
        let before = particles.position.clone();
        let mut grid = Grid::default();
        let mut stencils: Vec<Option<Stencil>> = vec![None; particles.mass.len()];

        // P2G. Internal force of MLS-MPM: -4 V0 / dx^2 tau (x_i - x_p) w_ip, inside the affine matrix.
        for (part, material) in self.parts.iter().zip(&self.materials) {
            let numbers = Coefficients::new(material);
            for p in part.particles.clone() {
                let m = particles.mass[p];
                if m == 0.0 {
                    continue;
                }
                let state = Trial {
                    f: Mat3(particles.elastic[p]),
                    memory: particles.memory[p],
                    gradient: Mat3(particles.affine[p]),
                    dt: 0.0,
                };
                let tau = material.law.respond(&state, &numbers).tau;
                let k = -kick * particles.volume[p] * 4.0 / (dx * dx);
                let mut c = Mat3(particles.affine[p]);
                if let Some([a, b]) = self.scene.conditions.affine_kept()
                    && !material.law.is_rigid()
                {
                    c = c.blend(a, &c.transpose(), b);
                }
                let c = c.0;
                let affine = Mat3([
                    [
                        m * c[0][0] + k * tau[0],
                        m * c[0][1] + k * tau[1],
                        m * c[0][2] + k * tau[2],
                    ],
                    [
                        m * c[1][0] + k * tau[1],
                        m * c[1][1] + k * tau[3],
                        m * c[1][2] + k * tau[4],
                    ],
                    [
                        m * c[2][0] + k * tau[2],
                        m * c[2][1] + k * tau[4],
                        m * c[2][2] + k * tau[5],
                    ],
                ]);
                let stencil = grid.stencil(particles.position[p], dx);
                grid.weigh(&stencil, m);
                if held[p] {
                    // Heavy, free of stress, and past the gravity that is still to come.
                    let heavy = ANCHOR * m;
                    let affine = Mat3(c.map(|row| row.map(|x| heavy * x)));
                    let v = std::array::from_fn(|i| {
                        particles.velocity[p][i] / keep - kick * self.gravity[i]
                    });
                    grid.scatter(&stencil, heavy, v, &affine);
                } else {
                    grid.scatter(&stencil, m, particles.velocity[p], &affine);
                }
                stencils[p] = Some(stencil);
            }
        }

        // Grid: momentum to velocity, gravity, boundaries.
        let boundaries = self.boundaries.on_nodes(&self.paths, &substep);
        let mut nearest = vec![vec![Nearest::NONE; boundaries.bodies().len()]; grid.nodes.len()];
        for (p, stencil) in stencils.iter().enumerate() {
            let Some(stencil) = stencil else { continue };
            for (b, body) in boundaries.bodies().iter().enumerate() {
                let (x, volume) = (particles.position[p], particles.volume[p]);
                if let Some(found) = body.nearest(x, volume, dx) {
                    stencil
                        .slots()
                        .for_each(|slot| nearest[slot][b].take(&found));
                }
            }
        }
        // A particle half-way between two nodes gives nothing to the third.
        for (_, node) in grid.nodes.iter_mut().filter(|(_, node)| node.mass > 0.0) {
            node.velocity = std::array::from_fn(|i| {
                keep * (node.momentum[i] / node.mass + kick * self.gravity[i])
            });
        }
        let parts = self.parts.iter().zip(&self.materials);
        let all = parts.map(|(part, material)| (0, part.material.density, material.law));
        let tell_edges = tell_edges(1, all)[0];
        grid.constrain(&boundaries, &nearest, tell_edges, dt, dx);

        // G2P, then every particle moves.
        for (p, stencil) in stencils.iter().enumerate() {
            let Some(stencil) = stencil else { continue };
            let (mut v, mut c) = grid.gather(stencil, dx);
            let ghosts = touch
                .as_ref()
                .map(|touch| touch.ghosts(particles.position[p], v));
            if let Some(ghosts) = ghosts.filter(|ghosts| !ghosts.is_empty()) {
                (v, c) = grid.gather_seen(stencil, particles.position[p], &ghosts, dx);
            }
            particles.velocity[p] = v;
            particles.affine[p] = c.0;
        }
        for (part, material) in self.parts.iter().zip(&self.materials) {
            particles.move_and_deform(part, material, dt);
        }
        if let Some(touch) = &touch {
            for part in &self.parts {
                for p in part.particles.clone().filter(|&p| stencils[p].is_some()) {
                    let way = Way {
                        from: before[p],
                        to: particles.position[p],
                        v: particles.velocity[p],
                    };
                    if let Some(touched) = touch.after(p as u32, way) {
                        particles.position[p] = touched.x;
                        particles.velocity[p] = touched.v;
                        particles.set_affine(p, touched.affine);
                    }
                }
            }
        }

        let slack = match self.scene.conditions.domain_policy {
            DomainPolicy::Bounce => 2.0 * dx,
            DomainPolicy::Delete | DomainPolicy::Stop => 0.0,
        };
        let domain = Aabb {
            min: self.scene.domain.min.map(|x| x - slack),
            max: self.scene.domain.max.map(|x| x + slack),
        };
        for (p, stencil) in stencils.iter().enumerate() {
            if stencil.is_none() {
                continue;
            }
            if !domain.contains(particles.position[p]) {
                particles.mass[p] = 0.0;
                particles.volume[p] = 0.0;
                report.left_domain.push(p as u32);
            }
            report.particle_updates += 1;
        }

        self.sim_time += dt;
        report.substeps += 1;
        report.dt = dt;
        if report.substeps == 1 || dt < report.dt_min {
            report.dt_min = dt;
            report.dt_limit = cause.limit;
            report.dt_object = cause.object;
        }
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
    pub fn objects(&self) -> Vec<crate::ObjectState> {
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
                crate::ObjectState { level, ..state }
            })
            .collect()
    }
}

fn momentum(object: &crate::ObjectState) -> [f64; 3] {
    object.linear_velocity.map(|v| v * object.mass)
}

#[cfg(test)]
mod against_fast;
#[cfg(test)]
mod each_material;
#[cfg(test)]
mod tests;
