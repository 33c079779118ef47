//! Particles in blocks, and the grid around them.

use super::{World, frame::Frame};
use crate::{
    particles::{Motion, NO_PARTICLE, extent},
    state::Matter,
    step::sort::sort,
    timed,
};

impl World {
    /// Sorts the particles and builds the grid around them.
    pub(super) fn rearrange(&mut self) {
        let Matter {
            particles, shaped, ..
        } = &mut self.state.matter;
        sort(particles, shaped, &mut self.workspace.sorted);
        std::mem::swap(particles, &mut self.workspace.sorted);
        self.fit_workspace();
        self.state.matter.drift = 0.0;
    }

    /// The same, as part of a frame.
    pub(super) fn sort(&mut self, frame: &mut Frame) {
        timed(&mut frame.tally.timings.sort, || self.rearrange());
    }

    /// Scratch memory and grid for the particles as they are arranged.
    pub(super) fn fit_workspace(&mut self) {
        let fixed = self
            .model
            .boundaries
            .fixed_on_nodes(&self.state.commanded.paths);
        let particles = &self.state.matter.particles;
        self.workspace.backup.fit(particles);
        let count = particles.groups.len();
        self.workspace.motion.resize(count, Motion::REST);
        self.workspace.grid.rebuild(&particles.blocks, &fixed);
        self.survey();
    }

    /// Notes which blocks hold particles that a rule names, and how far blocks reach.
    fn survey(&mut self) {
        let particles = &self.state.matter.particles;
        let concerned = &mut self.workspace.concerned;
        concerned.clear();
        let (pins, grabs) = (&self.state.commanded.pins, &self.state.commanded.grabs);
        if !self.model.rules.are_empty(pins) || !grabs.is_empty() {
            let is_held = |id: &u32| {
                grabs
                    .iter()
                    .any(|grab| grab.particles.binary_search(id).is_ok())
            };
            let named = |id: &u32| {
                *id != NO_PARTICLE && (self.model.rules.concern(pins, *id) || is_held(id))
            };
            concerned.extend(particles.blocks.iter().map(|block| {
                let mut fixed = particles.fixed[block.groups.clone()].iter();
                fixed.any(|group| group.id.iter().any(named))
            }));
        }
        let nowhere = [[i32::MAX; 3], [i32::MIN; 3]];
        self.workspace.extent = extent(&particles.blocks).unwrap_or(nowhere);
    }
}
