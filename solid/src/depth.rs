//! Signed distance from the surface of a solid at rest, on the lattice of its matter.

use super::{
    facets::{Facet, Pieces},
    lattice::Lattice,
};
use crate::mat3::{dot, length};

/// How far from the surface distances are exact [pieces of the lattice].
const BAND: i64 = 3;

/// Distances [m] at the corners of the lattice, negative inside, linear in between.
#[derive(Clone, Debug)]
pub struct DepthField {
    lattice: Lattice,
    /// The first of its corners that has a value, along its axes [m].
    first: [f64; 3],
    size: [usize; 3],
    values: Vec<f32>,
}

/// Share by which a facet may be farther than the nearest and still tell on which side a point is.
const NEAR: f64 = 1.2;
/// The same of its height over its plane, with room for rounding: what is farther is not near.
const FARTHEST: f64 = 1.0001 * NEAR;

impl Facet {
    /// Distance of a point, and its height over the facet's plane [m]; none where the height alone is more than `most`.
    #[inline(always)]
    fn distance(&self, x: [f64; 3], most: f64) -> Option<[f64; 2]> {
        let r: [f64; 3] = std::array::from_fn(|a| x[a] - self.center[a]);
        let height = dot(r, self.normal);
        if height.abs() > most {
            return None;
        }
        let beyond = match self.face {
            // A rectangle.
            Some(axis) => {
                let off: [f64; 3] = std::array::from_fn(|a| match a == axis {
                    true => 0.0,
                    false => (r[a].abs() - self.half[a]).max(0.0),
                });
                length(off)
            }
            // A disc.
            None => {
                let across = std::array::from_fn(|a| r[a] - height * self.normal[a]);
                (length(across) - (self.area / std::f64::consts::PI).sqrt()).max(0.0)
            }
        };
        Some([(height * height + beyond * beyond).sqrt(), height])
    }
}

impl DepthField {
    /// Of some matter, at least one piece, on its lattice.
    pub(super) fn new(pieces: &Pieces<'_>) -> Self {
        let lattice = pieces.lattice;
        let &Lattice {
            edge,
            corner: first,
            ..
        } = lattice;
        let bound = |a: usize, pick: fn(i64, i64) -> i64, none: i64| {
            pieces.places().map(|index| index[a]).fold(none, pick)
        };
        // Facets are in pieces and in those beside them.
        let min: [i64; 3] = std::array::from_fn(|a| bound(a, i64::min, i64::MAX) - 1 - BAND);
        let max: [i64; 3] = std::array::from_fn(|a| bound(a, i64::max, i64::MIN) + 2 + BAND);
        let size: [usize; 3] = std::array::from_fn(|a| (max[a] - min[a] + 1) as usize);
        let inside = |corner: [i64; 3]| {
            (0..8).any(|n| {
                let o = [n / 4, n / 2 % 2, n % 2];
                pieces.has(&std::array::from_fn(|a| corner[a] - o[a]))
            })
        };
        let at = |corner: [i64; 3]| -> usize {
            let [x, y, z] = [0, 1, 2].map(|a| (corner[a] - min[a]) as usize);
            (x * size[1] + y) * size[2] + z
        };
        let mut least = vec![f32::INFINITY; size.iter().product()];
        let is_near = |distance: f32, least: f32| f64::from(distance) <= NEAR * f64::from(least);
        // What is near the least so far: few, and all that are near it in the end.
        let mut near = vec![];
        let side = 2 * BAND + 2;
        for facet in &pieces.facets {
            // Corners of its piece, and BAND beyond; those are in the box around all of them.
            for n in 0..side.pow(3) {
                let o = [n / side.pow(2), n / side % side, n % side];
                let corner: [i64; 3] = std::array::from_fn(|a| facet.index[a] + o[a] - BAND);
                let x = std::array::from_fn(|a| first[a] + edge * corner[a] as f64);
                let corner = at(corner);
                let most = FARTHEST * f64::from(least[corner]);
                let Some(found) = facet.distance(x, most) else {
                    continue;
                };
                let [distance, height] = found.map(|d| d as f32);
                least[corner] = least[corner].min(distance);
                if is_near(distance, least[corner]) {
                    near.push((corner, distance, height));
                }
            }
        }
        // Beyond an edge a point is as far from both faces, and level with one: the other tells that it is outside.
        let mut tells = vec![0.0_f32; least.len()];
        for (corner, distance, height) in near {
            if is_near(distance, least[corner]) && height.abs() > tells[corner].abs() {
                tells[corner] = height;
            }
        }
        let signed = least.iter().zip(&tells);
        let mut values: Vec<f32> = signed.map(|(d, height)| d.copysign(*height)).collect();
        let far = (BAND as f64 * edge) as f32;
        for x in min[0]..=max[0] {
            for y in min[1]..=max[1] {
                for z in min[2]..=max[2] {
                    let value = &mut values[at([x, y, z])];
                    if value.abs() >= far {
                        *value = if inside([x, y, z]) { -far } else { far };
                    }
                }
            }
        }
        Self {
            first: std::array::from_fn(|a| first[a] + edge * min[a] as f64),
            lattice: lattice.clone(),
            size,
            values,
        }
    }

    /// Distance from the surface beyond which it is not known [m].
    pub fn far(&self) -> f64 {
        BAND as f64 * self.lattice.edge
    }

    /// Length of a piece of the lattice, between corners of which it is linear [m].
    pub fn edge(&self) -> f64 {
        self.lattice.edge
    }

    /// Distance at a rest position [m], and its gradient; none far outside.
    #[inline(always)]
    pub fn at(&self, x: [f64; 3]) -> Option<(f64, [f64; 3])> {
        let (x, edge) = (self.lattice.place(x), self.lattice.edge);
        let at: [f64; 3] = std::array::from_fn(|a| (x[a] - self.first[a]) / edge);
        let inside = |a: usize| at[a] >= 0.0 && at[a] < (self.size[a] - 1) as f64;
        if !(0..3).all(inside) {
            return None;
        }
        let low = at.map(|x| x as usize);
        let [x, y, z]: [f64; 3] = std::array::from_fn(|a| at[a] - low[a] as f64);
        // Along each axis: the value, and how much it changes by per piece.
        let along = |[a, b]: [f64; 2], share: f64| a + share * (b - a);
        let line = |i: usize, j: usize| {
            let start = ((low[0] + i) * self.size[1] + low[1] + j) * self.size[2] + low[2];
            let [a, b] = [self.values[start], self.values[start + 1]].map(f64::from);
            [along([a, b], z), b - a]
        };
        let plane = |i: usize| {
            let [[a, a_z], [b, b_z]] = [line(i, 0), line(i, 1)];
            [along([a, b], y), b - a, along([a_z, b_z], y)]
        };
        let [[a, a_y, a_z], [b, b_y, b_z]] = [plane(0), plane(1)];
        let value = along([a, b], x);
        let slope = [b - a, along([a_y, b_y], x), along([a_z, b_z], x)].map(|s| s / edge);
        Some((value, self.lattice.world(slope)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        lattice::Seed,
        tests::{ball, lattice},
    };

    #[test]
    fn beyond_its_edges_a_box_is_outside() {
        let seeds = lattice(0.1, [0.0; 3], [4, 4, 4], |_| true);
        let field = DepthField::new(&Pieces::new(&Lattice::of(0.1, &seeds), &seeds));
        let (edge, mut looked) = (0.05, 0);
        for n in 0..30_usize.pow(3) {
            let x = [n / 900, n / 30 % 30, n % 30].map(|k| -0.1 + 0.02 * (k as f64 + 0.37));
            let beyond = x.map(|x| (x - 0.2).abs() - 0.2);
            let outside = length(beyond.map(|b| b.max(0.0)));
            let exact = match outside > 0.0 {
                true => outside,
                false => beyond.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            };
            let Some((value, _)) = field.at(x) else {
                continue;
            };
            if exact.abs() < 0.1 {
                looked += 1;
                assert!(value * exact >= 0.0, "{x:?}: {value} {exact}");
                // What is linear between corners is `t^3` for `t` inside a corner: 0.385 edges.
                assert!(
                    (value - exact).abs() < 0.39 * edge,
                    "{x:?}: {value} {exact}"
                );
            }
        }
        assert!(looked > 10_000);
    }

    #[test]
    fn depth_in_a_box_and_a_ball_is_that_of_the_shape() {
        let of = |seeds: &[Seed]| DepthField::new(&Pieces::new(&Lattice::of(0.1, seeds), seeds));
        let field = of(&lattice(0.1, [0.0; 3], [4, 4, 4], |_| true));
        for (x, expected) in [
            ([0.2, 0.2, 0.02], -0.02),
            ([0.2, 0.2, 0.43], 0.03),
            ([0.03, 0.17, 0.21], -0.03),
        ] {
            let (value, slope) = field.at(x).expect("near");
            assert!((value - expected).abs() < 1e-6, "{x:?}: {value}");
            assert!((length(slope) - 1.0).abs() < 1e-5);
        }
        let field = of(&ball(0.1, [0.0; 3], 0.5));
        for x in [[0.47, 0.0, 0.0], [0.27, 0.27, 0.27], [-0.3, 0.4, 0.05]] {
            let (value, _) = field.at(x).expect("near");
            // A tenth of a cell, linear between corners of the lattice.
            assert!((value - (length(x) - 0.5)).abs() < 0.01, "{x:?}: {value}");
        }
    }
}
