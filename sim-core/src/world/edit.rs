//! Material edits while the world runs: what particles remember is carried over from law to law.

use super::World;
use crate::{
    mat3::Mat3,
    materials::{Law, Material},
    particles::{NO_PARTICLE, Particles, Run},
    simd::LANES,
};

impl World {
    /// Gives an object, or one of its regions, a new material.
    pub(super) fn set_material(
        &mut self,
        object: usize,
        region: Option<usize>,
        material: &Material,
    ) {
        let touched: Vec<usize> = (0..self.parts.len())
            .filter(|&p| {
                let part = &self.parts[p];
                part.object == object && (region.is_none() || part.region == region)
            })
            .collect();
        let mut reshaped = false;
        for &part in &touched {
            let old = self.state.materials[part].law;
            let becomes_solid = old.is_fluid() && !material.law.is_fluid();
            let shaped =
                self.is_shaped(part, material.law) || becomes_solid && self.is_visible(part);
            reshaped |= shaped && !self.state.shaped[part];
            self.state.shaped[part] |= shaped;
        }
        if reshaped {
            self.rearrange();
        }
        for part in touched {
            let old = std::mem::replace(&mut self.state.materials[part], material.clone());
            if old.law.id() != material.law.id() {
                let particles = &mut self.state.particles;
                let runs = particles.runs.clone();
                for run in runs.iter().filter(|run| run.part == part) {
                    carry_over(particles, run, old.law, material.law);
                }
            }
        }
    }
}

/// What the new law needs to know of the past under the old one: volume passes between solids and fluids, all
/// else that a law remembers means nothing to another.
fn carry_over(particles: &mut Particles, run: &Run, old: Law, new: Law) {
    let shapes = run.shapes.clone().map(Some).chain(std::iter::repeat(None));
    for (g, shape) in run.groups.clone().zip(shapes) {
        for lane in 0..LANES {
            if particles.fixed[g].id[lane] == NO_PARTICLE {
                continue;
            }
            let f = &mut particles.groups[g].f;
            let memory = &mut particles.memory[g].0[lane];
            match (old.is_fluid(), new.is_fluid()) {
                (false, true) => {
                    let elastic = Mat3(std::array::from_fn(|i| {
                        std::array::from_fn(|j| f[3 * i + j].0[lane])
                    }));
                    *memory = elastic.det() - 1.0;
                    if let Some(shape) = shape {
                        for n in 0..9 {
                            f[n].0[lane] = particles.shapes[shape].0[n].0[lane];
                        }
                    }
                }
                (true, false) => {
                    let stretch = (1.0 + *memory).cbrt();
                    *memory = 0.0;
                    for n in 0..9 {
                        f[n].0[lane] = if n % 4 == 0 { stretch } else { 0.0 };
                    }
                }
                (true, true) => {}
                (false, false) => *memory = 0.0,
            }
        }
    }
}
