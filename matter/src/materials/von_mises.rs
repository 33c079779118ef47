//! Metal: Hencky elasticity with von Mises yield and linear isotropic hardening.
//!
//! Yield where `|dev tau| > sqrt(2/3) (yield_stress + hardening alpha)`; `alpha` is the equivalent plastic
//! strain, the law's memory, and `yield_stress` what a tension test shows. The radial return of Simo (1992,
//! Comput. Methods Appl. Mech. Eng. 99, 61) is exact for linear hardening: one scalar equation.

use super::{
    Coefficients,
    strain::{Flow, Strain, bulk_modulus},
};
use crate::num::Real;

/// `sqrt(2/3)`: from `|dev|` to the equivalent of a tension test.
pub const EQUIVALENT: f64 = 0.816_496_580_927_726;

/// `[first yield, its growth per alpha, 1 / (1 + H / (3 mu)), 0]`, the first two as `|dev eps|`.
pub(super) fn parameters(yield_stress: f64, hardening: f64, mu: f64) -> [f64; 4] {
    let to_strain = EQUIVALENT / (2.0 * mu);
    [
        yield_stress * to_strain,
        hardening * to_strain,
        1.0 / (1.0 + hardening / (3.0 * mu)),
        0.0,
    ]
}

/// Radial return; a negative slope (softening) ends at no strength at all.
#[inline(always)]
pub(super) fn radial_return<R: Real>(strain: &Strain<R>, k: &Coefficients<R>) -> Flow<R> {
    let zero = R::splat(0.0);
    let [first, slope, share, _] = k.parameters;
    let limit = slope.mul_add(strain.memory, first).max(zero);
    let flows = limit.lt(strain.deviator);
    let excess = R::select(flows, strain.deviator - limit, zero);
    // With softening: the strength may run out on the way, then all of the strain flows.
    let amount = (excess * share).min(strain.deviator);
    Flow {
        trace: strain.trace,
        deviator: strain.deviator - amount,
        memory: amount.mul_add(R::splat(EQUIVALENT), strain.memory),
        mean: bulk_modulus(k) * strain.trace,
        flows,
    }
}

/// The flow of metal.
#[inline(always)]
pub(super) fn flow<R: Real>(strain: &Strain<R>, k: &Coefficients<R>) -> Flow<R> {
    radial_return(strain, k)
}

#[cfg(test)]
mod tests {
    use crate::{
        mat3::Mat3,
        materials::{
            Law,
            testing::{equivalent_stress, extension, prepared, trial},
        },
    };

    #[test]
    fn stretching_follows_the_hardening_line_whatever_the_steps() {
        let (yield_stress, hardening) = (250e6, 2e9);
        let law = Law::VonMises {
            yield_stress,
            hardening,
        };
        let k = prepared(law, 210e9, 0.29);
        for steps in [1, 7, 1_000] {
            let (mut f, mut memory) = (Mat3::identity(), 0.0);
            for step in 1..=steps {
                let strain = 0.05 / f64::from(steps);
                let response = law.respond(&trial(&extension(strain).mul(&f), memory, 1e-6), &k);
                (f, memory) = (response.f, response.memory);
                let total = strain * f64::from(step);
                // 3 mu (total - alpha) = yield_stress + hardening alpha
                let three_mu = 3.0 * k.mu;
                let alpha = ((three_mu * total - yield_stress) / (three_mu + hardening)).max(0.0);
                let stress = three_mu * (total - alpha);
                assert!((memory - alpha).abs() < 1e-12, "{memory} {alpha}");
                // 1e-16 of F times the modulus, a thousand times over.
                let found = equivalent_stress(&response.tau);
                assert!(
                    (found - stress).abs() < 1e-12 * three_mu,
                    "{found} {stress}"
                );
            }
        }
    }

    #[test]
    fn below_yield_metal_is_elastic_to_the_last_bit() {
        let law = Law::VonMises {
            yield_stress: 250e6,
            hardening: 0.0,
        };
        let k = prepared(law, 210e9, 0.29);
        let f = extension(0.9 * 250e6 / (3.0 * k.mu));
        let response = law.respond(&trial(&f, 0.0, 1e-6), &k);
        assert_eq!((response.f, response.memory), (f, 0.0));
        let single = Mat3(f.0.map(|row| row.map(|x| x as f32)));
        let response = law.respond(&trial(&single, 0.0, 1e-6), &k.splat());
        assert_eq!((response.f, response.memory), (single, 0.0));
    }

    #[test]
    fn single_precision_resolves_the_stress_of_steel() {
        let law = Law::VonMises {
            yield_stress: 250e6,
            hardening: 0.0,
        };
        let k = prepared(law, 210e9, 0.29);
        // A millionth of strain, 16 times the spacing of f32 at 1: no digit of it may be lost.
        let strain = f32::EPSILON * 16.0;
        let f = Mat3::diagonal([1.0 + strain, 1.0, 1.0]);
        let tau = law.respond(&trial(&f, 0.0, 0.0), &k.splat::<f32>()).tau;
        let expected = (k.lambda + 2.0 * k.mu) * f64::from(strain).ln_1p();
        assert!(
            (f64::from(tau[0]) / expected - 1.0).abs() < 1e-6,
            "{tau:?} {expected}"
        );
    }
}
