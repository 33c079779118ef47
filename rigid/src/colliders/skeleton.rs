//! What sticks out of a collider: its corners and edges, and the middles of what is round.
//!
//! Bodies meet colliders at points of their own, which may pass on both sides of what is narrower than they are apart.

use std::collections::BTreeMap;

use parry3d_f64::{
    bounding_volume::Aabb,
    math::Vector,
    partitioning::{Bvh, BvhBuildStrategy},
};

use super::{mesh::Mesh, shape::Shape};
use crate::mat3::{cross, dot};

/// Points around a rim of a cylinder.
const AROUND: u32 = 24;
/// Sine of the angle between two triangles below which the edge between them sticks out of nothing.
const FLAT: f64 = 1e-6;

/// Corners and edges of a collider in its frame, and the middles of what is round [units].
#[derive(Clone, Debug, Default)]
pub struct Skeleton {
    /// Corners, and middles of spheres.
    pub corners: Vec<[f64; 3]>,
    /// Radius about each of those.
    pub corner_radius: f64,
    /// Edges, and axes of what is round about them, from one corner to another.
    pub lines: Vec<[u32; 2]>,
    /// Radius about each of those.
    pub line_radius: f64,
    /// Circles about y: radius and height.
    pub rims: Vec<[f64; 2]>,
    /// Where lines are, if they are many.
    tree: Option<Bvh>,
}

impl Skeleton {
    /// That of a shape.
    pub fn new(shape: &Shape) -> Self {
        match *shape {
            Shape::HalfSpace { .. } => Self::default(),
            Shape::Box { half_extents } => of_box(half_extents),
            Shape::Sphere { radius } => Self {
                corners: vec![[0.0; 3]],
                corner_radius: radius,
                ..Self::default()
            },
            Shape::Cylinder {
                radius,
                half_height,
            } => of_cylinder(radius, half_height),
            Shape::Capsule {
                radius,
                half_height,
            } => Self {
                corners: ends(half_height).to_vec(),
                corner_radius: radius,
                lines: vec![[0, 1]],
                line_radius: radius,
                ..Self::default()
            },
            Shape::Mesh(ref mesh) => of_mesh(mesh),
        }
    }

    /// Ends of a line.
    pub fn ends(&self, line: usize) -> [[f64; 3]; 2] {
        self.lines[line].map(|corner| self.corners[corner as usize])
    }

    /// Corners and lines that come as near to a place as `reach`, by their numbers.
    pub fn near(&self, place: [f64; 3], reach: f64) -> [Vec<usize>; 2] {
        let mut lines: Vec<usize> = match &self.tree {
            None => (0..self.lines.len()).collect(),
            Some(tree) => {
                let half = Vector::splat(reach + self.line_radius);
                let around = Aabb::from_half_extents(place.into(), half);
                let found = tree.intersect_aabb(&around).map(|n| n as usize);
                let mut found: Vec<usize> = found.collect();
                found.sort_unstable();
                found
            }
        };
        let mut corners: Vec<usize> = match &self.tree {
            None => (0..self.corners.len()).collect(),
            Some(_) => {
                let ends = lines.iter().flat_map(|&line| self.lines[line]);
                ends.map(|corner| corner as usize).collect()
            }
        };
        corners.sort_unstable();
        corners.dedup();
        let far = |x: [f64; 3]| {
            let off: [f64; 3] = std::array::from_fn(|a| x[a] - place[a]);
            dot(off, off).sqrt()
        };
        corners.retain(|&n| far(self.corners[n]) <= reach + self.corner_radius);
        lines.retain(|&n| far(nearest(self.ends(n), place)) <= reach + self.line_radius);
        [corners, lines]
    }
}

/// The point between two ends that is nearest to a place.
fn nearest([from, to]: [[f64; 3]; 2], place: [f64; 3]) -> [f64; 3] {
    let [way, off] = [to, place].map(|x| [0, 1, 2].map(|a: usize| x[a] - from[a]));
    let length = dot(way, way);
    let part = match length > 0.0 {
        true => (dot(way, off) / length).clamp(0.0, 1.0),
        false => 0.0,
    };
    std::array::from_fn(|a| from[a] + part * way[a])
}

fn ends(half_height: f64) -> [[f64; 3]; 2] {
    [-half_height, half_height].map(|y| [0.0, y, 0.0])
}

fn of_box(half: [f64; 3]) -> Skeleton {
    let side = |n: u32, axis: usize| if n >> axis & 1 == 0 { -1.0 } else { 1.0 };
    let corner = |n: u32| std::array::from_fn(|a| side(n, a) * half[a]);
    let along = |axis: u32| (0..8).filter(move |n| n >> axis & 1 == 0);
    let edges = (0..3).flat_map(|axis| along(axis).map(move |n| [n, n | 1 << axis]));
    Skeleton {
        corners: (0..8).map(corner).collect(),
        lines: edges.collect(),
        ..Skeleton::default()
    }
}

fn of_cylinder(radius: f64, half_height: f64) -> Skeleton {
    let mut corners = ends(half_height).to_vec();
    for [_, height, _] in ends(half_height) {
        for n in 0..AROUND {
            let angle = std::f64::consts::TAU * f64::from(n) / f64::from(AROUND);
            let (sin, cos) = angle.sin_cos();
            corners.push([radius * cos, height, radius * sin]);
        }
    }
    Skeleton {
        corners,
        lines: vec![[0, 1]],
        line_radius: radius,
        rims: vec![[radius, -half_height], [radius, half_height]],
        ..Skeleton::default()
    }
}

/// Edges at which triangles meet at an angle, outwards where the mesh has an inside, and those of its border.
fn of_mesh(mesh: &Mesh) -> Skeleton {
    let (points, triangles) = (mesh.corners(), mesh.triangles());
    // By the ends of an edge: the triangles there, each by the corner that is not of the edge.
    let mut edges: BTreeMap<[u32; 2], Vec<(usize, u32)>> = BTreeMap::new();
    for (n, t) in triangles.iter().enumerate() {
        for (a, b, c) in [(t[0], t[1], t[2]), (t[1], t[2], t[0]), (t[2], t[0], t[1])] {
            let edge = edges.entry([a.min(b), a.max(b)]).or_default();
            edge.push((n, c));
        }
    }
    let minus = |a: u32, b: u32| -> [f64; 3] {
        let [a, b] = [points[a as usize], points[b as usize]];
        std::array::from_fn(|n| a[n] - b[n])
    };
    let size = |v: [f64; 3]| dot(v, v).sqrt();
    let sticks_out = |(edge, there): &(&[u32; 2], &Vec<(usize, u32)>)| {
        let [(first, _), (_, beyond)] = there[..] else {
            return true;
        };
        let t = triangles[first];
        let normal = cross(minus(t[1], t[0]), minus(t[2], t[0]));
        let off = minus(beyond, edge[0]);
        let height = dot(normal, off);
        let flat = FLAT * size(normal) * size(off);
        match mesh.is_closed() {
            true => height < -flat,
            false => height.abs() > flat,
        }
    };
    let kept: Vec<[u32; 2]> = edges.iter().filter(sticks_out).map(|e| *e.0).collect();
    // Corners without such an edge are amid faces or in hollows.
    let mut numbers: Vec<u32> = kept.iter().flatten().copied().collect();
    numbers.sort_unstable();
    numbers.dedup();
    let place = |n: u32| numbers.partition_point(|known| *known < n) as u32;
    let corners: Vec<[f64; 3]> = numbers.iter().map(|&n| points[n as usize]).collect();
    let lines: Vec<[u32; 2]> = kept.iter().map(|edge| edge.map(place)).collect();
    let leaves = lines.iter().enumerate().map(|(n, line)| {
        let [from, to] = line.map(|corner| Vector::from(corners[corner as usize]));
        (n, Aabb::new(from.min(to), from.max(to)))
    });
    let tree = Bvh::from_iter(BvhBuildStrategy::Binned, leaves);
    Skeleton {
        tree: Some(tree),
        corners,
        lines,
        ..Skeleton::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::box_mesh;

    #[test]
    fn a_mesh_has_the_corners_and_edges_of_the_box_that_it_is() {
        let half = [0.5, 1.0, 2.0];
        let cuboid = Skeleton::new(&Shape::Box { half_extents: half });
        let mesh = Skeleton::new(&Shape::Mesh(Box::new(Mesh::new(&box_mesh(half), 1.0))));
        let edges = |of: &Skeleton| {
            let mut all: Vec<[[i64; 3]; 2]> = (0..of.lines.len())
                .map(|n| {
                    let mut ends = of.ends(n).map(|x| x.map(|x| (1e6 * x) as i64));
                    ends.sort_unstable();
                    ends
                })
                .collect();
            all.sort_unstable();
            all
        };
        // Not the diagonals of its faces.
        assert_eq!(edges(&cuboid), edges(&mesh));
        assert_eq!(mesh.corners.len(), 8);
        let place = [0.6, 0.0, 0.0];
        for of in [&cuboid, &mesh] {
            let [corners, lines] = of.near(place, 1.01);
            // Two edges along z, and no corner.
            assert_eq!((corners.len(), lines.len()), (0, 2), "{of:?}");
        }
    }
}
