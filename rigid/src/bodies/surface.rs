//! The surface of a cloud of particles: smoothed occupancy on a grid, and the triangles where it is one half.

use super::vector::{Vec3, along};

/// Nodes around the particles on each side.
const MARGIN: f64 = 3.0;
/// Most nodes of a grid: the spacing grows beyond.
const MAX_NODES: f64 = 4e6;

/// Nodes of a regular grid, z fastest.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    /// Where node 0, 0, 0 is [m].
    pub origin: Vec3,
    /// Spacing [m].
    pub h: f64,
    /// Nodes along each axis.
    pub size: [usize; 3],
}

impl Lattice {
    /// Around all points with a spacing of about `h`.
    fn around(points: &[Vec3], mut h: f64) -> Self {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for x in points {
            for a in 0..3 {
                min[a] = min[a].min(x[a]);
                max[a] = max[a].max(x[a]);
            }
        }
        let count = |h: f64| -> f64 {
            let along = (0..3).map(|a| (max[a] - min[a]) / h + 2.0 * MARGIN + 1.0);
            along.product()
        };
        while count(h) > MAX_NODES {
            h *= 1.25;
        }
        // Nodes where a lattice of particles has its own: the faces of a block are then halfway between nodes.
        let origin = min.map(|x| x - MARGIN * h);
        let size = [0, 1, 2].map(|a| ((max[a] - min[a]) / h + 2.0 * MARGIN).round() as usize + 1);
        Self { origin, h, size }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// Index of a node.
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.size[1] + j) * self.size[2] + k
    }

    /// Where a node is.
    pub fn place(&self, node: [usize; 3]) -> Vec3 {
        [0, 1, 2].map(|a| self.origin[a] + self.h * node[a] as f64)
    }
}

/// Quadratic B-spline.
fn spline(d: f64) -> f64 {
    let d = d.abs();
    if d < 0.5 {
        0.75 - d * d
    } else if d < 1.5 {
        0.5 * (1.5 - d) * (1.5 - d)
    } else {
        0.0
    }
}

/// Height above the surface of a flat block, in spacings of its particles, at which the occupancy is `c`.
fn height(c: f64) -> f64 {
    if c <= 0.5 {
        1.0 - (2.0 * c).max(0.0).sqrt()
    } else {
        (2.0 * (1.0 - c)).max(0.0).sqrt() - 1.0
    }
}

/// The surface of a cloud of particles.
pub(super) struct Surface {
    pub lattice: Lattice,
    /// Heights above it at the nodes, in spacings and good within one of it.
    pub heights: Vec<f64>,
    /// Turned either way.
    pub triangles: Vec<[Vec3; 3]>,
}

impl Surface {
    /// Around particles.
    pub fn of(points: &[Vec3], volumes: &[f64]) -> Self {
        let (lattice, heights) = heights(points, volumes);
        let triangles = triangles(&lattice, &heights);
        Self {
            lattice,
            heights,
            triangles,
        }
    }
}

/// Heights above the surface of the particles' matter, in spacings and good within one of the surface, on a grid
/// around them. Each particle fills a cube of its volume, smoothed over its neighbours: around a lattice the sum is
/// 1 inside and one half where the cubes end.
fn heights(points: &[Vec3], volumes: &[f64]) -> (Lattice, Vec<f64>) {
    let mean = volumes.iter().sum::<f64>() / volumes.len() as f64;
    let lattice = Lattice::around(points, mean.cbrt());
    let mut filled = vec![0.0; lattice.len()];
    for (x, volume) in points.iter().zip(volumes) {
        let own = volume.cbrt();
        let reach = own.max(lattice.h);
        let share = (own / reach).powi(3);
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let at = (x[a] - lattice.origin[a]) / lattice.h;
            let span = 1.5 * reach / lattice.h;
            first[a] = (at - span).ceil().max(0.0) as usize;
            last[a] = ((at + span).floor() as usize).min(lattice.size[a] - 1);
        }
        for i in first[0]..=last[0] {
            for j in first[1]..=last[1] {
                for k in first[2]..=last[2] {
                    let node = lattice.place([i, j, k]);
                    let weight: f64 = (0..3).map(|a| spline((node[a] - x[a]) / reach)).product();
                    filled[lattice.index([i, j, k])] += share * weight;
                }
            }
        }
    }
    // What is too thin to fill anything has its surface at half of the most that it fills.
    let most = filled.iter().copied().fold(0.0, f64::max).min(1.0);
    let heights = filled.iter().map(|c| height((c / most).min(1.0)));
    (lattice, heights.collect())
}

/// Corners of a cell, and its six tetrahedra around the diagonal from corner 0 to 7.
const CORNERS: [[usize; 3]; 8] = [
    [0, 0, 0],
    [0, 0, 1],
    [0, 1, 0],
    [0, 1, 1],
    [1, 0, 0],
    [1, 0, 1],
    [1, 1, 0],
    [1, 1, 1],
];
const TETRAHEDRA: [[usize; 4]; 6] = [
    [0, 1, 3, 7],
    [0, 3, 2, 7],
    [0, 2, 6, 7],
    [0, 6, 4, 7],
    [0, 4, 5, 7],
    [0, 5, 1, 7],
];

/// Triangles, turned either way, of the surface where `heights` vanish (marching tetrahedra).
fn triangles(lattice: &Lattice, heights: &[f64]) -> Vec<[Vec3; 3]> {
    let mut found = Vec::new();
    let [x, y, z] = lattice.size;
    for i in 0..x - 1 {
        for j in 0..y - 1 {
            for k in 0..z - 1 {
                let nodes = CORNERS.map(|c| [i + c[0], j + c[1], k + c[2]]);
                let values = nodes.map(|node| heights[lattice.index(node)]);
                let inside = values.iter().filter(|v| **v < 0.0).count();
                if inside == 0 || inside == 8 {
                    continue;
                }
                for corners in TETRAHEDRA {
                    cut(
                        corners.map(|c| lattice.place(nodes[c])),
                        corners.map(|c| values[c]),
                        &mut found,
                    );
                }
            }
        }
    }
    found
}

/// The triangles of one tetrahedron.
fn cut(corners: [Vec3; 4], values: [f64; 4], found: &mut Vec<[Vec3; 3]>) {
    let (mut inside, mut outside) = ([0; 4], [0; 4]);
    let (mut ins, mut outs) = (0, 0);
    for n in 0..4 {
        if values[n] < 0.0 {
            inside[ins] = n;
            ins += 1;
        } else {
            outside[outs] = n;
            outs += 1;
        }
    }
    let between = |a: usize, b: usize| {
        let way = values[a] / (values[a] - values[b]);
        let step = [0, 1, 2].map(|i| corners[b][i] - corners[a][i]);
        along(corners[a], way, step)
    };
    let (p, q) = (inside, outside);
    match ins {
        1 => found.push([
            between(p[0], q[0]),
            between(p[0], q[1]),
            between(p[0], q[2]),
        ]),
        3 => found.push([
            between(p[0], q[0]),
            between(p[1], q[0]),
            between(p[2], q[0]),
        ]),
        2 => {
            let (a, b) = (between(p[0], q[0]), between(p[0], q[1]));
            let (c, d) = (between(p[1], q[0]), between(p[1], q[1]));
            found.push([a, b, c]);
            found.push([b, c, d]);
        }
        _ => {}
    }
}
