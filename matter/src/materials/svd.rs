//! Singular value decomposition of 3x3 matrices, lane-wise and branch-free.

use crate::{
    mat3::{Mat3, cross, dot, select3},
    num::Real,
};

/// Sweeps over the three column pairs. The 4 often used leave errors near 1e-3 for some `F`; 6 reach `f32`
/// round-off for stretches 0.01 to 5.
const SWEEPS: usize = 6;

/// `matrix = u diag(sigma) v^T` with `u` and `v` rotations.
#[derive(Clone, Copy, Debug)]
pub struct Svd<R> {
    /// Left rotation.
    pub u: Mat3<R>,
    /// `sigma[0] >= sigma[1] >= |sigma[2]|`; the last carries the sign of the determinant.
    pub sigma: [R; 3],
    /// Right rotation.
    pub v: Mat3<R>,
}

/// One-sided Jacobi (Hestenes 1958): rotates pairs of columns until they are orthogonal. Unlike an
/// eigen-decomposition of `F^T F` it never squares the condition number, so small values keep their digits.
#[inline(always)]
pub fn svd<R: Real>(matrix: &Mat3<R>) -> Svd<R> {
    let mut b = [matrix.column(0), matrix.column(1), matrix.column(2)];
    let identity = Mat3::<R>::identity();
    let mut v = identity.0;
    for _ in 0..SWEEPS {
        orthogonalise(&mut b, &mut v, 0, 1);
        orthogonalise(&mut b, &mut v, 0, 2);
        orthogonalise(&mut b, &mut v, 1, 2);
    }
    order(&mut b, &mut v, 0, 1);
    order(&mut b, &mut v, 0, 2);
    order(&mut b, &mut v, 1, 2);

    let sigma0 = dot(b[0], b[0]).sqrt();
    let u0 = normalised_or(b[0], identity.0[0], R::splat(0.0));
    // Remove what round-off left of u0, so that u is orthonormal even when b[1] is tiny.
    let b1 = along(b[1], -dot(u0, b[1]), u0);
    // Below this share of the largest value the direction of a column is noise.
    let u1 = normalised_or(b1, perpendicular(u0), sigma0 * R::splat(1e-6));
    let u2 = cross(u0, u1);
    Svd {
        u: Mat3::from_columns(u0, u1, u2),
        sigma: [sigma0, dot(u1, b[1]), dot(u2, b[2])],
        v: Mat3::from_columns(v[0], v[1], v[2]),
    }
}

/// `a + b * s`.
#[inline(always)]
fn along<R: Real>(a: [R; 3], s: R, b: [R; 3]) -> [R; 3] {
    [
        b[0].mul_add(s, a[0]),
        b[1].mul_add(s, a[1]),
        b[2].mul_add(s, a[2]),
    ]
}

#[inline(always)]
fn scaled<R: Real>(a: [R; 3], s: R) -> [R; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// `a / |a|`, or the unit vector `fallback` in lanes where `|a| <= smallest`.
#[inline(always)]
fn normalised_or<R: Real>(a: [R; 3], fallback: [R; 3], smallest: R) -> [R; 3] {
    let length = dot(a, a).sqrt();
    let usable = smallest.lt(length);
    let divisor = R::select(usable, length, R::splat(1.0));
    select3::<R>(usable, scaled(a, R::splat(1.0) / divisor), fallback)
}

/// A unit vector at right angles to the unit vector `a`.
#[inline(always)]
fn perpendicular<R: Real>(a: [R; 3]) -> [R; 3] {
    let [x, y, _] = Mat3::<R>::identity().0;
    // At most one component of a unit vector exceeds 0.8.
    let axis = select3::<R>(a[0].abs().lt(R::splat(0.8)), x, y);
    let p = along(axis, -dot(axis, a), a);
    scaled(p, R::splat(1.0) / dot(p, p).sqrt())
}

/// Rotates columns `p` and `q` of `b`, and of `v` with them, so that those of `b` become orthogonal.
#[inline(always)]
fn orthogonalise<R: Real>(b: &mut [[R; 3]; 3], v: &mut [[R; 3]; 3], p: usize, q: usize) {
    let zero = R::splat(0.0);
    let one = R::splat(1.0);
    let gamma = dot(b[p], b[q]);
    let difference = (dot(b[q], b[q]) - dot(b[p], b[p])) * R::splat(0.5);
    // tan of the smaller angle: gamma / (difference +- hypot(difference, gamma)), no division by gamma.
    let root = difference.mul_add(difference, gamma * gamma).sqrt();
    let denominator = difference.abs() + root;
    let usable = zero.lt(denominator);
    let t = gamma / R::select(usable, denominator, one);
    let t = R::select(usable, t, zero);
    let t = R::select(difference.lt(zero), -t, t);
    let c = one / t.mul_add(t, one).sqrt();
    let s = c * t;
    for m in [b, v] {
        let (x, y) = (m[p], m[q]);
        m[p] = along(scaled(x, c), -s, y);
        m[q] = along(scaled(y, c), s, x);
    }
}

/// Swaps columns `p` and `q` where the second is longer, with one sign change so that `v` stays a rotation.
#[inline(always)]
fn order<R: Real>(b: &mut [[R; 3]; 3], v: &mut [[R; 3]; 3], p: usize, q: usize) {
    let swap = dot(b[p], b[p]).lt(dot(b[q], b[q]));
    for m in [b, v] {
        let (x, y) = (m[p], m[q]);
        m[p] = select3::<R>(swap, y, x);
        m[q] = select3::<R>(swap, scaled(x, R::splat(-1.0)), y);
    }
}
