//! Faces and edges that lie flush with what a body is on already: nothing to run into.
//!
//! Beside a seam of two flush solids a point that is a little deep in the one is nearest to the side of the other, behind which the first
//! is. A body that slides would stop there, or be thrown up.

use super::{
    candidates::{Moment, Solid},
    vector::{Vec3, along, length},
};
use crate::mat3::dot;

/// How far off a seam it is looked for what covers it, and how much a flush solid may stand above the other [cells]: more than bodies
/// overlap by.
const ASIDE: f64 = 1e-2;
const LEVEL: f64 = 5e-3;
/// Sine of the angle between two normals below which they are those of one face.
const ALIKE: f64 = 1e-3;

/// Whether the surface of an obstacle at a place, with the normal out of it, goes on from that of a support that is touched there, and is
/// covered by it. `dx` is the cell size [m].
fn is_covered(obstacle: &Solid, out: Vec3, x: Vec3, support: &Solid, dx: f64) -> bool {
    let beside = ASIDE * dx;
    // At the seam itself the support ends, and may be nearest by its side.
    let back = along(x, beside, out);
    let up = support.normal(back);
    let height = support.distance(back) - beside * dot(out, up);
    if height.abs() > LEVEL * dx {
        return false;
    }
    let across = along(out, -dot(out, up), up);
    let size = length(across);
    if size < ALIKE {
        return false;
    }
    let ahead = across.map(|x| x / size);
    // In front of the obstacle, below the surface of the support; and in the obstacle, above that surface.
    let front = along(along(x, beside, ahead), -beside, up);
    let above = along(along(x, -beside, ahead), LEVEL * dx, up);
    support.distance(front) < 0.0 && obstacle.distance(above) > 0.0
}

/// Whether a point of contact of two, with the normal out of the second, is at a seam between one of them and what the other is on
/// besides: by their numbers. A collider is on nothing.
pub(super) fn is_at_seam(
    moment: &Moment<'_>,
    [a, b]: [u32; 2],
    (x, normal): (Vec3, Vec3),
    dx: f64,
) -> bool {
    let out = normal.map(|n| -n);
    [(a, b, normal), (b, a, out)]
        .iter()
        .any(|&(of, obstacle, out)| {
            let supports = moment.neighbours[of as usize].iter();
            let mut supports =
                supports.filter(|n| (of as usize) < moment.bodies && **n != obstacle);
            let solid = |n: u32| &moment.solids[n as usize];
            let obstacle = solid(obstacle);
            supports.any(|n| is_covered(obstacle, out, x, solid(*n), dx))
        })
}
