//! What the particles' velocities are relative to, and how fast the fastest are: both bound the substep.

use rayon::prelude::*;

use super::World;
use crate::{particles::Particles, simd::LANES};

impl World {
    /// Makes the frame velocity the mean of all particles, so that what single precision rounds is small, and
    /// takes the largest speeds and rates, which commands may have changed.
    pub(super) fn recentre(&mut self) {
        let mut momentum = [0.0; 3];
        let mut mass = 0.0;
        let objects = self
            .report
            .objects
            .iter()
            .zip(&self.state.progress.momentum);
        for (_, (object, p)) in objects
            .enumerate()
            .filter(|(id, _)| !self.state.sleeps(*id) && self.state.bodies.of[*id].is_none())
        {
            mass += object.mass;
            for a in 0..3 {
                momentum[a] += p[a];
            }
        }
        let shift: [f32; 3] = std::array::from_fn(|a| {
            let mean = momentum[a] / (mass * self.model.scene.dx);
            let shift = (mean - self.state.motion.frame_velocity[a]) as f32;
            if shift.is_finite() { shift } else { 0.0 }
        });
        for a in 0..3 {
            self.state.motion.frame_velocity[a] += f64::from(shift[a]);
        }
        self.survey_speeds(shift);
    }

    /// Takes `shift` [cells/s], which the frame velocity got, from the velocities of all particles, and finds the largest
    /// speeds and rates.
    pub(super) fn survey_speeds(&mut self, shift: [f32; 3]) {
        let frame_velocity = self.state.motion.frame_velocity.map(|u| u as f32);
        let Particles {
            runs,
            motion,
            blocks,
            fixed,
            ..
        } = &mut self.state.matter.particles;
        let (mut runs, mut motion) = (runs.as_mut_slice(), motion.as_mut_slice());
        let mut work = Vec::with_capacity(blocks.len());
        for block in blocks {
            let (these, others) = runs.split_at_mut(block.runs.len());
            let (here, elsewhere) = motion.split_at_mut(block.groups.len());
            (runs, motion) = (others, elsewhere);
            work.push((block.groups.start, these, here));
        }
        work.into_par_iter().for_each(|(origin, runs, motion)| {
            for run in runs {
                let (mut speed, mut rate) = ([0.0_f32; LANES], [0.0_f32; LANES]);
                for group in run.groups.clone() {
                    let motion = &mut motion[group - origin];
                    let used = &fixed[group].mass.0;
                    for lane in (0..LANES).filter(|&lane| used[lane] > 0.0) {
                        let (mut v_squared, mut c_squared) = (0.0, 0.0);
                        for a in 0..3 {
                            motion.v[a].0[lane] -= shift[a];
                            let v = motion.v[a].0[lane] + frame_velocity[a];
                            v_squared += v * v;
                        }
                        for c in &motion.c {
                            c_squared += c.0[lane] * c.0[lane];
                        }
                        speed[lane] = speed[lane].max(v_squared);
                        rate[lane] = rate[lane].max(c_squared);
                    }
                }
                run.extremes.speed_squared = speed.into_iter().fold(0.0, f32::max);
                run.extremes.rate_squared = rate.into_iter().fold(0.0, f32::max);
            }
        });
        for extremes in &mut self.state.matter.extremes {
            (extremes.speed_squared, extremes.rate_squared) = (0.0, 0.0);
        }
        for run in &self.state.matter.particles.runs {
            let extremes = &mut self.state.matter.extremes[run.part];
            extremes.speed_squared = extremes.speed_squared.max(run.extremes.speed_squared);
            extremes.rate_squared = extremes.rate_squared.max(run.extremes.rate_squared);
        }
    }
}
