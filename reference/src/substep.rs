//! One substep of the reference solver: rules, P2G, grid, G2P, motion, domain.

use cosplat_sim_core::{
    colliders::{ANCHOR, GapSample, ParticleConditions, Substep, Way},
    kinematics::kick,
    mat3::Mat3,
    materials::{Coefficients, Material, Trial},
    scene::{Aabb, DomainPolicy, Part},
};

use crate::{
    Frame, Particles, ReferenceWorld, TimeStep,
    grid::{Grid, Stencil},
};

/// What particles bring to the grid.
struct Scattered {
    grid: Grid,
    /// Per particle, if it is simulated.
    stencils: Vec<Option<Stencil>>,
}

impl ReferenceWorld {
    pub(crate) fn substep(&mut self, dt: f64, cause: TimeStep, frame: &mut Frame) {
        let [kick, lag] = kick(self.lag, dt, self.scene.cfl);
        self.lag = lag;
        let substep = Substep {
            time: self.sim_time,
            dt,
            kick,
            frame_start: frame.start_time,
            frame_length: frame.length,
        };
        let touch = ParticleConditions::new(
            &self.boundaries,
            &self.paths,
            &self.rules,
            &self.pins,
            substep,
            substep,
            self.gravity,
        );
        let touch = touch.as_ref();
        let held = prescribe(&mut self.particles, touch);
        let before = self.particles.position.clone();
        let mut scattered = self.scatter(&held, kick);
        self.grid_pass(&mut scattered, &substep);
        gather(&mut self.particles, &scattered, touch, self.scene.dx);
        for (part, material) in self.parts.iter().zip(&self.materials) {
            self.particles.move_and_deform(part, material, dt);
        }
        touch_after(&mut self.particles, &self.parts, &scattered, touch, &before);
        self.leave_domain(&scattered, frame);

        self.sim_time += dt;
        let report = &mut frame.report;
        report.substeps += 1;
        report.dt = dt;
        if report.substeps == 1 || dt < report.dt_min {
            report.dt_min = dt;
            report.dt_limit = cause.limit;
            report.dt_object = cause.object;
        }
    }

    /// P2G.
    fn scatter(&self, held: &[bool], kick: f64) -> Scattered {
        let (dx, particles) = (self.scene.dx, &self.particles);
        let keep = self.scene.conditions.damping_factor(kick);
        let mut grid = Grid::default();
        let mut stencils: Vec<Option<Stencil>> = vec![None; particles.mass.len()];
        for (part, material) in self.parts.iter().zip(&self.materials) {
            let numbers = Coefficients::new(material);
            for p in part.particles.clone() {
                let m = particles.mass[p];
                if m == 0.0 {
                    continue;
                }
                let c = self.affine_kept(p, material);
                let stencil = grid.stencil(particles.position[p], dx);
                if held[p] {
                    // Heavy, free of stress, and past the gravity that is still to come.
                    let heavy = ANCHOR * m;
                    let affine = Mat3(c.map(|row| row.map(|x| heavy * x)));
                    let v = std::array::from_fn(|i| {
                        particles.velocity[p][i] / keep - kick * self.gravity[i]
                    });
                    grid.scatter(&stencil, heavy, v, &affine);
                } else {
                    let affine = self.affine(p, material, &numbers, &c, kick);
                    grid.scatter(&stencil, m, particles.velocity[p], &affine);
                }
                stencils[p] = Some(stencil);
            }
        }
        Scattered { grid, stencils }
    }

    /// What a transfer keeps of the affine velocity of a particle.
    fn affine_kept(&self, p: usize, material: &Material) -> [[f64; 3]; 3] {
        let c = Mat3(self.particles.affine[p]);
        match self.scene.conditions.affine_kept() {
            Some([a, b]) if !material.law.is_rigid() => c.blend(a, &c.transpose(), b).0,
            _ => c.0,
        }
    }

    /// The affine matrix of a particle: `m C`, and the internal force of MLS-MPM, `-4 V0 / dx^2 tau (x_i - x_p) w_ip`.
    fn affine(
        &self,
        p: usize,
        material: &Material,
        numbers: &Coefficients<f64>,
        c: &[[f64; 3]; 3],
        kick: f64,
    ) -> Mat3<f64> {
        let (dx, particles) = (self.scene.dx, &self.particles);
        let state = Trial {
            f: Mat3(particles.elastic[p]),
            memory: particles.memory[p],
            gradient: Mat3(particles.affine[p]),
            dt: 0.0,
        };
        let tau = material.law.respond(&state, numbers).tau;
        let tau = [
            [tau[0], tau[1], tau[2]],
            [tau[1], tau[3], tau[4]],
            [tau[2], tau[4], tau[5]],
        ];
        let (m, k) = (
            particles.mass[p],
            -kick * particles.volume[p] * 4.0 / (dx * dx),
        );
        Mat3(std::array::from_fn(|i| {
            std::array::from_fn(|j| m * c[i][j] + k * tau[i][j])
        }))
    }

    /// Momentum to velocity, gravity, boundaries.
    fn grid_pass(&self, of: &mut Scattered, substep: &Substep) {
        let Scattered { grid, stencils } = of;
        let (dx, kick, particles) = (self.scene.dx, substep.kick, &self.particles);
        let boundaries = self.boundaries.on_nodes(&self.paths, substep);
        let mut nearest = vec![vec![GapSample::NONE; boundaries.bodies().len()]; grid.nodes.len()];
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
        let keep = self.scene.conditions.damping_factor(kick);
        for (_, node) in grid.nodes.iter_mut().filter(|(_, node)| node.mass > 0.0) {
            node.velocity = std::array::from_fn(|i| {
                keep * (node.momentum[i] / node.mass + kick * self.gravity[i])
            });
        }
        grid.constrain(&boundaries, &nearest, substep.dt, dx);
    }

    /// Takes particles out that left the domain.
    fn leave_domain(&mut self, of: &Scattered, frame: &mut Frame) {
        let slack = match self.scene.conditions.domain_policy {
            DomainPolicy::Bounce => 2.0 * self.scene.dx,
            DomainPolicy::Delete | DomainPolicy::Stop => 0.0,
        };
        let domain = Aabb {
            min: self.scene.domain.min.map(|x| x - slack),
            max: self.scene.domain.max.map(|x| x + slack),
        };
        let particles = &mut self.particles;
        for (p, stencil) in of.stencils.iter().enumerate() {
            if stencil.is_none() {
                continue;
            }
            if !domain.contains(particles.position[p]) {
                particles.mass[p] = 0.0;
                particles.volume[p] = 0.0;
                frame.report.left_domain.push(p as u32);
            }
            frame.report.particle_updates += 1;
        }
    }
}

/// Rules before the transfer; per particle whether its motion is prescribed.
fn prescribe(particles: &mut Particles, touch: Option<&ParticleConditions<'_>>) -> Vec<bool> {
    let mut held = vec![false; particles.mass.len()];
    if let Some(touch) = touch {
        for p in 0..particles.mass.len() {
            let (x, v) = (particles.position[p], particles.velocity[p]);
            if let Some(touched) = touch.before(p as u32, x, v) {
                particles.velocity[p] = touched.v;
                particles.set_affine(p, touched.affine);
                held[p] = touched.affine.is_some();
            }
        }
    }
    held
}

/// G2P.
fn gather(
    particles: &mut Particles,
    of: &Scattered,
    touch: Option<&ParticleConditions<'_>>,
    dx: f64,
) {
    for (p, stencil) in of.stencils.iter().enumerate() {
        let Some(stencil) = stencil else { continue };
        let (mut v, mut c) = of.grid.gather(stencil, dx);
        let ghosts = touch.map(|touch| touch.ghosts(particles.position[p], v));
        if let Some(ghosts) = ghosts.filter(|ghosts| !ghosts.is_empty()) {
            (v, c) = of
                .grid
                .gather_seen(stencil, particles.position[p], &ghosts, dx);
        }
        particles.velocity[p] = v;
        particles.affine[p] = c.0;
    }
}

/// Thin walls and rules after particles moved from where they were `before`.
fn touch_after(
    particles: &mut Particles,
    parts: &[Part],
    of: &Scattered,
    touch: Option<&ParticleConditions<'_>>,
    before: &[[f64; 3]],
) {
    let Some(touch) = touch else { return };
    for part in parts {
        let simulated = part.particles.clone();
        for p in simulated.filter(|&p| of.stencils[p].is_some()) {
            let way = Way {
                from: before[p],
                to: particles.position[p],
                v: particles.velocity[p],
            };
            if let Some(touched) = touch.after(p as u32, way, &mut |_| ()) {
                particles.position[p] = touched.x;
                particles.velocity[p] = touched.v;
                particles.set_affine(p, touched.affine);
            }
        }
    }
}
