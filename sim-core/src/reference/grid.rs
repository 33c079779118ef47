//! Background grid: quadratic B-spline weights, scatter and gather.

use std::collections::BTreeMap;

use crate::mat3::Mat3;

/// One grid node.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Node {
    /// Mass [kg].
    pub mass: f64,
    /// Momentum after P2G [kg m/s].
    pub momentum: [f64; 3],
    /// Velocity after forces and boundaries [m/s].
    pub velocity: [f64; 3],
}

/// Nodes touched in this substep; node `index` sits at `index * dx`.
#[derive(Clone, Debug, Default)]
pub(super) struct Grid {
    pub nodes: BTreeMap<[i32; 3], Node>,
}

/// The 27 nodes around a particle: index, weight, offset `x_i - x_p` [m].
#[derive(Clone, Debug)]
pub(super) struct Stencil(Vec<([i32; 3], f64, [f64; 3])>);

impl Stencil {
    /// Quadratic B-spline `N(r) = 3/4 - r^2` for `|r| < 1/2`, `(3/2 - |r|)^2 / 2` up to `3/2`.
    pub fn new(position: [f64; 3], dx: f64) -> Self {
        let spline = |r: f64| {
            if r.abs() < 0.5 {
                0.75 - r * r
            } else {
                0.5 * (1.5 - r.abs()).max(0.0).powi(2)
            }
        };
        let centre = position.map(|x| (x / dx).round() as i32);
        let mut nodes = Vec::with_capacity(27);
        for i in -1..=1 {
            for j in -1..=1 {
                for k in -1..=1 {
                    let index = [centre[0] + i, centre[1] + j, centre[2] + k];
                    let offset: [f64; 3] =
                        std::array::from_fn(|a| f64::from(index[a]) * dx - position[a]);
                    let weight = offset.iter().map(|r| spline(r / dx)).product();
                    nodes.push((index, weight, offset));
                }
            }
        }
        Self(nodes)
    }
}

impl Grid {
    /// Adds `w m` and `w (m v + A (x_i - x_p))` to every node of the stencil, `A` the affine momentum matrix.
    pub fn scatter(&mut self, stencil: &Stencil, mass: f64, v: [f64; 3], affine: &Mat3<f64>) {
        for &(index, w, offset) in &stencil.0 {
            let node = self.nodes.entry(index).or_default();
            let spin = affine.mul_vec(offset);
            node.mass += w * mass;
            for a in 0..3 {
                node.momentum[a] += w * (mass * v[a] + spin[a]);
            }
        }
    }

    /// `v = sum w v_i` and `C = 4 / dx^2 sum w v_i (x_i - x_p)^T`.
    pub fn gather(&self, stencil: &Stencil, dx: f64) -> ([f64; 3], Mat3<f64>) {
        let mut v = [0.0; 3];
        let mut c = [[0.0; 3]; 3];
        for &(index, w, offset) in &stencil.0 {
            let node = &self.nodes[&index];
            for a in 0..3 {
                v[a] += w * node.velocity[a];
                for b in 0..3 {
                    c[a][b] += 4.0 / (dx * dx) * w * node.velocity[a] * offset[b];
                }
            }
        }
        (v, Mat3(c))
    }
}
