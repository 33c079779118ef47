//! Plasticine, clay: Hencky elasticity with von Mises yield that softens with plastic strain, then damage.
//!
//! The yield stress is `yield_stress - softening alpha`, `alpha` the equivalent plastic strain and the law's memory;
//! PhysGaussian (Xie et al. 2024) softens the same way and, when no strength is left, sets both moduli to 0. Here
//! the step is smooth and one-sided: from `alpha_0 = yield_stress / softening`, where the last shear strength has
//! gone, to `2 alpha_0` the stress in tension falls to 0, while crumbs keep their resistance to compression and so
//! their volume. Crumbs that part remember a gain in volume up to [`GAIN_MAX`].

use super::{
    Coefficients,
    strain::{Flow, Strain, bulk_modulus},
    von_mises,
};
use crate::num::Real;

/// Largest `tr eps` of damaged matter.
pub const GAIN_MAX: f64 = 1.0;

/// Steepest softening as a share of `3 mu`, from which on the way down is faster than the elastic one.
pub const SOFTENING_MAX: f64 = 0.9;

/// As for metal, and `softening / yield_stress`.
pub(super) fn parameters(yield_stress: f64, softening: f64, mu: f64) -> [f64; 4] {
    let slope = softening.min(SOFTENING_MAX * 3.0 * mu);
    let mut parameters = von_mises::parameters(yield_stress, -slope, mu);
    parameters[3] = if softening > 0.0 {
        (softening / yield_stress.max(1e-30)).min(1e30)
    } else {
        0.0
    };
    parameters
}

/// How far damage has gone: 0 none, 1 no strength in tension.
#[inline(always)]
fn damage<R: Real>(alpha: R, k: &Coefficients<R>) -> R {
    let zero = R::splat(0.0);
    let one = R::splat(1.0);
    (alpha * k.parameters[3] - one).max(zero).min(one)
}

/// Mean Kirchhoff stress [Pa] at `tr eps` and equivalent plastic strain `alpha`.
#[inline(always)]
pub(super) fn mean_stress<R: Real>(trace: R, alpha: R, k: &Coefficients<R>) -> R {
    let left = R::splat(1.0) - damage(alpha, k);
    let elastic = bulk_modulus(k) * trace;
    R::select(R::splat(0.0).lt(trace), elastic * left * left, elastic)
}

/// The flow of plasticine.
#[inline(always)]
pub(super) fn flow<R: Real>(strain: &Strain<R>, k: &Coefficients<R>) -> Flow<R> {
    let gain = R::splat(GAIN_MAX);
    let flow = von_mises::radial_return(strain, k);
    let parts = R::splat(0.0).lt(damage(flow.memory, k)) & gain.lt(strain.trace);
    let trace = R::select(parts, gain, strain.trace);
    Flow {
        trace,
        mean: mean_stress(trace, flow.memory, k),
        flows: flow.flows | parts,
        ..flow
    }
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

    const PLASTICINE: Law = Law::Plasticine {
        yield_stress: 1e4,
        softening: 5e4,
    };

    #[test]
    fn strength_falls_along_its_line_and_ends_at_nothing() {
        let k = prepared(PLASTICINE, 1e6, 0.3);
        let (mut f, mut memory) = (Mat3::identity(), 0.0);
        for step in 1..=400 {
            let response = PLASTICINE.respond(&trial(&extension(1e-3).mul(&f), memory, 1e-4), &k);
            (f, memory) = (response.f, response.memory);
            let total = 1e-3 * f64::from(step);
            let three_mu = 3.0 * k.mu;
            let soft = (three_mu * total - 1e4) / (three_mu - 5e4);
            // Elastic, then along the line, then no strength: all strain is plastic.
            let alpha = if soft < 0.0 {
                0.0
            } else {
                soft.min(total.max(0.2))
            };
            let alpha = if soft > 0.2 { total } else { alpha };
            let stress = (three_mu * (total - alpha)).max(0.0);
            let found = equivalent_stress(&response.tau);
            assert!((memory - alpha).abs() < 1e-11, "{total}: {memory} {alpha}");
            assert!(
                (found - stress).abs() < 1e-11 * three_mu,
                "{total}: {found} {stress}"
            );
        }
    }

    #[test]
    fn damaged_crumbs_resist_compression_but_not_tension() {
        let k = prepared(PLASTICINE, 1e6, 0.3);
        let bulk = k.lambda + 2.0 / 3.0 * k.mu;
        let mean = |stretch: f64, memory: f64| {
            let f = Mat3::diagonal([stretch; 3]);
            PLASTICINE.respond(&trial(&f, memory, 1e-4), &k).tau[0] / (3.0 * stretch.ln())
        };
        // Strength ends at a plastic strain of 0.2; damage runs from there to 0.4.
        for (memory, share) in [(0.0, 1.0), (0.2, 1.0), (0.3, 0.25), (0.4, 0.0), (5.0, 0.0)] {
            let (tension, compression) = (mean(1.01, memory), mean(0.99, memory));
            assert!(
                (tension - share * bulk).abs() < 1e-9 * bulk,
                "{memory}: {tension}"
            );
            assert!(
                (compression / bulk - 1.0).abs() < 1e-9,
                "{memory}: {compression}"
            );
        }
    }
}
