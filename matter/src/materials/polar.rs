//! Rotation of the polar decomposition `F = R S`, lane-wise.

use super::svd::svd;
use crate::{
    mat3::{Mat3, dot},
    num::Real,
};

/// Newton steps at most; reaches `f32` round-off for stretches 0.25 to 4.
const STEPS: usize = 5;

/// Largest `|R^T R - I|` (Frobenius) that is accepted from the Newton iteration; `R` is then within
/// half of it.
const RESIDUAL: f64 = 1e-5;

/// Newton steps for stretches within a tenth of 1: the error is `d^2 / 2` after one step, then squares and halves.
const STEPS_NEAR: usize = 4;

/// One step of Newton's iteration, and the determinant of what it started from.
#[inline(always)]
fn step<R: Real>(r: &Mat3<R>) -> (Mat3<R>, R) {
    let half = R::splat(0.5);
    let cofactor = r.cofactor();
    let det = dot(r.0[0], cofactor.0[0]);
    (r.blend(half, &cofactor, half / det), det)
}

/// The rotation nearest to an `f` whose stretches are within a tenth of 1, unchecked.
#[inline(always)]
pub fn nearly_rotation<R: Real>(f: &Mat3<R>) -> Mat3<R> {
    let mut r = *f;
    for _ in 0..STEPS_NEAR {
        (r, _) = step(&r);
    }
    r
}

/// The rotation nearest to `f`, also for inverted `f`.
///
/// Newton iteration `R <- (R + R^-T) / 2` (Higham 1986), the inverse by cofactors, until the step at hand ends at
/// round-off in all lanes. It runs to a reflection where `det f <= 0` and stops short for extreme stretches: when any
/// lane did either, those lanes take `U V^T` of the signed singular value decomposition instead.
#[inline(always)]
pub fn rotation<R: Real>(f: &Mat3<R>) -> Mat3<R> {
    // After the first step no stretch is below 1, so that each is within `d` of it where the determinant is, and the step
    // from there ends within `d^2 / 2`.
    let near = R::splat(1.0 + R::EPSILON.sqrt());
    let mut r = *f;
    for n in 0..STEPS {
        let det;
        (r, det) = step(&r);
        // Written so that NaN, and what turns to a reflection, goes on.
        let done = R::splat(0.5).lt(det) & det.lt(near);
        if n > 0 && !R::any(!done) {
            return r;
        }
    }
    let residual = r.transpose().mul(&r).sub(&Mat3::identity()).norm_squared();
    // Written so that NaN counts as bad.
    let good = R::splat(0.0).lt(f.det()) & residual.lt(R::splat(RESIDUAL * RESIDUAL));
    if R::any(!good) {
        let exact = svd(f);
        return Mat3::select(good, &r, &exact.u.mul_transposed(&exact.v));
    }
    r
}
