//! The surface of a solid at rest as points with areas and normals, found from the volumes of its matter.
//!
//! Whole pieces of a lattice show their facets (`facets.rs`), at whose corners points sit, so that edges and corners of a box are
//! among them. Every other piece that the surface goes through has one point.

use std::collections::BTreeMap;

use super::{
    facets::{Facet, Pieces},
    model::SolidModel,
    nodes::Bears,
};
use crate::mat3::length;

/// A point of the surface.
#[derive(Clone, Debug)]
pub struct SurfacePoint {
    /// Where at rest [m].
    pub x: [f64; 3],
    /// Area that it stands for [m^2].
    pub area: f64,
    /// Unit normal outwards at rest; between those of the faces that meet at an edge.
    pub normal: [f64; 3],
    /// Nodes that bear what acts on it, with weights of sum 1 that reproduce linear fields.
    pub bears: Bears,
}

impl SurfacePoint {
    /// At a place amid or at the matter of `owner` [m]; none where the grid has no cells near. The normal is of length 1, or none.
    pub(super) fn new(
        model: &SolidModel,
        [x, owner]: [[f64; 3]; 2],
        area: f64,
        normal: [f64; 3],
    ) -> Option<Self> {
        let site = model.site(x, owner).or_else(|| model.site_near(x))?;
        Some(Self {
            x,
            area,
            normal,
            bears: model.bears(&site),
        })
    }
}

/// A point before it is on a grid, along the axes of the lattice: its place [m], area [m^2], unit normal, the matter behind it.
struct Found {
    x: [f64; 3],
    area: f64,
    normal: [f64; 3],
    owner: [f64; 3],
}

/// Points of the surface of matter.
pub(super) fn surface(model: &SolidModel, pieces: &Pieces<'_>) -> Vec<SurfacePoint> {
    let lattice = &model.lattice;
    let on_grid = points(&pieces.facets).into_iter().filter_map(|point| {
        let places = [point.x, point.owner].map(|x| lattice.world(x));
        SurfacePoint::new(model, places, point.area, lattice.world(point.normal))
    });
    on_grid.collect()
}

/// Middles of planes, and corners of faces that are not between such that look in opposite directions: there is no outside.
fn points(facets: &[Facet]) -> Vec<Found> {
    let mut corners: BTreeMap<[i64; 3], Found> = BTreeMap::new();
    let mut found = vec![];
    for facet in facets {
        let Some(axis) = facet.face else {
            found.push(Found {
                x: facet.center,
                area: facet.area,
                normal: facet.normal,
                owner: facet.owner,
            });
            continue;
        };
        for n in 0..4 {
            let (mut at, mut x) = (facet.index, facet.center);
            at[axis] += i64::from(facet.normal[axis] > 0.0);
            for (across, side) in [((axis + 1) % 3, n / 2), ((axis + 2) % 3, n % 2)] {
                at[across] += side;
                x[across] += (2 * side - 1) as f64 * facet.half[across];
            }
            let none = Found {
                x,
                area: 0.0,
                normal: [0.0; 3],
                owner: facet.owner,
            };
            let point = corners.entry(at).or_insert(none);
            point.area += 0.25 * facet.area;
            point.normal[axis] += facet.normal[axis];
        }
    }
    let corners = corners.into_values();
    let corners = corners.filter(|point| length(point.normal) > 0.0);
    found.extend(corners.map(|point| Found {
        normal: point.normal.map(|n| n / length(point.normal)),
        ..point
    }));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        lattice::Seed,
        tests::{DENSITY, ball, lattice},
    };

    #[test]
    fn points_of_a_box_have_its_area_and_corners() {
        let seeds = lattice(0.1, [0.0; 3], [2, 3, 2], |_| true);
        let model = SolidModel::new(0.1, &seeds);
        let points = surface(&model, &Pieces::new(&model.lattice, &seeds));
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

    /// Joins pieces with little matter to the fullest beside them, as filling does.
    fn with_slivers_joined(dx: f64, seeds: Vec<Seed>) -> Vec<Seed> {
        let (edge, whole) = (0.5 * dx, (0.5 * dx).powi(3));
        let beside = |a: &Seed, b: &Seed| {
            let steps: [i64; 3] = std::array::from_fn(|n| {
                let [a, b] = [a, b].map(|seed| (seed.position[n] / edge).floor() as i64);
                (a - b).abs()
            });
            steps.iter().sum::<i64>() == 1
        };
        let (slivers, mut kept): (Vec<Seed>, Vec<Seed>) = seeds
            .into_iter()
            .partition(|seed| seed.volume < 0.15 * whole);
        for sliver in slivers {
            let near = kept.iter_mut().filter(|seed| beside(seed, &sliver));
            if let Some(seed) = near.max_by(|a, b| a.volume.total_cmp(&b.volume)) {
                let all = seed.volume + sliver.volume;
                for a in 0..3 {
                    let moment =
                        seed.volume * seed.position[a] + sliver.volume * sliver.position[a];
                    seed.position[a] = moment / all;
                }
                seed.volume = all;
            }
        }
        kept
    }

    #[test]
    fn points_of_a_ball_are_on_it() {
        let (radius, dx) = (0.5, 0.125);
        let whole = ball(dx, [0.03, -0.02, 0.01], radius);
        let joined = with_slivers_joined(dx, whole.clone());
        assert!(joined.len() < whole.len());
        // Measured in cells, of which there are 4 per radius: 0.006 and 0.017; with slivers joined to others 0.016 and 0.077.
        for (seeds, bounds) in [(whole, [0.008, 0.025]), (joined, [0.02, 0.1])] {
            let model = SolidModel::new(dx, &seeds);
            let mass: f64 = seeds.iter().map(|s| s.volume * DENSITY).sum();
            assert!((model.total_mass / mass - 1.0).abs() < 1e-6);
            let points = surface(&model, &Pieces::new(&model.lattice, &seeds));
            let area: f64 = points.iter().map(|p| p.area).sum();
            let exact = 4.0 * std::f64::consts::PI * radius * radius;
            let off = points.iter().map(|point| {
                let r = std::array::from_fn(|a| point.x[a] - [0.03, -0.02, 0.01][a]);
                (length(r) - radius) / dx
            });
            let (sum, most) = off.fold((0.0, 0.0_f64), |(sum, most), off| {
                (sum + off * off, most.max(off.abs()))
            });
            let mean = (sum / points.len() as f64).sqrt();
            assert!((area / exact - 1.0).abs() < 0.02, "{area} {exact}");
            assert!(mean < bounds[0] && most < bounds[1], "{mean} {most}");
        }
    }
}
