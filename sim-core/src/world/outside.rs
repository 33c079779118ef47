//! What boundaries and rules mean for a frame: which blocks they concern, how fast they move matter.

use super::{Frame, State, World, fidelity::extent, published::Published};
use crate::{
    colliders::{Path, Substep, sweep::SKIN, touch::Touch},
    kinematics::kick,
    particles::{BLOCK, NO_PARTICLE},
    scene::DomainPolicy,
};

/// Largest speeds that come from outside in a substep [cells/s].
#[derive(Clone, Copy, Debug)]
pub(super) struct OutsideSpeeds {
    /// Of prescribed particles.
    pub prescribed: f64,
    /// Of colliders that act on particles; none when no particle is near one.
    pub colliders: Option<f64>,
}

impl World {
    /// The substep of size `dt` that comes next, of objects that are not slow.
    pub(super) fn substep(&self, frame: &Frame, dt: f64) -> Substep {
        Substep {
            time: self.state.sim_time + (frame.length - frame.remaining()),
            dt,
            kick: kick(self.state.lag, dt, self.scene.cfl)[0],
            frame_start: self.state.sim_time,
            frame_length: frame.length,
        }
    }

    /// What acts on single particles between two substeps.
    pub(super) fn touch(&self, now: Substep, next: Substep) -> Option<Touch<'_>> {
        Touch::new(
            &self.boundaries,
            &self.state.paths,
            &self.rules,
            &self.state.pins,
            now,
            next,
            self.state.gravity,
        )
    }

    /// How far velocities are behind positions after a substep of `dt` [s].
    pub(super) fn lag_after(&self, dt: f64) -> f64 {
        kick(self.state.lag, dt, self.scene.cfl)[1]
    }

    /// What gravity has yet to add to velocities of an object's particles for them to be those of now [m/s].
    pub(super) fn owed(&self, object: usize) -> [f64; 3] {
        let lag = self.state.lags[object];
        self.state.gravity.map(|g| lag * g)
    }

    /// The carrier velocity after a transfer in which forces act for `kick` [s]: gravity and damping are its own.
    pub(super) fn carrier_after(&self, kick: f64) -> [f64; 3] {
        let keep = self.scene.conditions.damping_factor(kick) as f32;
        std::array::from_fn(|a| {
            let pulled = kick * self.state.gravity[a] / self.scene.dx;
            (self.state.carrier[a] + pulled) * f64::from(keep)
        })
    }

    /// Largest speed on the grid once boundaries and rules are counted [cells/s]; the one returned bounds how far
    /// particles travel.
    pub(super) fn speed_with_boundaries(&mut self, substep: &Substep) -> f64 {
        let outside = self.outside_speeds(substep);
        self.state.grid_speed = self.state.grid_speed.max(outside.prescribed);
        match outside.colliders {
            None => self.state.grid_speed,
            Some(speed) => {
                self.state.grid_speed += 2.0 * speed;
                // Contact may turn a particle's way into one axis and moves it by its skin.
                3.0_f64.sqrt() * self.state.grid_speed + 2.0 * SKIN / substep.dt
            }
        }
    }

    /// Notes which blocks hold particles that a rule names, and how far blocks reach.
    pub(super) fn survey(&mut self) {
        let particles = &self.state.particles;
        let concerned = &mut self.workspace.concerned;
        concerned.clear();
        if !self.rules.are_empty(&self.state.pins) {
            let named = |id: &u32| *id != NO_PARTICLE && self.rules.concern(&self.state.pins, *id);
            concerned.extend(particles.blocks.iter().map(|block| {
                let mut fixed = particles.fixed[block.groups.clone()].iter();
                fixed.any(|group| group.id.iter().any(named))
            }));
        }
        let nowhere = [[i32::MAX; 3], [i32::MIN; 3]];
        self.workspace.extent = extent(&particles.blocks).unwrap_or(nowhere);
    }

    /// How fast boundaries and rules may move particles in a substep.
    pub(super) fn outside_speeds(&self, substep: &Substep) -> OutsideSpeeds {
        let touch = self.touch(*substep, *substep);
        let [min, max] = self.workspace.extent;
        let Some(touch) = touch.filter(|_| min[0] <= max[0]) else {
            return OutsideSpeeds {
                prescribed: 0.0,
                colliders: None,
            };
        };
        // Blocks, and what may have drifted out of them.
        let min = min.map(|i| f64::from(BLOCK * i) - 2.5);
        let max = max.map(|i| f64::from(BLOCK * (i + 1)) + 1.5);
        OutsideSpeeds {
            prescribed: self.rules.speed(&self.workspace.prescribed, substep),
            colliders: touch.collider_speed(min, max),
        }
    }

    /// What a frame that may have to be undone began with.
    pub(super) fn before_stop(&self) -> Option<(State, Published)> {
        let stops = self.scene.conditions.domain_policy == DomainPolicy::Stop;
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
            self.state.drift = f64::INFINITY;
            frame.stop();
        }
    }

    /// What a frame leaves behind: colliders stand where commands sent them, and what impulses gave is no contact.
    pub(super) fn settle(&mut self, frame: &Frame) {
        if frame.is_stopped() {
            return;
        }
        for path in self.state.paths.iter_mut().flatten() {
            *path = Path {
                from: path.to,
                to: path.to,
            };
        }
        let start = self.state.sim_time;
        for (object, impulse) in self.rules.given(start, start + frame.length) {
            for a in 0..3 {
                self.state.momentum[object][a] += impulse[a];
            }
        }
    }
}
