//! Short names for what is done to 3-vectors and rotations in `f64`.

pub use crate::mat3::length;

use crate::mat3::Mat3;

/// A vector.
pub type Vec3 = [f64; 3];

/// `a + b`.
#[inline]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline]
pub fn scaled(a: Vec3, s: f64) -> Vec3 {
    a.map(|x| s * x)
}

/// `a + s b`.
#[inline]
pub fn along(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// `a` over its length, or `or` where it has none.
#[inline]
pub fn unit(a: Vec3, or: Vec3) -> Vec3 {
    let size = length(a);
    if size > 0.0 {
        scaled(a, 1.0 / size)
    } else {
        or
    }
}

/// Solves `m x = b` by Cramer's rule; zero where `m` is singular.
#[inline]
pub fn solve(m: &Mat3<f64>, b: Vec3) -> Vec3 {
    let x = scaled(m.cofactor().transpose().mul_vec(b), 1.0 / m.det());
    if x.iter().all(|x| x.is_finite()) {
        x
    } else {
        [0.0; 3]
    }
}
