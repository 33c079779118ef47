//! The cubes of matter that a body is made of.

use super::vector::Vec3;

/// Inertia per mass of the cubes that particles stand for [m^2].
pub fn of_cubes(grains: &[Grain]) -> f64 {
    let (mut mass, mut sum) = (0.0, 0.0);
    for g in grains {
        mass += g.mass;
        sum += g.mass * g.volume.cbrt().powi(2) / 6.0;
    }
    sum / mass
}

/// A particle of a body.
#[derive(Clone, Copy, Debug)]
pub struct Grain {
    /// Place [m].
    pub x: Vec3,
    /// Mass [kg].
    pub mass: f64,
    /// Volume [m^3].
    pub volume: f64,
}
