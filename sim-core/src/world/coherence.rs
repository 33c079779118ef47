//! The coherence constraint on particles, where segments of substeps end.

use rayon::prelude::*;

use super::{World, frame::Frame};
use crate::{
    coherence::{Mode, Sums},
    mat3::cross,
    materials::Law,
    particles::{NO_PARTICLE, Run, position_in_cells},
    scene::Coherence,
    simd::LANES,
};

impl World {
    /// Brings the velocities of coherent objects nearer to their nearest coherent motion, after `dt` [s] of substeps.
    ///
    /// Only matter that is within its elastic limit takes part: fluids, sand, pastes and yielded particles are left
    /// alone, and so is the momentum of the others.
    pub(super) fn cohere(&mut self, frame: &mut Frame, dt: f64) {
        let objects = self.model.scene.objects.iter();
        let wanted: Vec<Option<Coherence>> = objects.map(|object| object.coherence).collect();
        if wanted.iter().all(Option::is_none) {
            return;
        }
        let sums = self.coherence_sums(&wanted);
        let modes: Vec<Option<(Mode, f64)>> = wanted
            .iter()
            .zip(&sums)
            .map(|(wanted, sums)| {
                let wanted = wanted.as_ref()?;
                let mode = Mode::nearest(sums, wanted.mode)?;
                Some((mode, wanted.part(dt)))
            })
            .collect();
        let about = self.centers();
        let particles = &mut self.state.matter.particles;
        let mut count = 0;
        for block in &particles.blocks {
            for run in &particles.runs[block.runs.clone()] {
                let part = &self.model.parts[run.part];
                let Some((mode, step)) = &modes[part.object] else {
                    continue;
                };
                let held = held(self.state.commanded.materials[run.part].law);
                let about = about[part.object];
                for g in run.groups.clone() {
                    let memory = &particles.memory[g].0;
                    for lane in 0..LANES {
                        let used = particles.fixed[g].id[lane] != NO_PARTICLE;
                        if !used || !holds(held, memory[lane]) {
                            continue;
                        }
                        count += 1;
                        let x = [0, 1, 2].map(|a| particles.groups[g].x[a].0[lane]);
                        let x = position_in_cells(block.index, x);
                        let goal = mode.at(std::array::from_fn(|a| x[a] - about[a]));
                        let motion = &mut particles.motion[g];
                        for a in 0..3 {
                            let v = &mut motion.v[a].0[lane];
                            *v += (step * (goal[a] - f64::from(*v))) as f32;
                            for b in 0..3 {
                                let c = &mut motion.c[3 * a + b].0[lane];
                                *c += (step * (mode.gradient.0[a][b] - f64::from(*c))) as f32;
                            }
                        }
                    }
                }
            }
        }
        frame.tally.work.constrained_particles += count;
        // Single particles may have become faster: the slow ones of what moves as one.
        self.survey_speeds([0.0; 3]);
    }

    /// Does the same for solids after `dt` [s]: for their nodes.
    pub(super) fn cohere_solids(&mut self, dt: f64) {
        let moving: Vec<usize> = (0..self.state.solids.len())
            .filter(|&id| self.is_moving_solid(id))
            .collect();
        for id in moving {
            let state = &mut self.state.solids[id];
            let wanted = self.model.scene.objects[id].coherence;
            let (Some(wanted), Some(solid), Some(state)) =
                (wanted, &self.model.lagrangian[id], state)
            else {
                continue;
            };
            let grid = &solid.grid;
            let about = state.shift;
            let at: Vec<[f64; 3]> = (0..grid.mass.len())
                .map(|n| {
                    let x = state.position(grid, n);
                    std::array::from_fn(|a| (x[a] - about[a]) / grid.dx)
                })
                .collect();
            let mut sums = Sums::default();
            for n in grid.nodes() {
                let v = state.velocity_of(grid, n).map(|v| v / grid.dx);
                sums.add_node(grid.mass[n], at[n], v);
            }
            let Some(mode) = Mode::nearest(&sums, wanted.mode) else {
                continue;
            };
            let step = wanted.part(dt);
            let before = state.momenta(grid);
            state.change_velocities(grid, |n, v| {
                let goal = mode.at(at[n]);
                std::array::from_fn(|a| v[a] + step * (grid.dx * goal[a] - v[a]))
            });
            // The mode has the momenta that velocities have with the masses of nodes alone.
            let after = state.momenta(grid);
            let com = after.moment.map(|m| m / grid.total_mass);
            let missing = std::array::from_fn(|a| before.angular[a] - after.angular[a]);
            let spin = state.spin_with(grid, com, missing);
            state.change_velocities(grid, |n, v| {
                let r = std::array::from_fn(|a| grid.dx * at[n][a] + about[a] - com[a]);
                let turn = cross(spin, r);
                std::array::from_fn(|a| v[a] + turn[a])
            });
        }
    }

    /// A fixed point of every object [cells].
    fn centers(&self) -> Vec<[f64; 3]> {
        let objects = self.report.objects.iter();
        objects
            .map(|object| object.com.map(|x| x / self.model.scene.dx))
            .collect()
    }

    /// Sums over the particles that take part, per object.
    fn coherence_sums(&self, wanted: &[Option<Coherence>]) -> Vec<Sums> {
        let particles = &self.state.matter.particles;
        let about = self.centers();
        let partial: Vec<Vec<(usize, Sums)>> = particles
            .blocks
            .par_iter()
            .map(|block| {
                let runs = particles.runs[block.runs.clone()].iter();
                runs.filter(|run| wanted[self.model.parts[run.part].object].is_some())
                    .map(|run| {
                        let object = self.model.parts[run.part].object;
                        (object, self.held_sums(run, block.index, about[object]))
                    })
                    .collect()
            })
            .collect();
        let mut sums = vec![Sums::default(); wanted.len()];
        // In the order of the blocks, for any number of threads.
        for (object, more) in partial.iter().flatten() {
            sums[*object] += more;
        }
        sums
    }

    fn held_sums(&self, run: &Run, block: [i32; 3], about: [f64; 3]) -> Sums {
        let particles = &self.state.matter.particles;
        let held = held(self.state.commanded.materials[run.part].law);
        let mut sums = Sums::default();
        for g in run.groups.clone() {
            let (fixed, motion) = (&particles.fixed[g], &particles.motion[g]);
            for lane in 0..LANES {
                let used = fixed.id[lane] != NO_PARTICLE;
                if !used || !holds(held, particles.memory[g].0[lane]) {
                    continue;
                }
                let x = [0, 1, 2].map(|a| particles.groups[g].x[a].0[lane]);
                let x = position_in_cells(block, x);
                let r = std::array::from_fn(|a| x[a] - about[a]);
                let v = [0, 1, 2].map(|a| f64::from(motion.v[a].0[lane]));
                let c = std::array::from_fn(|a| {
                    std::array::from_fn(|b| f64::from(motion.c[3 * a + b].0[lane]))
                });
                sums.add(f64::from(fixed.mass.0[lane]), r, v, c);
            }
        }
        sums
    }
}

/// Which particles of a law take part.
#[derive(Clone, Copy, PartialEq, Eq)]
enum CoherentPart {
    All,
    /// Those whose memory says that they never yielded.
    Unyielded,
    None,
}

fn held(law: Law) -> CoherentPart {
    match law {
        Law::FixedCorotated | Law::NeoHookean | Law::Hencky => CoherentPart::All,
        Law::VonMises { .. } | Law::Snow { .. } | Law::Plasticine { .. } => CoherentPart::Unyielded,
        // A rigid object is coherent by itself.
        Law::DruckerPrager { .. } | Law::Foam { .. } | Law::Fluid { .. } | Law::Rigid => {
            CoherentPart::None
        }
    }
}

fn holds(held: CoherentPart, memory: f32) -> bool {
    match held {
        CoherentPart::All => true,
        CoherentPart::Unyielded => memory == 0.0,
        CoherentPart::None => false,
    }
}
