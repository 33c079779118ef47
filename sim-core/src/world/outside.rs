//! What frames leave behind of what acts from outside: ways of colliders, impulses, gravity that is on its way.

use super::{Frame, State, World, published::Published};
use crate::{colliders::Path, scene::DomainPolicy};

impl World {
    /// What gravity has yet to add to velocities of particles for them to be those of now [m/s].
    pub(super) fn offset_velocity(&self) -> [f64; 3] {
        let offset = self.state.motion.velocity_offset;
        self.state.commanded.gravity.map(|g| offset * g)
    }

    /// What a frame that may have to be undone began with.
    pub(super) fn before_stop(&self) -> Option<(State, Published)> {
        let stops = self.model.scene.conditions.domain_policy == DomainPolicy::Stop;
        stops.then(|| (self.state.clone(), self.published.clone()))
    }

    /// Undoes a frame in which particles left a domain that none may leave.
    pub(super) fn stop(&mut self, before: Option<(State, Published)>, frame: &mut Frame) {
        if let Some((state, published)) = before
            && frame.lost_particles()
        {
            self.state = state;
            self.published = published;
            // The grid belongs to the arrangement that was undone.
            self.state.matter.drift = f64::INFINITY;
            frame.stop();
        }
    }

    /// What a frame leaves behind: colliders stand where commands sent them, and what impulses gave is no contact.
    pub(super) fn end_frame(&mut self, frame: &Frame) {
        if frame.is_stopped() {
            return;
        }
        for path in self.state.commanded.paths.iter_mut().flatten() {
            *path = Path {
                from: path.to,
                to: path.to,
            };
        }
        let start = self.state.progress.sim_time;
        let ledgers = [&self.state.in_contact.ledger, &self.state.bodies.ledger];
        let springs = ledgers.into_iter().flat_map(|ledger| ledger.springs());
        let springs: Vec<_> = springs
            .map(|(object, given)| (object, given.impulse))
            .collect();
        let given = self.model.rules.given(start, start + frame.length);
        for (object, impulse) in given.into_iter().chain(springs) {
            for a in 0..3 {
                self.state.progress.momentum[object][a] += impulse[a];
            }
        }
    }
}
