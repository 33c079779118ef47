//! Fixed corotated elasticity (Stomakhin, Howes, Schroeder, Teran 2012, eq. 8).

use super::polar::rotation;
use crate::{
    mat3::{Mat3, Sym3, dot},
    num::Real,
};

/// Kirchhoff stress `tau = P F^T = 2 mu (F - R) F^T + lambda (J - 1) J I` [Pa].
///
/// `f` is the deformation gradient, `lambda` and `mu` the Lamé parameters [Pa]. Finite for every finite `F`,
/// inverted ones included.
#[inline(always)]
pub fn kirchhoff_stress<R: Real>(f: &Mat3<R>, lambda: R, mu: R) -> Sym3<R> {
    stress_about(f, &rotation(f), f.det(), lambda, mu)
}

/// The same with the rotation `r` of `f` and `j = det f` at hand.
#[inline(always)]
pub(super) fn stress_about<R: Real>(f: &Mat3<R>, r: &Mat3<R>, j: R, lambda: R, mu: R) -> Sym3<R> {
    let pressure = lambda * (j - R::splat(1.0)) * j;
    let two_mu = mu + mu;
    let s = f.sub(r).mul_transposed_sym(f);
    [
        s[0].mul_add(two_mu, pressure),
        s[1] * two_mu,
        s[2] * two_mu,
        s[3].mul_add(two_mu, pressure),
        s[4] * two_mu,
        s[5].mul_add(two_mu, pressure),
    ]
}

/// Energy per rest volume `psi = mu |F - R|^2 + lambda / 2 (J - 1)^2` [J/m^3], by way of
/// `|F - R|^2 = |F|^2 - 2 tr S + 3` with the stretch `S` of `F = R S`.
///
/// Meant for double precision: the difference cancels near rest.
#[inline(always)]
pub fn energy_density<R: Real>(f: &Mat3<R>, lambda: R, mu: R) -> R {
    let volumetric = f.det() - R::splat(1.0);
    let stretch = f.norm_squared() - R::splat(2.0) * stretch_trace(f) + R::splat(3.0);
    mu.mul_add(stretch, lambda * R::splat(0.5) * volumetric * volumetric)
}

/// Newton steps at most: some near rest, and one more per halving of the error where two stretches vanish.
const TRACE_STEPS: usize = 40;

/// `tr S = s_1 + s_2 + s_3`, the smallest stretch with the sign of `J`: largest root `x` of
/// `(x^2 - |F|^2)^2 = 4 |cof F|^2 + 8 J x` (Franca 1989), approached from the bound `sqrt(3) |F|`, beyond which
/// the quartic is convex. A third of the cost of `R` itself.
#[inline(always)]
fn stretch_trace<R: Real>(f: &Mat3<R>) -> R {
    let cofactor = f.cofactor();
    let j = dot(f.0[0], cofactor.0[0]);
    let squared = f.norm_squared();
    let four = R::splat(4.0);
    let eight_j = R::splat(8.0) * j;
    let area = four * cofactor.norm_squared();
    let mut x = (R::splat(3.0) * squared).sqrt();
    for _ in 0..TRACE_STEPS {
        let e = x.mul_add(x, -squared);
        let value = e.mul_add(e, -eight_j.mul_add(x, area));
        let slope = (four * x).mul_add(e, -eight_j);
        // Zero only where F vanishes, or at a double root that is reached already.
        let defined = R::splat(0.0).lt(slope);
        let step = R::select(defined, value / slope, R::splat(0.0));
        x = x - step;
        // Quadratic convergence: the next step would be below round-off.
        if !R::any((x * R::splat(1e-9)).lt(step)) {
            break;
        }
    }
    x
}
