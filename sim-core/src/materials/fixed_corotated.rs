//! Fixed corotated elasticity (Stomakhin, Howes, Schroeder, Teran 2012, eq. 8).

use super::polar::rotation;
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Kirchhoff stress `tau = P F^T = 2 mu (F - R) F^T + lambda (J - 1) J I` [Pa].
///
/// `f` is the deformation gradient, `lambda` and `mu` the Lamé parameters [Pa]. Finite for every finite `F`,
/// inverted ones included.
#[inline(always)]
pub fn kirchhoff_stress<R: Real>(f: &Mat3<R>, lambda: R, mu: R) -> Sym3<R> {
    let j = f.det();
    let pressure = lambda * (j - R::splat(1.0)) * j;
    let two_mu = mu + mu;
    let s = f.sub(&rotation(f)).mul_transposed_sym(f);
    [
        s[0].mul_add(two_mu, pressure),
        s[1] * two_mu,
        s[2] * two_mu,
        s[3].mul_add(two_mu, pressure),
        s[4] * two_mu,
        s[5].mul_add(two_mu, pressure),
    ]
}

/// Energy per rest volume `psi = mu |F - R|^2 + lambda / 2 (J - 1)^2` [J/m^3].
#[inline(always)]
pub fn energy_density<R: Real>(f: &Mat3<R>, lambda: R, mu: R) -> R {
    let volumetric = f.det() - R::splat(1.0);
    let stretch = f.sub(&rotation(f)).norm_squared();
    mu.mul_add(stretch, lambda * R::splat(0.5) * volumetric * volumetric)
}
