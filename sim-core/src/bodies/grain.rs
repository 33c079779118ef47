//! The cubes of matter that a body is made of.

use super::vector::Vec3;

/// Inertia per mass of the cubes that particles stand for [m^2].
pub(crate) fn of_cubes(grains: &[Grain]) -> f64 {
    let (mut mass, mut sum) = (0.0, 0.0);
    for g in grains {
        mass += g.mass;
        sum += g.mass * g.volume.cbrt().powi(2) / 6.0;
    }
    sum / mass
}

/// A particle of a body: place [m], mass [kg], volume [m^3].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grain {
    pub x: Vec3,
    pub mass: f64,
    pub volume: f64,
}
