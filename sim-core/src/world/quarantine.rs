//! Particles that are taken out: what stays bad after retries, and what left the domain.

use super::{World, frame::Frame};
use crate::{
    particles::{Flags, NO_PARTICLE, Run},
    simd::LANES,
};

impl World {
    /// Freezes the particles flagged as bad where they are.
    pub(super) fn quarantine(&mut self, frame: &mut Frame) {
        if self.state.matter.particles.flags.iter().all(|f| f.bad == 0) {
            self.flag_fastest_run();
        }
        let bad = self.take_out(|flags| flags.bad);
        if bad.is_empty() {
            // What fails is not of particles: without their empty places there is no grid that could fail again.
            self.sort(frame);
        }
        frame.quarantined.extend(bad);
    }

    /// Object of the first particle flagged as bad.
    pub(super) fn first_flagged_object(&self) -> Option<usize> {
        let particles = &self.state.matter.particles;
        let flagged = |run: &&Run| {
            let flags = &particles.flags[run.groups.clone()];
            flags.iter().any(|f| f.bad != 0)
        };
        let run = particles.runs.iter().find(flagged)?;
        Some(self.model.parts[run.part].object)
    }

    /// Blames the run with the largest speed that holds a particle: the way out when the grid fails and none shows why.
    fn flag_fastest_run(&mut self) {
        let particles = &mut self.state.matter.particles;
        let speed = |run: &Run| run.extremes.speed_squared;
        let fixed = &particles.fixed;
        let is_filled = |run: &&Run| {
            let mut groups = fixed[run.groups.clone()].iter();
            groups.any(|group| group.id.iter().any(|&id| id != NO_PARTICLE))
        };
        let fastest = particles
            .runs
            .iter()
            .filter(is_filled)
            .max_by(|a, b| speed(a).total_cmp(&speed(b)));
        if let Some(run) = fastest {
            for flags in &mut particles.flags[run.groups.clone()] {
                flags.bad = u16::MAX;
            }
        }
    }

    /// Takes flagged particles out of the simulation; returns their ids in ascending order.
    pub(super) fn take_out(&mut self, which: fn(&Flags) -> u16) -> Vec<u32> {
        let particles = &mut self.state.matter.particles;
        // Their last state is what is displayed from now on; flagged lanes hold it, or what led to it.
        self.published.update(
            particles,
            self.state.motion.frame_velocity,
            self.model.scene.dx,
        );
        let mut ids = Vec::new();
        for group in 0..particles.groups.len() {
            let lanes = which(&particles.flags[group]);
            particles.flags[group] = Flags::default();
            for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
                let id = particles.fixed[group].id[lane];
                if id != NO_PARTICLE {
                    ids.push(id);
                    particles.remove(group, lane);
                    self.state.matter.live -= 1;
                }
            }
        }
        ids.sort_unstable();
        for &id in &ids {
            self.published.freeze(id);
        }
        self.state.matter.removed.extend(&ids);
        ids
    }
}
