//! What a solid takes while it rests and touches nothing, told from the scene alone: its grid is not made for it.

use super::{
    lattice::Lattice,
    limit::FASTEST,
    model::count_cells,
    object::{is_solid, law_of, seeds},
};
use crate::scene::Scene;

/// Squared frequency of the fastest motion about rest over its bound: blocks have 0.53 to 0.85, what is cut raggedly up to twice that.
const USUAL: f64 = 0.6;

/// The substeps of a solid at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Quadrature points of its grid.
    pub points: usize,
    /// Substep [s], > 0: of a block within a fifth of what the fastest motion, once it is measured, allows; up to 1.8 times that of what is
    /// cut raggedly.
    pub dt: f64,
}

/// Of an object of the scene; none of one that is no solid, or has no particles.
pub fn expected(scene: &Scene, id: usize) -> Option<Expected> {
    let object = &scene.objects[id];
    if !is_solid(object) {
        return None;
    }
    let seeds = seeds(scene, object);
    let lattice = Lattice::of(scene.dx, &seeds);
    let pieces = lattice.seeds(&seeds);
    let laws = object
        .materials()
        .map(|material| law_of(material, material));
    let stiffest = laws.map(|law| law.tangent_at_rest() / law.density);
    let squared = FASTEST * USUAL * stiffest.fold(0.0, f64::max) / scene.dx.powi(2);
    Some(Expected {
        points: 8 * count_cells(scene.dx, &lattice, &pieces),
        dt: 2.0 * scene.cfl / squared.sqrt(),
    })
}
