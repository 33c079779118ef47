//! The largest allowed substep and what limits it.

use super::World;
use crate::{
    materials::limits::{DeformationBounds, critical_dt},
    report::DtLimit,
    scene::Fidelity,
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
    /// Largest allowed substep at the current state: `cfl` times the sound limit of the current tangents
    /// (numerically the isolated-particle limit), and the kinematic limits.
    pub(super) fn time_step(&self) -> Limit {
        let mut limit = Limit::FRAME;
        for (id, object) in self.scene.objects.iter().enumerate() {
            if object.fidelity == Fidelity::Static || object.particles.is_empty() {
                continue;
            }
            let extremes = &self.state.extremes[id];
            let bounds = DeformationBounds {
                max_stretch: f64::from(extremes.stretch_squared).sqrt(),
                min_j: f64::from(extremes.min_j).min(1.0),
                max_j: f64::from(extremes.max_j),
                max_stiffness: 1.0,
            };
            let sound = self.scene.cfl * self.critical_dt(id, &bounds);
            let speed = f64::from(extremes.speed_squared).sqrt();
            let rate = f64::from(extremes.rate_squared).sqrt();
            limit.lower(sound, DtLimit::Sound, Some(id));
            limit.lower(PLANNED_TRAVEL / speed, DtLimit::Velocity, Some(id));
            limit.lower(PLANNED_STRAIN / rate, DtLimit::Deformation, Some(id));
        }
        let grid = PLANNED_TRAVEL / self.state.grid_speed;
        limit.lower(grid, DtLimit::Velocity, None);
        limit
    }

    /// Smallest substep that is planned: beyond it, what demands it is left to the guard.
    pub(super) fn smallest_dt(&self, frame_dt: f64) -> f64 {
        let objects = self.scene.objects.iter().enumerate();
        let at_rest = objects
            .filter(|(_, object)| object.fidelity != Fidelity::Static)
            .map(|(id, _)| self.critical_dt(id, &DeformationBounds::REST))
            .fold(f64::INFINITY, f64::min);
        (self.scene.cfl * at_rest / 64.0).min(frame_dt / 65_536.0)
    }

    fn critical_dt(&self, object: usize, bounds: &DeformationBounds) -> f64 {
        critical_dt(
            &self.state.materials[object],
            self.scene.objects[object].material.density,
            self.scene.dx,
            bounds,
        )
    }
}
