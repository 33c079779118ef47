//! The surface of a solid at rest as points with areas and normals, found from the volumes of its matter.
//!
//! Whole pieces of a lattice show their faces, at whose corners points sit, so that edges and corners of a box are among them.
//! A piece that is cut has one point on the plane that leaves its volume behind, across the gradient of filling
//! (piecewise linear reconstruction, Youngs 1982).

use std::collections::BTreeMap;

use super::{
    lattice::{Lattice, Seed},
    model::{Bears, SolidModel},
};
use crate::mat3::length;

/// Filling from which on a piece is whole.
pub(super) const WHOLE: f64 = 0.999;
/// Smallest area of a point, in faces of a piece.
const SMALLEST: f64 = 0.02;
/// Smallest component of a normal that the volume behind a plane is worked out with.
const SLANT: f64 = 1e-4;

/// A point of the surface.
#[derive(Clone, Debug)]
pub struct SurfacePoint {
    /// Where at rest [m].
    pub x: [f64; 3],
    /// Area that it stands for [m^2].
    pub area: f64,
    /// Nodes that bear what acts on it, with weights of sum 1 that reproduce linear fields.
    pub bears: Bears,
}

/// A point before it is on a grid, along the axes of the lattice: its place [m], area [m^2], the matter behind it.
struct Found {
    x: [f64; 3],
    area: f64,
    owner: [f64; 3],
}

/// Points of the surface of matter.
pub fn surface(model: &SolidModel, seeds: &[Seed]) -> Vec<SurfacePoint> {
    let lattice = &model.lattice;
    let filling = filling(lattice, seeds);
    let mut found = cut_pieces(lattice, &filling);
    found.extend(whole_faces(lattice, &filling));
    let on_grid = found.into_iter().filter_map(|point| {
        let (x, owner) = (lattice.world(point.x), lattice.world(point.owner));
        let site = model.site(x, owner);
        let site = site.or_else(|| model.site_near(x))?;
        Some(SurfacePoint {
            bears: model.bears(&site),
            x,
            area: point.area,
        })
    });
    on_grid.collect()
}

/// Filling of the lattice, with the place of some matter in each along its axes.
pub(super) type Filling = BTreeMap<[i64; 3], (f64, [f64; 3])>;

pub(super) fn filling(lattice: &Lattice, seeds: &[Seed]) -> Filling {
    let &Lattice {
        edge,
        corner: first,
        ..
    } = lattice;
    let mut filling = Filling::new();
    for seed in &lattice.seeds(seeds) {
        let index = std::array::from_fn(|a| ((seed.position[a] - first[a]) / edge).floor() as i64);
        let piece = filling.entry(index).or_insert((0.0, seed.position));
        piece.0 += seed.volume / edge.powi(3);
    }
    filling
}

/// Corners of the faces of whole pieces that have no neighbour there.
fn whole_faces(lattice: &Lattice, filling: &Filling) -> Vec<Found> {
    let &Lattice {
        edge,
        corner: first,
        ..
    } = lattice;
    let mut corners: BTreeMap<[i64; 3], (f64, [f64; 3], [f64; 3])> = BTreeMap::new();
    for (index, (filled, owner)) in filling.iter().filter(|(_, piece)| piece.0 >= WHOLE) {
        for face in 0..6 {
            let (axis, side) = (face / 2, face as i64 % 2);
            let mut next = *index;
            next[axis] += 2 * side - 1;
            if filling.contains_key(&next) {
                continue;
            }
            for n in 0..4 {
                let mut at = *index;
                at[axis] += side;
                at[(axis + 1) % 3] += n / 2;
                at[(axis + 2) % 3] += n % 2;
                let point = corners.entry(at).or_insert((0.0, [0.0; 3], *owner));
                point.0 += 0.25 * filled.min(1.0) * edge * edge;
                point.1[axis] += (2 * side - 1) as f64;
            }
        }
    }
    let corners = corners.into_iter().filter_map(|(at, (area, sum, owner))| {
        let size = length(sum);
        // Where faces look in opposite directions there is no outside.
        (size > 0.0).then(|| Found {
            x: std::array::from_fn(|a| first[a] + edge * at[a] as f64),
            area,
            owner,
        })
    });
    corners.collect()
}

/// The planes of pieces that are cut.
fn cut_pieces(lattice: &Lattice, filling: &Filling) -> Vec<Found> {
    let &Lattice {
        edge,
        corner: first,
        ..
    } = lattice;
    let cut = filling.iter().filter(|(_, piece)| piece.0 < WHOLE);
    let cut = cut.filter_map(|(index, (own, owner))| {
        let (height, normal, area) = plane_of(filling, index, *own)?;
        Some(Found {
            x: std::array::from_fn(|a| {
                first[a] + edge * (index[a] as f64 + 0.5 + height * normal[a])
            }),
            area: area * edge * edge,
            owner: *owner,
        })
    });
    cut.collect()
}

/// Height above its centre, normal and area of the plane in a cut piece, in its edges; none where it has next to no area.
pub(super) fn plane_of(
    filling: &Filling,
    index: &[i64; 3],
    own: f64,
) -> Option<(f64, [f64; 3], f64)> {
    let filled = |index: [i64; 3]| filling.get(&index).map_or(0.0, |piece| piece.0.min(1.0));
    let mut slope = [0.0; 3];
    for n in 0..27 {
        let o: [i64; 3] = [n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1];
        let steps: u64 = o.iter().map(|o| o.unsigned_abs()).sum();
        let weight = [4.0, 2.0, 1.0, 0.5][steps as usize];
        let there = filled(std::array::from_fn(|a| index[a] + o[a]));
        for a in 0..3 {
            slope[a] -= weight * o[a] as f64 * there;
        }
    }
    let size = length(slope);
    if size < 1e-6 {
        return None;
    }
    let normal = slope.map(|n| n / size);
    let (height, area) = plane(normal, own);
    (area > SMALLEST).then_some((height, normal, area))
}

/// Height above the centre of a unit cube of the plane across `normal` that has `volume` behind it, and its area in the cube.
fn plane(normal: [f64; 3], volume: f64) -> (f64, f64) {
    let n = normal.map(|n| n.abs().max(SLANT));
    let all = n[0] + n[1] + n[2];
    let (mut low, mut high) = (0.0, all);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match behind(n, middle) < volume {
            true => low = middle,
            false => high = middle,
        }
    }
    let step = 1e-3 * all;
    let (a, b) = ((low - step).max(0.0), (low + step).min(all));
    let area = (behind(n, b) - behind(n, a)) / (b - a) * length(n);
    ((low - 0.5 * all) / length(n), area)
}

/// Volume of the unit cube where `n . x < alpha` (Scardovelli and Zaleski 2000).
fn behind(n: [f64; 3], alpha: f64) -> f64 {
    let cube = |x: f64| x.max(0.0).powi(3);
    let single: f64 = n.iter().map(|n| cube(alpha - n)).sum();
    let pairs = cube(alpha - n[0] - n[1]) + cube(alpha - n[0] - n[2]) + cube(alpha - n[1] - n[2]);
    let all = cube(alpha - n[0] - n[1] - n[2]);
    (cube(alpha) - single + pairs - all) / (6.0 * n[0] * n[1] * n[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{DENSITY, ball, lattice};

    #[test]
    fn points_of_a_box_have_its_area_and_corners() {
        let seeds = lattice(0.1, [0.0; 3], [2, 3, 2], |_| true);
        let model = SolidModel::new(0.1, &seeds);
        let points = surface(&model, &seeds);
        let area: f64 = points.iter().map(|p| p.area).sum();
        assert!((area - 2.0 * (0.06 + 0.06 + 0.04)).abs() < 1e-12, "{area}");
        let corners = [[0.0, 0.0, 0.0], [0.2, 0.3, 0.2]];
        for corner in corners {
            let off = |p: &SurfacePoint| length(std::array::from_fn(|a| p.x[a] - corner[a]));
            assert!(points.iter().any(|p| off(p) < 1e-9));
        }
        for point in &points {
            let sum: f64 = point.bears.iter().map(|b| f64::from(b.1)).sum();
            assert!((sum - 1.0).abs() < 1e-6);
            for a in 0..3 {
                let at: f64 = point
                    .bears
                    .iter()
                    .map(|&(slot, w)| f64::from(w) * model.node_in_world(slot as usize)[a])
                    .sum();
                assert!((at - point.x[a]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn points_of_a_ball_are_on_it() {
        let (radius, dx) = (0.5, 0.125);
        let seeds = ball(dx, [0.03, -0.02, 0.01], radius);
        let model = SolidModel::new(dx, &seeds);
        let mass: f64 = seeds.iter().map(|s| s.volume * DENSITY).sum();
        assert!((model.total_mass / mass - 1.0).abs() < 1e-6);
        let points = surface(&model, &seeds);
        let area: f64 = points.iter().map(|p| p.area).sum();
        let exact = 4.0 * std::f64::consts::PI * radius * radius;
        assert!((area / exact - 1.0).abs() < 0.05, "{area} {exact}");
        for point in &points {
            let r: [f64; 3] = std::array::from_fn(|a| point.x[a] - [0.03, -0.02, 0.01][a]);
            // A plane across an eighth of a radius: of second order.
            assert!((length(r) / radius - 1.0).abs() < 0.03, "{r:?}");
        }
    }
}
