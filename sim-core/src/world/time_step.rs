//! The largest allowed substep and what limits it.

use super::{World, pace::Pace};
use crate::{
    materials::limits::{DeformationBounds, critical_dt},
    report::DtLimit,
    scene::{Fidelity, Part},
};

/// Largest `|v| dt` that is planned [cells].
pub(super) const PLANNED_TRAVEL: f64 = 0.5;
/// Largest `|v| dt` that the guard lets pass [cells]: together with the drift allowed since sorting it keeps
/// every particle within one block of its own.
pub(super) const MAX_TRAVEL: f64 = 0.9;
/// Largest `dt |C|` that is planned.
pub(super) const PLANNED_STRAIN: f64 = 0.4;
/// Largest `dt |C|` that the guard lets pass. Below 1 the deformation gradient cannot turn inside out.
pub(super) const MAX_STRAIN: f64 = 0.6;

/// A substep and what limits it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limit {
    /// Size [s].
    pub dt: f64,
    /// Cause.
    pub cause: DtLimit,
    /// Object behind it.
    pub object: Option<usize>,
}

impl Limit {
    /// Limited by the frame alone.
    pub const FRAME: Self = Self {
        dt: f64::INFINITY,
        cause: DtLimit::Frame,
        object: None,
    };

    /// Keeps the smaller one; of equals the first.
    fn lower(&mut self, dt: f64, cause: DtLimit, object: Option<usize>) {
        if dt < self.dt {
            *self = Self { dt, cause, object };
        }
    }
}

impl World {
    /// Largest allowed substep at the current state, of those that objects share which are not slow: the limits of all,
    /// of slow ones their share.
    pub(super) fn time_step(&self, pace: &Pace) -> Limit {
        let mut limit = Limit::FRAME;
        for (id, part) in self.parts.iter().enumerate() {
            if self.is_simulated(id) {
                let own = self.limit_of(id);
                limit.lower(own.dt / pace.of(part.object), own.cause, own.object);
            }
        }
        let grid = PLANNED_TRAVEL / self.state.grid_speed / f64::from(pace.every);
        limit.lower(grid, DtLimit::Velocity, None);
        limit
    }

    /// Largest allowed substep of a part at its current state: `cfl` times the sound limit of the current tangents
    /// (numerically the isolated-particle limit), and the kinematic limits.
    pub(super) fn limit_of(&self, part: usize) -> Limit {
        let object = Some(self.parts[part].object);
        let extremes = &self.state.extremes[part];
        let bounds = DeformationBounds {
            max_stretch: f64::from(extremes.stretch_squared).sqrt(),
            min_j: f64::from(extremes.min_j).min(1.0),
            max_j: f64::from(extremes.max_j),
            max_stiffness: f64::from(extremes.stiffness),
        };
        let sound = self.scene.cfl * self.critical_dt(part, &bounds);
        let speed = f64::from(extremes.speed_squared).sqrt();
        let rate = f64::from(extremes.rate_squared).sqrt();
        let mut limit = Limit::FRAME;
        limit.lower(sound, DtLimit::Sound, object);
        limit.lower(PLANNED_TRAVEL / speed, DtLimit::Velocity, object);
        limit.lower(PLANNED_STRAIN / rate, DtLimit::Deformation, object);
        limit
    }

    /// Smallest substep that is planned: beyond it, what demands it is left to the guard.
    pub(super) fn smallest_dt(&self, frame_dt: f64) -> f64 {
        let at_rest = (0..self.parts.len())
            .filter(|&id| self.is_simulated(id))
            .map(|id| self.critical_dt(id, &DeformationBounds::REST))
            .fold(f64::INFINITY, f64::min);
        (self.scene.cfl * at_rest / 64.0).min(frame_dt / 65_536.0)
    }

    /// Particle-substeps of a frame in which every particle is stepped, as often as was needed or, where more were
    /// asleep, as often as matter at rest needs.
    pub(super) fn updates_of_full_mpm(&self, length: f64, substeps: u32) -> u64 {
        let parts = 0..self.parts.len();
        let at_rest = parts
            .filter(|&id| self.has_particles(id))
            .map(|id| self.critical_dt(id, &DeformationBounds::REST))
            .fold(f64::INFINITY, f64::min);
        let needed = (length / (self.scene.cfl * at_rest)).ceil() as u64;
        let rigid = self.state.rigid.iter().flatten();
        let rigid: usize = rigid.map(|rigid| rigid.members.len()).sum();
        (self.state.live + rigid) as u64 * needed.max(u64::from(substeps))
    }

    /// Whether a part has particles that are not for show alone.
    fn has_particles(&self, part: usize) -> bool {
        let Part {
            object, particles, ..
        } = &self.parts[part];
        self.scene.objects[*object].fidelity != Fidelity::Static && !particles.is_empty()
    }

    /// Whether a part has particles that move.
    pub(super) fn is_simulated(&self, part: usize) -> bool {
        let object = self.parts[part].object;
        self.has_particles(part) && !self.is_joined(part) && !self.state.sleeps(object)
    }

    fn critical_dt(&self, part: usize, bounds: &DeformationBounds) -> f64 {
        let material = &self.state.materials[part];
        let density = self.parts[part].material.density;
        let kept = self
            .scene
            .conditions
            .time_step_kept(material.law.is_fluid());
        kept * critical_dt(material, density, self.scene.dx, bounds)
    }
}
