//! The largest allowed substep and what limits it.

use crate::{
    materials::limits::DeformationBounds,
    particles::Extremes,
    report::DtLimit,
    state::{Given, GridMotion, Matter},
};

/// Largest `|v| dt` that is planned [cells].
const PLANNED_TRAVEL: f64 = 0.5;
/// Largest `|v| dt` that the guard lets pass [cells]: together with the drift allowed since sorting it keeps
/// every particle within one block of its own.
pub(crate) const MAX_TRAVEL: f64 = 0.9;
/// Largest `dt |C|` that is planned.
const PLANNED_STRAIN: f64 = 0.4;
/// Largest `dt |C|` that the guard lets pass. Below 1 the deformation gradient cannot turn inside out.
pub(crate) const MAX_STRAIN: f64 = 0.6;

/// A bound of the substep and what sets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Limit {
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

/// Largest allowed substep at the current state: the smallest limit of all parts and of the grid.
pub(super) fn time_step(given: &Given<'_>, matter: &Matter, motion: &GridMotion) -> Limit {
    let mut limit = Limit::FRAME;
    for id in (0..given.model.parts.len()).filter(|&id| given.is_simulated(id)) {
        let own = limit_of(given, id, &matter.extremes[id]);
        limit.lower(own.dt, own.cause, own.object);
    }
    limit.lower(PLANNED_TRAVEL / motion.max_speed, DtLimit::Velocity, None);
    limit
}

/// Largest allowed substep of a part at its current state: `cfl` times the sound limit of the current tangents
/// (numerically the isolated-particle limit), and the kinematic limits.
fn limit_of(given: &Given<'_>, part: usize, extremes: &Extremes) -> Limit {
    let object = Some(given.model.parts[part].object);
    let bounds = DeformationBounds {
        max_stretch: f64::from(extremes.stretch_squared).sqrt(),
        min_j: f64::from(extremes.min_j).min(1.0),
        max_j: f64::from(extremes.max_j),
        max_stiffness: f64::from(extremes.stiffness),
    };
    let sound = given.model.scene.cfl * given.critical_dt(part, &bounds);
    let speed = f64::from(extremes.speed_squared).sqrt();
    let rate = f64::from(extremes.rate_squared).sqrt();
    let mut limit = Limit::FRAME;
    limit.lower(sound, DtLimit::Sound, object);
    limit.lower(PLANNED_TRAVEL / speed, DtLimit::Velocity, object);
    limit.lower(PLANNED_STRAIN / rate, DtLimit::Deformation, object);
    limit
}

/// Smallest substep that is planned or tried in a frame of this length [s]: beyond it, what demands it is left to the guard.
/// A step that is shorter than the scene's frame takes none that are smaller for that.
pub(crate) fn smallest_dt(given: &Given<'_>, length: f64) -> f64 {
    let at_rest = given.model.constants.rest_dt.iter().enumerate();
    let at_rest = at_rest.filter(|(id, _)| given.is_simulated(*id));
    let shortest = at_rest.map(|(_, dt)| *dt).fold(f64::INFINITY, f64::min);
    let frame = length.max(1.0 / given.model.scene.frame_rate);
    (given.model.scene.cfl * shortest / 64.0).min(frame / 65_536.0)
}
