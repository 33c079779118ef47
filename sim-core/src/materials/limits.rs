//! Largest stable time step of a material in closed form.

use super::{Law, Material, fluid, hencky};
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Bounds on the deformation of a set of particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeformationBounds {
    /// Largest principal stretch, or an upper bound of it.
    pub max_stretch: f64,
    /// Smallest `J = det F`.
    pub min_j: f64,
    /// Largest `J`.
    pub max_j: f64,
    /// Largest factor on Lamé's parameters by hardening.
    pub max_stiffness: f64,
}

impl DeformationBounds {
    /// Undeformed.
    pub const REST: Self = Self {
        max_stretch: 1.0,
        min_j: 1.0,
        max_j: 1.0,
        max_stiffness: 1.0,
    };
}

/// Critical time step [s] of an isolated particle, `dx sqrt(rho0 / M)` with `M` the largest tangent
/// `d tau / d ln(stretch)` that the bounds allow: `M = 3 lambda + 2 mu` at rest.
///
/// An isolated particle is the worst case of MLS-MPM with quadratic splines and symplectic Euler: its affine
/// mode has `omega^2 = 4 M / (rho0 dx^2)` and is stable for `omega dt < 2`. A tangent softer than that at rest
/// is not rewarded: on its way back the particle passes through rest. Plastic flow only softens the tangent.
/// Viscosity `eta` damps the same mode by `8 eta J / (rho0 dx^2)`, stable for `dt < rho0 dx^2 / (4 eta J)`.
/// Infinite for rigid matter, which has no stress.
/// `rho0` is mass per rest volume [kg/m^3], that of `material` is not read; `dx` the cell size [m].
pub fn critical_dt(material: &Material, rho0: f64, dx: f64, bounds: &DeformationBounds) -> f64 {
    let s = bounds.max_stretch.max(1.0);
    let stiffness = bounds.max_stiffness.max(1.0);
    let (lambda, mu) = (stiffness * material.lambda(), stiffness * material.mu());
    let tangent = match material.law {
        Law::Rigid => return f64::INFINITY,
        Law::NeoHookean => 3.0 * lambda + 2.0 * mu * s * s,
        Law::FixedCorotated => {
            // d/d ln(s) of 2 mu (s - 1) s, and of lambda (J - 1) J; inverted elements have s, J < 0.
            let slope = |x: f64| 2.0 * x * x - x;
            let shear = if bounds.min_j < 0.0 {
                slope(-s)
            } else {
                slope(s)
            };
            let bulk = slope(bounds.max_j.max(1.0)).max(slope(bounds.min_j.min(0.0)));
            3.0 * lambda * bulk + 2.0 * mu * shear
        }
        // The clamp of the return mapping keeps stretches near 1, where the slope is 2 s^2 - s.
        Law::Snow { .. } => {
            let slope = |x: f64| 2.0 * x * x - x;
            3.0 * lambda * slope(bounds.max_j.max(1.0)) + 2.0 * mu * slope(s)
        }
        Law::VonMises { .. }
        | Law::DruckerPrager { .. }
        | Law::Foam { .. }
        | Law::Plasticine { .. } => {
            // Shear between axes whose logarithmic stretches differ by x turns them: 2 mu x coth(x).
            let least = (bounds.min_j / (s * s)).max(hencky::STRETCH_MIN);
            let x = (s / least).ln().max(1e-6);
            3.0 * lambda + 2.0 * mu * x / x.tanh()
        }
        Law::Fluid {
            bulk_modulus,
            viscosity,
        } => {
            let stiffest = fluid::tangent(bounds.min_j.clamp(fluid::J_MIN, 1.0));
            let pressure = dx * (rho0 / (3.0 * bulk_modulus * stiffest)).sqrt();
            let largest = bounds.max_j.clamp(1.0, fluid::J_MAX);
            return pressure.min(rho0 * dx * dx / (4.0 * viscosity * largest));
        }
    };
    dx * (rho0 / tangent).sqrt()
}

/// Upper bound of the squared largest principal stretch, from the invariants of `b = F F^T`:
/// `tr(b)/3 + sqrt(2/3) |dev b|`. Exact for uniaxial and equal stretches, at most a third above otherwise.
#[inline(always)]
pub fn max_stretch_squared<R: Real>(f: &Mat3<R>) -> R {
    max_stretch_squared_of(&f.mul_transposed_sym(f))
}

/// The same from `b` itself.
#[inline(always)]
pub(super) fn max_stretch_squared_of<R: Real>(b: &Sym3<R>) -> R {
    let mean = (b[0] + b[3] + b[5]) * R::splat(1.0 / 3.0);
    let d = [b[0] - mean, b[3] - mean, b[5] - mean];
    let off = [b[1], b[2], b[4]];
    let two = R::splat(2.0);
    let squared = crate::mat3::dot(off, off).mul_add(two, crate::mat3::dot(d, d));
    (squared * R::splat(2.0 / 3.0)).sqrt() + mean
}
