//! Valid ranges of the numbers of a scene file: wide enough for a grain of sand and a building, and narrow
//! enough that squares and cubes stay finite in `f32`.

use super::reader::Bounds;

pub(super) const fn bounds(min: f64, max: f64, unit: &'static str) -> Bounds {
    Bounds { min, max, unit }
}

pub(super) const ACCELERATION: Bounds = bounds(-1e4, 1e4, "m/s^2");
pub(super) const DX: Bounds = bounds(1e-6, 1e3, "m");
pub(super) const CELLS_PER_OBJECT: Bounds = bounds(2.0, 1000.0, "cells");
pub(super) const PARTICLES_PER_CELL: Bounds = bounds(1.0, 64.0, "particles");
pub(super) const FRAME_RATE: Bounds = bounds(1e-3, 1e5, "frames/s");
pub(super) const CFL: Bounds = bounds(0.01, 1.5, "");
pub(super) const POSITION: Bounds = bounds(-1e5, 1e5, "m");
pub(super) const LENGTH: Bounds = bounds(1e-5, 1e4, "m");
pub(super) const SCALE: Bounds = bounds(1e-6, 1e6, "m per unit");
pub(super) const ANGLE: Bounds = bounds(-3600.0, 3600.0, "degrees");
pub(super) const DIRECTION: Bounds = bounds(-1e6, 1e6, "");
pub(super) const TOLERANCE: Bounds = bounds(1e-6, 0.5, "of the radius");
pub(super) const SETTLE: Bounds = bounds(0.0, 100.0, "s");
pub(super) const SHARE: Bounds = bounds(0.5, 1.0, "");
pub(super) const JITTER: Bounds = bounds(0.0, 0.5, "of the spacing");
pub(super) const FRICTION: Bounds = bounds(0.0, 100.0, "");
pub(super) const RESTITUTION: Bounds = bounds(0.0, 1.0, "");
pub(super) const COHERENCE: Bounds = bounds(0.0, 1e6, "1/s");
pub(super) const TIME: Bounds = bounds(0.0, 1e9, "s");
pub(super) const DAMPING: Bounds = bounds(0.0, 1e6, "1/s");
pub(super) const RPIC_DAMPING: Bounds = bounds(0.0, 1.0, "");
pub(super) const IMPULSE: Bounds = bounds(-1e9, 1e9, "N s, or N for a force");
pub(super) const OPACITY: Bounds = bounds(0.0, 1.0, "");
pub(super) const COLOR: Bounds = bounds(0.0, 1.0, "");
pub(super) const SPEED: Bounds = bounds(-1e4, 1e4, "m/s");
pub(super) const SPIN: Bounds = bounds(-1e4, 1e4, "rad/s");
pub(super) const RATE: Bounds = bounds(-1e4, 1e4, "1/s");
pub(super) const YOUNGS_MODULUS: Bounds = bounds(1e-3, 1e13, "Pa");
pub(super) const POISSON_RATIO: Bounds = bounds(0.0, 0.4999, "");
pub(super) const DENSITY: Bounds = bounds(1e-3, 1e6, "kg/m^3");
pub(super) const LOSS: Bounds = bounds(0.0, 1.0, "");
