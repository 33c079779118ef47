//! Where matter ends in front of a surface, told by the masses of the nodes across it.
//!
//! The nearest of the particles that reach a node may lie a cell and a half beside it: in front of a curved body that is
//! an error of first order, and of a lattice of particles it is a facet. Nodes know better. One that matter covers
//! from the height `h` above it on holds the share
//!
//! ```text
//! H(h) = integral of N(z) dz from h to infinity
//! ```
//!
//! of the mass of one inside, `N` being the spline, so that its mass tells the height: of all the matter that reaches
//! it, averaged. The sum over a lattice of particles is that integral but for two percent
//! (`docs/decisions/0009-contact.md`).
//!
//! Only matter that keeps its shape and has one density is looked at so. Where a line of nodes is nowhere inside, in
//! films and grains, the nearest particle decides as before: matter never ends nearer than it.

use super::approach::RANGE;
use crate::{materials::Law, num::cube_root};

/// Nodes in front of the one that is looked at, one of which is inside matter.
const INSIDE: i32 = 3;
/// How far from a node the line through it is looked at along an axis at most [nodes]: to the next block.
const LINE_OFFSET_MAX: f64 = 1.0;
/// How far the nodes that are looked at are from it along an axis at most [nodes].
pub const REACH: f64 = INSIDE as f64 + LINE_OFFSET_MAX;
/// Largest gap: farther matter counts as not there, and what is in front of it would go unseen [cells].
const GAP_MAX: f64 = 0.95 * RANGE;

/// Height above a node [cells] from which on matter holds this share, 0..=1, of the mass of a node inside: `H(h) = share`.
fn height(share: f64) -> f64 {
    const TAIL: f64 = 1.0 / 6.0;
    if share < TAIL {
        return 1.5 - cube_root(6.0 * share);
    }
    if share > 1.0 - TAIL {
        return cube_root(6.0 * (1.0 - share)) - 1.5;
    }
    // 1/2 - 3/4 h + h^3 / 3, by Newton's method: less than 1e-10 is left after three steps.
    let mut h = (0.5 - share) / 0.75;
    for _ in 0..3 {
        h -= (0.5 - 0.75 * h + h * h * h / 3.0 - share) / (h * h - 0.75);
    }
    h
}

/// The node nearest to a place on an axis [nodes], the one farther from 0 of two: a call of the library per axis and node otherwise,
/// where the processor need not round.
#[inline(always)]
pub fn nearest_node(x: f64) -> i32 {
    (x + 0.5_f64.copysign(x)) as i32
}

/// Height above the first node of a line from which on matter covers it, by the masses of the nodes from it inwards [cells];
/// infinite where there is none.
pub fn end(mass: impl Fn(i32) -> f64) -> f64 {
    let own = mass(0);
    let full = (1..=INSIDE).map(mass).fold(own, f64::max);
    if full > 0.0 {
        height(own / full)
    } else {
        f64::INFINITY
    }
}

/// Distance from a surface to where matter ends in the line of nodes along `normal` from a node that is `off` in front
/// of it, at most about half a cell [cells]; `mass` is what a node holds.
pub(super) fn line(
    base: [i32; 3],
    normal: [f64; 3],
    off: f64,
    mass: impl Fn([i32; 3]) -> f64,
) -> f64 {
    off + end(|n| {
        mass(std::array::from_fn(|a| {
            base[a] + nearest_node(f64::from(n) * normal[a])
        }))
    })
}

/// Distance from a surface to where matter ends in front of or behind a node [cells]. `surface` tells a node's distance from it
/// [cells] and its normal there.
pub fn edge(
    index: [i32; 3],
    surface: impl Fn([i32; 3]) -> (f64, [f64; 3]),
    mass: impl Fn([i32; 3]) -> f64,
) -> f64 {
    let ((off, normal), mut base) = (surface(index), index);
    // The node of its line that is nearest to the surface, as far as lines may begin beside a node.
    for a in 0..3 {
        let by = (off * normal[a]).clamp(-LINE_OFFSET_MAX, LINE_OFFSET_MAX);
        base[a] -= nearest_node(by);
    }
    let off = if base == index { off } else { surface(base).0 };
    line(base, normal, off, mass)
}

/// Gap of matter whose nearest particle has the gap `nearest`, and which ends at `edge` [cells].
pub fn gap(nearest: f64, edge: f64) -> f64 {
    nearest.max(edge.min(GAP_MAX))
}

/// Per grid field, of `count`, whether the masses of nodes tell where matter ends: it keeps its shape and has one density.
/// Parts by field, density [kg/m^3] and law.
pub fn reconstructs_surface(
    count: usize,
    parts: impl Iterator<Item = (usize, f64, Law)>,
) -> Vec<bool> {
    let mut first: Vec<Option<f64>> = vec![None; count];
    let mut tell = vec![true; count];
    for (field, density, law) in parts.filter(|(_, _, law)| !law.is_rigid()) {
        tell[field] &= law.is_solid() && density == *first[field].get_or_insert(density);
    }
    tell
}

#[cfg(test)]
mod tests;
