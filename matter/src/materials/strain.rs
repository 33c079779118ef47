//! Hencky strain as flow rules see it, two scalars, and what they make of it.

use super::Coefficients;
use crate::num::Real;

/// Smallest principal stretch whose logarithm is taken. Smaller and negative ones (an inverted element) are set
/// to it, in the stored state as well: the way back starts from there.
pub const STRETCH_MIN: f64 = 0.05;

/// A strain as flow rules see it.
#[derive(Clone, Copy, Debug)]
pub struct Strain<R> {
    /// `tr eps`.
    pub trace: R,
    /// `|dev eps|` (Frobenius).
    pub deviator: R,
    /// The law's own number before the flow.
    pub memory: R,
    /// Length of the substep [s].
    pub dt: R,
}

impl<R: Real> Strain<R> {
    /// Of principal strains, with their deviators; the law's own number and the length of the substep [s].
    #[inline(always)]
    pub fn of_principal(eps: [R; 3], memory: R, dt: R) -> (Self, [R; 3]) {
        let trace = eps[0] + (eps[1] + eps[2]);
        let mean = trace * R::splat(1.0 / 3.0);
        let dev = [eps[0] - mean, eps[1] - mean, eps[2] - mean];
        let strain = Self {
            trace,
            deviator: crate::mat3::dot(dev, dev).sqrt(),
            memory,
            dt,
        };
        (strain, dev)
    }
}

/// What a flow rule makes of a strain.
#[derive(Clone, Copy, Debug)]
pub struct Flow<R: Real> {
    /// `tr eps` after the flow.
    pub trace: R,
    /// `|dev eps|` after the flow.
    pub deviator: R,
    /// The law's own number after the flow.
    pub memory: R,
    /// Mean Kirchhoff stress `tr(tau) / 3` [Pa].
    pub mean: R,
    /// Lanes whose strain has changed.
    pub flows: R::Mask,
}

/// `K = lambda + 2 mu / 3` [Pa].
#[inline(always)]
pub fn bulk_modulus<R: Real>(k: &Coefficients<R>) -> R {
    k.mu.mul_add(R::splat(2.0 / 3.0), k.lambda)
}
