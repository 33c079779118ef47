//! Random deformations and simple paths for the tests of the laws.

use super::{Coefficients, Law, Material, Trial};
use crate::{
    mat3::Mat3,
    num::{Real, random},
};

/// The law's numbers at Young's modulus `e` and Poisson's ratio `nu`.
pub fn prepared(law: Law, e: f64, nu: f64) -> Coefficients<f64> {
    Coefficients::new(&Material {
        name: "tested".into(),
        law,
        youngs_modulus: e,
        poisson_ratio: nu,
        density: 1000.0,
        loss: 0.0,
    })
}

/// A trial state without a velocity gradient.
pub fn trial<R: Real>(f: &Mat3<R>, memory: f64, dt: f64) -> Trial<R> {
    Trial {
        f: *f,
        memory: R::splat(memory),
        gradient: Mat3([[R::splat(0.0); 3]; 3]),
        dt: R::splat(dt),
    }
}

/// Stretch by `exp(strain)` along x at constant volume.
pub fn extension(strain: f64) -> Mat3<f64> {
    let across = (-0.5 * strain).exp();
    Mat3::diagonal([strain.exp(), across, across])
}

/// `|dev tau|` and the mean of `tau`.
pub fn stress_invariants(tau: &[f64; 6]) -> (f64, f64) {
    let mean = (tau[0] + tau[3] + tau[5]) / 3.0;
    let diagonal = [tau[0], tau[3], tau[5]].map(|t| (t - mean) * (t - mean));
    let off = [tau[1], tau[2], tau[4]].map(|t| 2.0 * t * t);
    let squared: f64 = diagonal.iter().chain(&off).sum();
    (squared.sqrt(), mean)
}

/// Equivalent stress of von Mises, `sqrt(3/2) |dev tau|`.
pub fn equivalent_stress(tau: &[f64; 6]) -> f64 {
    1.5_f64.sqrt() * stress_invariants(tau).0
}

/// Seeded source of random matrices.
pub struct Random(u64);

impl Random {
    /// A source of its own for every seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number in `low..=high`, each as likely.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * 0.5 * (random(&mut self.0) + 1.0)
    }

    /// A rotation, each as likely.
    pub fn rotation(&mut self) -> Mat3<f64> {
        loop {
            let q: [f64; 4] = std::array::from_fn(|_| self.uniform(-1.0, 1.0));
            let n = q.iter().map(|c| c * c).sum::<f64>();
            if !(0.01..=1.0).contains(&n) {
                continue;
            }
            return Mat3::from_quaternion(q.map(|c| c / n.sqrt()));
        }
    }

    /// `F = U diag(s) V^T` with stretches in `low..high`, and its exact rotation `U V^T`.
    pub fn deformation(&mut self, low: f64, high: f64, inverted: bool) -> (Mat3<f64>, Mat3<f64>) {
        let (u, v) = (self.rotation(), self.rotation());
        let mut s: [f64; 3] = std::array::from_fn(|_| self.uniform(low, high));
        if inverted {
            s.sort_by(f64::total_cmp);
            // Where the two smallest stretches meet, the nearest rotation is not unique.
            s[0] = -s[0].min(0.8 * s[1]);
        }
        let f = u.mul(&Mat3::diagonal(s)).mul_transposed(&v);
        (f, u.mul_transposed(&v))
    }
}
