//! The report of a step: moments, energies, contacts, hash.

use super::{World, frame::Frame, hash};
use crate::{
    episodes::Closed,
    moments::total_momentum,
    report::{ContactEpisode, ObjectCost, StepReport},
    substep::Tally,
};

impl World {
    /// Report of the current state and of what `frame` did.
    pub(super) fn measure(&mut self, frame: &Frame) -> StepReport {
        let mut report = frame.report(&self.state);
        let before = &self.report.objects;
        for id in 0..self.model.scene.objects.len() {
            let mut state = match before.get(id) {
                Some(old) if self.state.sleeps(id) => *old,
                _ => self.measured(id),
            };
            state.level = self.level(id, state.mass);
            let whole = self.mass_of_body(id) + self.mass_of_solid(id);
            // What left with particles that were taken out is no contact.
            let kept = match before.get(id) {
                Some(old) if old.mass > 0.0 => Some(state.mass / old.mass),
                _ => None,
            };
            for a in 0..3 {
                let momentum = state.mass * state.linear_velocity[a];
                let pulled = whole * frame.length + (state.mass - whole) * frame.kicked;
                let weight = self.state.commanded.gravity[a] * pulled;
                if let Some(kept) = kept {
                    let expected = kept * self.state.progress.momentum[id][a] + weight;
                    state.contact_impulse[a] = momentum - expected;
                }
                self.state.progress.momentum[id][a] = momentum;
                report.potential_energy -=
                    state.mass * self.state.commanded.gravity[a] * state.com[a];
            }
            report.kinetic_energy += state.kinetic_energy;
            report.elastic_energy += state.elastic_energy;
            report.objects.push(state);
        }
        let ledgers = [&self.state.in_contact.ledger, &self.state.bodies.ledger];
        report.lost_in_matter = ledgers.iter().map(|ledger| ledger.lost).sum();
        let springs = ledgers.into_iter().flat_map(|ledger| ledger.springs());
        report.spring_work = springs.map(|(_, given)| given.work).sum();
        [report.edit_energy, report.edit_mass] = self.workspace.edited;
        report.particle_updates_full = self
            .updates_of_full_mpm(frame.length, report.substeps)
            .max(report.particle_updates);
        let in_contact = &mut self.state.in_contact;
        let at_nodes = in_contact.at_nodes.take_closed();
        let (unit, dx) = (self.model.mass_unit, self.model.scene.dx);
        report.contacts = at_nodes.iter().map(|e| episode(e, unit, dx)).collect();
        let of_solids = in_contact.of_solids.take_closed();
        let of_solids = of_solids.iter().map(|e| episode(e, 1.0, 1.0));
        report.contacts.extend(of_solids);
        (report.linear_momentum, report.angular_momentum) = total_momentum(&report.objects);
        report.costs = self.costs(frame);
        report.state_hash = hash::state_hash(&self.published, &self.state);
        report
    }

    /// What each object cost in a frame.
    fn costs(&self, frame: &Frame) -> Vec<ObjectCost> {
        let Tally {
            timings, objects, ..
        } = &frame.tally;
        let (given, count) = (self.given(), self.model.scene.objects.len());
        let mut particles = vec![0; count];
        for (id, part) in self.model.parts.iter().enumerate() {
            if given.is_simulated(id) {
                particles[part.object] += self.model.particle_counts[id];
            }
        }
        let all: usize = particles.iter().sum();
        let is_body = |id: usize| self.state.bodies.of[id].is_some();
        let bodies = (0..count).filter(|&id| is_body(id)).count();
        let substeps = &self.workspace.substeps;
        let on_grid = timings.particles + timings.grid + timings.contact;
        let cost = |id: usize| {
            if let (Some(cost), Some(state)) = (objects.get(id), &self.state.solids[id])
                && cost.substeps > 0
            {
                let contact_points = state.contact_points() as u64;
                return ObjectCost {
                    contact_points,
                    ..*cost
                };
            }
            match particles[id] {
                0 if is_body(id) => ObjectCost {
                    seconds: timings.bodies / bodies as f64,
                    ..ObjectCost::default()
                },
                0 => ObjectCost::default(),
                own => ObjectCost {
                    seconds: on_grid * own as f64 / all as f64,
                    substeps: substeps.len() as u64,
                    dt_min: substeps.iter().copied().fold(f64::INFINITY, f64::min),
                    dt_limit: frame.limit_on_grid,
                    contact_points: 0,
                },
            }
        };
        (0..count).map(cost).collect()
    }

    /// Particle-substeps of a frame in which every particle is stepped, as often as was needed or, where more were
    /// asleep, as often as matter at rest needs.
    fn updates_of_full_mpm(&self, length: f64, substeps: u32) -> u64 {
        let at_rest = self.model.constants.rest_dt.iter().enumerate();
        let on_grid = |part: usize| {
            let object = self.model.parts[part].object;
            self.model.has_particles(part) && self.model.lagrangian[object].is_none()
        };
        let at_rest = at_rest.filter(|(id, _)| on_grid(*id));
        let shortest = at_rest.map(|(_, dt)| *dt).fold(f64::INFINITY, f64::min);
        let needed = (length / (self.model.scene.cfl * shortest)).ceil() as u64;
        let bodies = self.state.bodies.of.iter().zip(&self.model.lagrangian);
        let rigid = bodies.filter(|(_, solid)| solid.is_none());
        let rigid: usize = rigid
            .filter_map(|(r, _)| Some(r.as_ref()?.members.len()))
            .sum();
        let matter = (self.state.matter.live + rigid) as u64 * needed.max(u64::from(substeps));
        let solids = (0..self.state.solids.len()).map(|id| self.updates_of_full_solid(id, length));
        matter + solids.sum::<u64>()
    }
}

/// An ended contact in SI units.
fn episode(closed: &Closed, mass_unit: f64, dx: f64) -> ContactEpisode {
    let ratio = |speed: f64| (closed.closing_speed > 0.0).then(|| speed / closed.closing_speed);
    ContactEpisode {
        objects: closed.fields.map(|field| field as usize),
        impulse: closed.impulse.map(|p| p * mass_unit * dx),
        speed_before: closed.closing_speed * dx,
        speed_after: closed.separation_speed.map_or(0.0, |speed| speed * dx),
        lasting: closed.separation_speed.is_none(),
        restitution: closed.separation_speed.and_then(ratio),
        duration: closed.duration,
        time: closed.time,
    }
}
