//! Faces and edges that lie flush with what a body is on already: nothing to run into.
//!
//! Beside a seam of two flush solids a point that is a little deep in the one is nearest to the side of the other, behind which the first
//! is. A body that slides would stop there, or be thrown up.

use super::{
    actor::{SLOP, TOUCH},
    feature::{Solid, Spot},
    vector::{along, length},
};
use crate::mat3::dot;

/// How far off a seam it is looked for what covers it, and how much a flush solid may stand above the other [cells]: more than bodies
/// overlap by.
const ASIDE: f64 = 1e-2;
const LEVEL: f64 = 2.0 * SLOP;
/// Sine of the angle between two normals below which they are those of one face.
const ALIKE: f64 = 1e-3;

/// A solid that moves, or stands, and one that it meets.
#[derive(Clone, Copy)]
struct Side<'a> {
    obstacle: &'a Solid<'a>,
    /// 1 where normals of spots are out of it, -1 where they are into it.
    sign: f64,
}

impl Side<'_> {
    /// Whether the obstacle's surface at a spot goes on from that of a support that is touched there, and is covered by it.
    fn is_covered(&self, spot: &Spot, support: &Solid<'_>, dx: f64) -> bool {
        let (beside, out) = (ASIDE * dx, spot.normal.map(|n| self.sign * n));
        // At the seam itself the support ends, and may be nearest by its side.
        let back = along(spot.x, beside, out);
        let up = support.normal(back);
        let height = support.distance(back) - beside * dot(out, up);
        if height.abs() > (TOUCH + LEVEL) * dx {
            return false;
        }
        let across = along(out, -dot(out, up), up);
        let size = length(across);
        if size < ALIKE {
            return false;
        }
        let ahead = across.map(|x| x / size);
        // In front of the obstacle, below the surface of the support; and in the obstacle, above that surface.
        let front = along(along(spot.x, beside, ahead), -beside, up);
        let above = along(along(spot.x, -beside, ahead), LEVEL * dx, up);
        support.distance(front) < 0.0 && self.obstacle.distance(above) > 0.0
    }
}

/// Leaves of the spots of a pair those that are at no seam between one of the two and what the other is on besides: `supports` of the
/// first and of the second.
pub(super) fn only_open<'a>(
    [a, b]: [&Solid<'a>; 2],
    supports: [&[Solid<'a>]; 2],
    spots: &mut Vec<Spot>,
    dx: f64,
) {
    let sides = [(b, 1.0), (a, -1.0)].map(|(obstacle, sign)| Side { obstacle, sign });
    spots.retain(|spot| {
        let mut both = sides.iter().zip(supports);
        !both.any(|(side, supports)| {
            let mut supports = supports.iter();
            supports.any(|support| side.is_covered(spot, support, dx))
        })
    });
}
