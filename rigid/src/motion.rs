//! The rigid part of an object's motion.

use crate::mat3::{Mat3, cross};

/// Numbers that sums are made of: mass, `m x`, `m x x^T` (xx xy xz yy yz zz), `m v`, `m x (x) v`.
pub const SUMS: usize = 1 + 3 + 6 + 3 + 3;
/// Order of symmetric matrices.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Motion of an object as a whole, in units of mass and length that its owner chooses, and s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidMotion {
    /// Centre of mass.
    pub com: [f64; 3],
    /// Velocity of the centre of mass.
    pub velocity: [f64; 3],
    /// Angular velocity [1/s].
    pub spin: [f64; 3],
    /// Radius of the ball with the same mean square distance from the centre of mass.
    pub radius: f64,
}

/// Adds a mass point at `x` relative to an origin, with velocity `v`, to [sums](RigidMotion::from_sums).
#[inline(always)]
pub fn add_to_sums(s: &mut [f64; SUMS], mass: f64, x: [f64; 3], v: [f64; 3]) {
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
}

impl RigidMotion {
    /// Of mass points about an origin; none where there is no mass, or no extent to turn.
    pub fn from_sums(s: &[f64; SUMS], origin: [f64; 3]) -> Option<Self> {
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
        Some(Self {
            com: std::array::from_fn(|a| origin[a] + r[a]),
            velocity: momentum.map(|p| p / mass),
            spin: inverse_inertia.mul_vec(angular),
            radius: (5.0 / 3.0 * (xx + yy + zz) / mass).max(0.0).sqrt(),
        })
    }

    /// Velocity of the rigid part at a point.
    pub fn at(&self, x: [f64; 3]) -> [f64; 3] {
        let turn = cross(self.spin, std::array::from_fn(|a| x[a] - self.com[a]));
        std::array::from_fn(|a| self.velocity[a] + turn[a])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_turn_and_fly_have_that_motion() {
        let (v, spin) = ([1.0, -2.0, 0.5], [0.3, 0.2, -0.7]);
        let mut sums = [0.0; SUMS];
        let (mut mass, mut com) = (0.0, [0.0; 3]);
        for n in 0..27 {
            let x = [n / 9, n / 3 % 3, n % 3].map(|k| f64::from(k) - 0.7);
            let m = 1.0 + 0.1 * f64::from(n);
            let turn = cross(spin, x);
            add_to_sums(&mut sums, m, x, std::array::from_fn(|a| v[a] + turn[a]));
            mass += m;
            for a in 0..3 {
                com[a] += m * x[a];
            }
        }
        let origin = [10.0, 20.0, 30.0];
        let motion = RigidMotion::from_sums(&sums, origin).expect("it has extent");
        for a in 0..3 {
            assert!((motion.com[a] - origin[a] - com[a] / mass).abs() < 1e-12);
            assert!((motion.spin[a] - spin[a]).abs() < 1e-12);
            assert!((motion.at(origin)[a] - v[a]).abs() < 1e-12);
        }
    }
}
