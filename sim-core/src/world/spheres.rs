//! `contact = "com_sphere"`: objects meet as spheres, between segments of substeps.
//!
//! The test runs where velocities are written out anyway, at the start of every segment: after 32 substeps at most, and
//! before any particle has moved by more than a cell. Once per published frame would let fast objects overlap by
//! centimetres before they notice; once per substep would need the moments of all objects between P2G and G2P, for an
//! impulse that is no less rigid.

use rayon::prelude::*;

use super::{World, frame::Frame};
use crate::{
    contact_com::{RESTITUTION, Sphere, collide},
    particles::{NO_PARTICLE, Run, position_in_cells},
    scene::ContactMethod,
    simd::LANES,
};

/// Sums over the particles of one run: mass, `m r`, `m v`, `m r^2`.
type Sums = [f64; 8];

impl World {
    /// Lets objects collide as spheres where the scene wants it so.
    pub(super) fn meet_as_spheres(&mut self, frame: &mut Frame) {
        if self.model.scene.contact.method != ContactMethod::ComSphere {
            return;
        }
        let mut spheres = self.spheres();
        frame.tally.work.object_particles += (self.state.matter.live - frame.asleep) as u64;
        let before: Vec<[f64; 3]> = spheres.iter().map(|s| s.velocity).collect();
        let scene = &self.model.scene;
        frame.tally.work.object_pairs += collide(&mut spheres, |a, b| {
            let surface = scene.surface_between(a, b);
            surface.restitution.unwrap_or(RESTITUTION)
        });
        let mut met = false;
        for (object, (after, before)) in spheres.iter().zip(before).enumerate() {
            let change: [f64; 3] = std::array::from_fn(|a| after.velocity[a] - before[a]);
            if change != [0.0; 3] {
                self.add_velocity(object, change.map(|v| v as f32), None);
                met = true;
            }
        }
        if met {
            self.survey_speeds([0.0; 3]);
        }
    }

    /// Every object as a sphere.
    fn spheres(&self) -> Vec<Sphere> {
        let particles = &self.state.matter.particles;
        let dx = self.model.scene.dx;
        // Sums about a point of the object: none cancels when it is far from the origin.
        let about: Vec<[f64; 3]> = self
            .report
            .objects
            .iter()
            .map(|object| object.com.map(|x| x / dx))
            .collect();
        let partial: Vec<Vec<(usize, Sums)>> = particles
            .blocks
            .par_iter()
            .map(|block| {
                let runs = particles.runs[block.runs.clone()].iter();
                runs.map(|run| {
                    let object = self.model.parts[run.part].object;
                    (object, self.run_sums(run, block.index, about[object]))
                })
                .collect()
            })
            .collect();
        let mut sums = vec![[0.0; 8]; about.len()];
        // In the order of the blocks, for any number of threads.
        for (object, more) in partial.into_iter().flatten() {
            for (sum, more) in sums[object].iter_mut().zip(more) {
                *sum += more;
            }
        }
        let sphere = |(sums, about): (&Sums, &[f64; 3])| {
            let [mass, x, y, z, px, py, pz, square] = *sums;
            if mass <= 0.0 {
                return Sphere::default();
            }
            let r = [x / mass, y / mass, z / mass];
            let spread = square / mass - r.iter().map(|r| r * r).sum::<f64>();
            Sphere {
                mass,
                center: std::array::from_fn(|a| about[a] + r[a]),
                velocity: [px / mass, py / mass, pz / mass],
                radius: (5.0 / 3.0 * spread).max(0.0).sqrt(),
            }
        };
        sums.iter().zip(&about).map(sphere).collect()
    }

    fn run_sums(&self, run: &Run, block: [i32; 3], about: [f64; 3]) -> Sums {
        let particles = &self.state.matter.particles;
        let mut sums = [0.0; 8];
        for g in run.groups.clone() {
            let (fixed, motion) = (&particles.fixed[g], &particles.motion[g]);
            for lane in (0..LANES).filter(|&lane| fixed.id[lane] != NO_PARTICLE) {
                let mass = f64::from(fixed.mass.0[lane]);
                let x = [0, 1, 2].map(|a| particles.groups[g].x[a].0[lane]);
                let x = position_in_cells(block, x);
                sums[0] += mass;
                for a in 0..3 {
                    let r = x[a] - about[a];
                    sums[1 + a] += mass * r;
                    sums[4 + a] += mass * f64::from(motion.v[a].0[lane]);
                    sums[7] += mass * r * r;
                }
            }
        }
        sums
    }
}
