//! The rigid part of an object's motion and what it vibrates with, from the nodes of its field.

use std::ops::Range;

use rayon::prelude::*;

use super::sites::read;
use crate::{
    grid::{Grid, Velocities},
    mat3::{Mat3, cross, dot},
    particles::BLOCK,
};

/// Numbers that sums are made of: mass, `m x`, `m x x^T` (xx xy xz yy yz zz), `m v`, `m x (x) v`, `m v^2`.
const SUMS: usize = 1 + 3 + 6 + 3 + 3 + 1;
/// Order of symmetric matrices.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Motion of all matter of one field [mass units, cells, s]; velocities are relative to the frame velocity.
///
/// Momentum and angular momentum of nodes are those of the particles with their affine parts, and the inertia of
/// nodes counts `2 D_p` per mass like theirs, so nothing is approximated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Mass.
    pub mass: f64,
    /// Centre of mass.
    pub com: [f64; 3],
    /// Velocity of the centre of mass.
    pub velocity: [f64; 3],
    /// Angular velocity [1/s].
    pub spin: [f64; 3],
    /// Inverse of the inertia about the centre of mass.
    pub inverse_inertia: Mat3<f64>,
    /// Kinetic energy of everything that is not rigid motion.
    pub vibration: f64,
    /// Radius of the ball with the same mean square distance from the centre of mass [cells].
    pub radius: f64,
}

/// Node blocks of a field.
fn blocks_of(grid: &Grid, field: u32) -> Range<usize> {
    let start = grid.nodes.partition_point(|node| node.field < field);
    start..grid.nodes.partition_point(|node| node.field <= field)
}

/// Position [cells] of the nodes of a block relative to `origin`, with their numbers.
fn places(index: [i32; 3], origin: [i32; 3]) -> impl Iterator<Item = (usize, [f64; 3])> {
    (0..64).map(move |at| {
        let local = super::sites::coordinates(at);
        let x = |a: usize| f64::from(BLOCK * (index[a] - origin[a]) + local[a]);
        (at, [x(0), x(1), x(2)])
    })
}

impl Motion {
    /// Of a field; none where there is no mass, or no extent to turn.
    pub fn of(grid: &Grid, field: u32) -> Option<Self> {
        let range = blocks_of(grid, field);
        let nodes = &grid.nodes[range.clone()];
        let origin = nodes.first()?.index;
        let parts: Vec<[f64; SUMS]> = nodes
            .par_iter()
            .zip(&grid.velocities[range])
            .with_min_len(16)
            .map(|(node, velocities)| sums(node.index, origin, velocities))
            .collect();
        // In the order of blocks: the same for any number of threads.
        let mut total = [0.0; SUMS];
        for part in &parts {
            for (total, part) in total.iter_mut().zip(part) {
                *total += part;
            }
        }
        Self::from_sums(&total, origin)
    }

    fn from_sums(s: &[f64; SUMS], origin: [i32; 3]) -> Option<Self> {
        let mass = s[0];
        if mass.is_nan() || mass <= 0.0 {
            return None;
        }
        let r = [s[1] / mass, s[2] / mass, s[3] / mass];
        let momentum = [s[10], s[11], s[12]];
        let shift = cross(r, momentum);
        let angular: [f64; 3] = std::array::from_fn(|a| s[13 + a] - shift[a]);
        let mut second = [0.0; 6];
        for (n, (i, j)) in PAIRS.into_iter().enumerate() {
            second[n] = s[4 + n] - mass * r[i] * r[j];
        }
        let [xx, xy, xz, yy, yz, zz] = second;
        let inertia = Mat3([
            [yy + zz, -xy, -xz],
            [-xy, xx + zz, -yz],
            [-xz, -yz, xx + yy],
        ]);
        let det = inertia.det();
        if det.is_nan() || det <= 0.0 {
            return None;
        }
        // The inverse of a symmetric matrix is its cofactor matrix over its determinant.
        let inverse_inertia = Mat3(inertia.cofactor().0.map(|row| row.map(|c| c / det)));
        let velocity = momentum.map(|p| p / mass);
        let spin = inverse_inertia.mul_vec(angular);
        let rigid = 0.5 * (dot(velocity, momentum) + dot(spin, angular));
        Some(Self {
            mass,
            com: std::array::from_fn(|a| f64::from(BLOCK * origin[a]) + r[a]),
            velocity,
            spin,
            inverse_inertia,
            vibration: (0.5 * s[16] - rigid).max(0.0),
            radius: (5.0 / 3.0 * (xx + yy + zz) / mass).max(0.0).sqrt(),
        })
    }

    /// Velocity of the rigid part at a point [cells/s].
    pub fn at(&self, x: [f64; 3]) -> [f64; 3] {
        let turn = cross(self.spin, self.arm(x));
        std::array::from_fn(|a| self.velocity[a] + turn[a])
    }

    fn arm(&self, x: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| x[a] - self.com[a])
    }

    /// Change of velocity along `normal` at a point, per impulse along `normal` there.
    pub fn inverse_effective_mass(&self, x: [f64; 3], normal: [f64; 3]) -> f64 {
        let turn = cross(self.arm(x), normal);
        1.0 / self.mass + dot(turn, self.inverse_inertia.mul_vec(turn))
    }

    /// Gives a field an impulse at a point that moves it as a rigid body, and scales what it vibrates with by
    /// `keep`. Momentum and angular momentum change by what the impulse brings. Returns the largest velocity
    /// component given, as bits.
    pub fn push(
        &self,
        grid: &mut Grid,
        field: u32,
        x: [f64; 3],
        impulse: [f64; 3],
        keep: f64,
    ) -> u32 {
        let turn = self.inverse_inertia.mul_vec(cross(self.arm(x), impulse));
        let range = blocks_of(grid, field);
        let nodes = &grid.nodes[range.clone()];
        nodes
            .par_iter()
            .zip(&mut grid.velocities[range])
            .with_min_len(16)
            .map(|(node, velocities)| {
                let mut largest = 0;
                for (at, y) in places(node.index, [0; 3]) {
                    let (v, mass) = read(velocities, at);
                    if mass <= 0.0 {
                        continue;
                    }
                    let (rigid, more) = (self.at(y), cross(turn, self.arm(y)));
                    let to = &mut velocities.0[at / 4].0[4 * (at % 4)..][..3];
                    for a in 0..3 {
                        let own = keep * (v[a] - rigid[a]);
                        to[a] = (rigid[a] + own + impulse[a] / self.mass + more[a]) as f32;
                        largest = largest.max(to[a].abs().to_bits());
                    }
                }
                largest
            })
            .reduce(|| 0, u32::max)
    }
}

/// Sums over the nodes of a block, positions relative to `origin`.
fn sums(index: [i32; 3], origin: [i32; 3], velocities: &Velocities) -> [f64; SUMS] {
    let mut s = [0.0; SUMS];
    for (at, x) in places(index, origin) {
        let (v, mass) = read(velocities, at);
        if mass <= 0.0 {
            continue;
        }
        let moment = cross(x, v);
        s[0] += mass;
        for (n, (i, j)) in PAIRS.into_iter().enumerate() {
            s[4 + n] += mass * x[i] * x[j];
        }
        for a in 0..3 {
            s[1 + a] += mass * x[a];
            s[10 + a] += mass * v[a];
            s[13 + a] += mass * moment[a];
        }
        s[16] += mass * dot(v, v);
    }
    s
}
