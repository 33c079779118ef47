//! Compressible neo-Hookean elasticity with a logarithmic barrier (Bonet & Wood 2008, eq. 6.27-6.29).

use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Smallest volume ratio whose logarithm is taken. The law is undefined at `J <= 0`; below this value the
/// volumetric stress stays at its last finite value, so that a bad substep can be detected and rolled back
/// before it spreads NaN over the grid.
pub const J_MIN: f64 = 1e-6;

/// Kirchhoff stress `tau = mu (F F^T - I) + lambda ln(J) I` [Pa].
///
/// `f` is the deformation gradient, `lambda` and `mu` the Lamé parameters [Pa].
#[inline(always)]
pub fn kirchhoff_stress<R: Real>(f: &Mat3<R>, lambda: R, mu: R) -> Sym3<R> {
    let pressure = lambda.mul_add(f.det().max(R::splat(J_MIN)).ln(), -mu);
    let b = f.mul_transposed_sym(f);
    [
        b[0].mul_add(mu, pressure),
        b[1] * mu,
        b[2] * mu,
        b[3].mul_add(mu, pressure),
        b[4] * mu,
        b[5].mul_add(mu, pressure),
    ]
}

/// Energy per rest volume `psi = mu / 2 (tr(F F^T) - 3) - mu ln(J) + lambda / 2 ln(J)^2` [J/m^3].
#[inline(always)]
pub fn energy_density<R: Real>(f: &Mat3<R>, lambda: R, mu: R) -> R {
    let half = R::splat(0.5);
    let log_j = f.det().max(R::splat(J_MIN)).ln();
    let isochoric = half.mul_add(f.norm_squared() - R::splat(3.0), -log_j);
    mu.mul_add(isochoric, half * lambda * log_j * log_j)
}
