//! The particle passes of a substep: one per class of objects that move in the same way.

use std::time::Instant;

use super::{
    World,
    frame::{Frame, Step},
    pace::{Classes, Stride},
    time_step::{MAX_STRAIN, MAX_TRAVEL},
};
use crate::{
    colliders::{Substep, touch::Touch},
    grid::{Sums, node_means},
    materials::{Coefficients, Material},
    particles::NO_PARTICLE,
    step::{
        constitutive::PartLaw,
        particle_pass::{Findings, Pass, Stage, particle_pass},
        volume::{NEARLY_INCOMPRESSIBLE, average_volume},
    },
};

impl World {
    /// Runs one particle pass: gathered motion advances by `step`, forces are those of the substep `next`.
    pub(super) fn particles(
        &mut self,
        frame: &mut Frame,
        stage: Stage,
        step: &Step,
        next: &Step,
    ) -> Findings {
        let start = Instant::now();
        let begins = stage == Stage::Scatter;
        let Classes { all, of } = self.classes(&frame.pace, begins);
        let next = (!begins).then_some(next);
        let substeps: Vec<[Substep; 2]> = all
            .iter()
            .map(|class| self.of_class(frame, class, step, next))
            .collect();
        // Of slow objects among others those forces that do not depend on velocities come by themselves.
        let laws = all
            .iter()
            .zip(&substeps)
            .map(|(class, [_, next])| match class.stride {
                Stride::Among => self.frictions(next.kick),
                Stride::Common | Stride::Apart => self.laws(next.kick),
            });
        let laws: Vec<Vec<PartLaw>> = laws.collect();
        // Field by field: particles and grid change while it is in use.
        let touches = substeps.iter().map(|&[now, next]| {
            Touch::new(
                &self.boundaries,
                &self.state.paths,
                &self.rules,
                &self.state.pins,
                now,
                next,
                self.state.gravity,
            )
        });
        let touches: Vec<Option<Touch<'_>>> = touches.collect();
        let mut passes = Vec::with_capacity(all.len());
        let smallest = self.smallest_dt(frame.length);
        for (([now, next], laws), touch) in substeps.iter().zip(&laws).zip(&touches) {
            passes.push(Pass {
                stage,
                dt: now.dt as f32,
                carrier: self.state.carrier,
                next_carrier: self.carrier_after(next.kick),
                next_keep: self.scene.conditions.damping_factor(next.kick),
                affine_kept: self.scene.conditions.affine_kept(),
                laws,
                max_strain: MAX_STRAIN as f32,
                max_speed: (MAX_TRAVEL / smallest) as f32,
                max_rate: (MAX_STRAIN / smallest) as f32,
                domain: self.domain_in_cells(),
                touch: touch.as_ref(),
                concerned: &self.workspace.concerned,
            });
        }
        let particles = self.moved(frame, &of);
        let findings = particle_pass(
            self.isa,
            &passes,
            &of,
            &mut self.state.particles,
            &mut self.workspace.backup,
            &mut self.workspace.motion,
            &mut self.workspace.grid,
        );
        if stage != Stage::Gather {
            let goes_on = |class: &Option<usize>| {
                let class = all[(*class)?];
                (class.stride == Stride::Among).then_some(0)
            };
            self.share_forces(frame, &of.iter().map(goes_on).collect::<Vec<_>>());
        }
        if stage != Stage::Scatter {
            frame.updates += particles;
            frame.work.grid_to_particle += particles;
        }
        if stage != Stage::Gather {
            frame.work.particle_to_grid += particles;
        }
        frame.timings.particles += start.elapsed().as_secs_f64();
        findings
    }

    /// Takes what objects that go on, those with the pass 0, brought to the grid for their velocities there, and works out what
    /// forces add to those per second.
    fn share_forces(&mut self, frame: &mut Frame, going_on: &[Option<usize>]) {
        if going_on.iter().all(Option::is_none) {
            return;
        }
        let fields = |field: u32| going_on[field as usize].is_some();
        node_means(self.isa, &mut self.workspace.grid, Sums::Velocities, fields);
        let pass = Pass {
            stage: Stage::Forces,
            dt: 0.0,
            carrier: self.state.carrier,
            next_carrier: self.state.carrier,
            next_keep: 1.0,
            affine_kept: None,
            laws: &self.laws(1.0),
            max_strain: f32::INFINITY,
            max_speed: f32::INFINITY,
            max_rate: f32::INFINITY,
            domain: self.domain_in_cells(),
            touch: None,
            concerned: &[],
        };
        frame.work.particle_to_grid += self.moved(frame, going_on);
        particle_pass(
            self.isa,
            &[pass],
            going_on,
            &mut self.state.particles,
            &mut self.workspace.backup,
            &mut self.workspace.motion,
            &mut self.workspace.grid,
        );
        node_means(self.isa, &mut self.workspace.grid, Sums::Forces, fields);
    }

    /// How many particles a pass moves that leaves out objects without a class.
    fn moved(&self, frame: &Frame, class_of: &[Option<usize>]) -> u64 {
        let moving = (self.state.live - frame.asleep) as u64;
        if class_of.iter().all(Option::is_some) {
            return moving;
        }
        let particles = &self.state.particles;
        let left_out = particles
            .blocks
            .iter()
            .filter(|b| class_of[b.field as usize].is_none());
        let groups = left_out.flat_map(|block| block.groups.clone());
        let of_group = |g: usize| {
            let ids = particles.fixed[g].id.iter();
            ids.filter(|&&id| id != NO_PARTICLE).count() as u64
        };
        moving - groups.map(of_group).sum::<u64>()
    }

    /// Lets nearly incompressible parts share their volume over the grid.
    pub(super) fn share_volume(&mut self, frame: &mut Frame) {
        let start = Instant::now();
        let laws = self.laws(0.0);
        average_volume(
            self.isa,
            &laws,
            &mut self.state.particles,
            &mut self.workspace.grid,
        );
        frame.timings.particles += start.elapsed().as_secs_f64();
    }

    /// The laws of that stress alone which depends on velocities: friction in fluids.
    fn frictions(&self, kick: f64) -> Vec<PartLaw> {
        let mut laws = self.laws(kick);
        for (law, material) in laws.iter_mut().zip(&self.state.materials) {
            match material.law.friction() {
                Some(friction) => {
                    law.coefficients = Coefficients::new(&Material {
                        law: friction,
                        ..material.clone()
                    });
                }
                None => law.stress_scale = 0.0,
            }
        }
        laws
    }

    /// Law and numbers of every part, where stress acts for `kick` [s].
    pub(super) fn laws(&self, kick: f64) -> Vec<PartLaw> {
        let dx = self.scene.dx;
        (0..self.parts.len())
            .map(|part| {
                let material = &self.state.materials[part];
                let density = self.parts[part].material.density;
                PartLaw {
                    law: material.law,
                    coefficients: Coefficients::new(material),
                    shares_volume: material.law.is_fluid()
                        || material.law.is_solid()
                            && material.poisson_ratio > NEARLY_INCOMPRESSIBLE,
                    cells_per_rest_mass: self.mass_unit / (density * dx * dx * dx),
                    stress_scale: (4.0 * kick / (density * dx * dx)) as f32,
                    visible: self.is_visible(part),
                }
            })
            .collect()
    }
}
