//! Shaving foam, paste, mud: Hencky elasticity with Herschel-Bulkley flow, after Yue et al. 2015 (ACM Trans. Graph.
//! 34, 160), who have it on the isochoric `F F^T`.
//!
//! In simple shear `tau = yield_stress / sqrt(3) + viscosity rate^exponent`, as a rheometer measures it;
//! `yield_stress` is that of a tension test, as for metal. The flow of a substep is implicit in its end state:
//! with the excess strain `r` over the yield limit, the share `u` of it that flows solves
//! `u^n = q (1 - u)`, `q = 2 mu dt^n r^(1 - n) / (sqrt(2)^(1 + n) viscosity)`, which is stable for every `dt`.
//! Memory is the equivalent plastic strain.

use super::{
    Coefficients,
    strain::{Flow, Strain, bulk_modulus},
    von_mises::EQUIVALENT,
};
use crate::num::Real;

/// Smallest exponent: the number of Newton steps is made for it.
pub const EXPONENT_MIN: f64 = 0.2;

/// Newton steps for the flow amount; see the test of the residual.
const fn steps(epsilon: f64) -> usize {
    if epsilon > 1e-10 { 6 } else { 8 }
}

/// Less viscosity than this is none [Pa s^n]: with none the equations read `0 / 0` at `dt = 0`.
const VISCOSITY_MIN: f64 = 1e-12;

/// Largest `ln q`; beyond, all of the excess flows anyway.
const LN_Q_MAX: f64 = 20.0;

/// `[yield as |dev eps|, viscosity / mu, ln(q / (dt^n r^(1 - n))), 0]`.
pub(super) fn parameters(yield_stress: f64, viscosity: f64, exponent: f64, mu: f64) -> [f64; 4] {
    let viscosity = viscosity.max(VISCOSITY_MIN);
    let root = 2.0_f64.powf(0.5 * (1.0 + exponent));
    [
        yield_stress * EQUIVALENT / (2.0 * mu),
        (viscosity / mu).max(1e-30),
        (2.0 * mu / (root * viscosity)).ln(),
        0.0,
    ]
}

/// The flow of foam.
#[inline(always)]
pub(super) fn flow<R: Real>(strain: &Strain<R>, k: &Coefficients<R>, exponent: f64) -> Flow<R> {
    let [limit, relaxation, ..] = k.parameters;
    let flows = limit.lt(strain.deviator);
    let zero = R::splat(0.0);
    let excess = R::select(flows, strain.deviator - limit, zero);
    let amount = if exponent == 1.0 {
        excess * (strain.dt / (strain.dt + relaxation))
    } else if R::any(flows) {
        excess * share(excess, strain.dt, k.parameters[2], exponent)
    } else {
        zero
    };
    Flow {
        trace: strain.trace,
        deviator: strain.deviator - amount,
        memory: amount.mul_add(R::splat(EQUIVALENT), strain.memory),
        mean: bulk_modulus(k) * strain.trace,
        flows,
    }
}

/// The root `u` in `0..1` of `u^n = q (1 - u)`. In `w = u^n` the equation `q w^(1/n) + w - q = 0` is convex and
/// rising, and Newton's method comes down from `min(1, q)` without overshooting.
#[inline(always)]
fn share<R: Real>(excess: R, dt: R, ln_q0: R, n: f64) -> R {
    let one = R::splat(1.0);
    let m = R::splat(1.0 / n);
    let m_less_one = R::splat(1.0 / n - 1.0);
    let ln_excess = excess.max(R::splat(1e-30)).ln();
    let ln_q = dt
        .ln()
        .mul_add(R::splat(n), ln_excess.mul_add(R::splat(1.0 - n), ln_q0));
    let q = ln_q.min(R::splat(LN_Q_MAX)).exp();
    let mut w = q.min(one);
    for _ in 0..steps(R::EPSILON) {
        // q w^(1/n - 1)
        let p = q * (w.ln() * m_less_one).exp();
        w = w - (p.mul_add(w, w) - q) / p.mul_add(m, one);
    }
    (w.ln() * m).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        mat3::Mat3,
        materials::{
            Law,
            testing::{equivalent_stress, extension, prepared, trial},
        },
    };

    const MU: f64 = 4e5;

    fn foam(yield_stress: f64, viscosity: f64, exponent: f64) -> (Law, Coefficients<f64>) {
        let law = Law::Foam {
            yield_stress,
            viscosity,
            exponent,
        };
        (law, prepared(law, 1e6, 0.25))
    }

    #[test]
    fn steady_stretching_reaches_the_stress_of_herschel_and_bulkley() {
        for (exponent, rate) in [(1.0, 2.0), (1.0, 50.0), (0.5, 2.0), (0.3, 50.0)] {
            let (law, k) = foam(1e3, 40.0, exponent);
            assert!((k.mu - MU).abs() < 1e-9 * MU);
            let dt = 1e-5;
            let step = extension(rate * dt);
            let (mut f, mut memory, mut stress) = (Mat3::identity(), 0.0, 0.0);
            for _ in 0..40_000 {
                let response = law.respond(&trial(&step.mul(&f), memory, dt), &k);
                (f, memory) = (response.f, response.memory);
                stress = equivalent_stress(&response.tau);
            }
            // Shear rate sqrt(3) and shear stress 1 / sqrt(3) times those of stretching.
            let root = 3.0_f64.sqrt();
            let expected = 1e3 + root * 40.0 * (root * rate).powf(exponent);
            assert!(
                (stress / expected - 1.0).abs() < 1e-9,
                "{stress} {expected}"
            );
            // All strain but the elastic part has become plastic.
            let elastic = stress / (3.0 * MU);
            assert!(
                (memory - (rate * dt * 40_000.0 - elastic)).abs() < 1e-9,
                "{memory}"
            );
        }
    }

    /// For any step.
    #[test]
    fn stress_relaxes_to_the_yield_stress_without_overshoot() {
        for exponent in [1.0, 0.6] {
            for dt in [1e-6, 1e-3, 1.0, 1e3] {
                let (law, k) = foam(1e3, 40.0, exponent);
                let (mut f, mut memory) = (extension(0.02), 0.0);
                let mut last = 3.0 * MU * 0.02;
                for _ in 0..200 {
                    let response = law.respond(&trial(&f, memory, dt), &k);
                    (f, memory) = (response.f, response.memory);
                    let stress = equivalent_stress(&response.tau);
                    assert!(stress <= last * (1.0 + 1e-12) && stress >= 1e3 * (1.0 - 1e-9));
                    last = stress;
                }
                assert!(dt < 1e-3 || last < 1e3 * (1.0 + 1e-3), "dt {dt}: {last}");
            }
        }
    }

    #[test]
    fn newton_finds_the_flow_for_every_exponent_and_viscosity() {
        for n in [0.2, 0.3, 0.5, 0.8, 0.99] {
            for step in -60..=20 {
                let q = f64::from(step).exp();
                let u = share(1.0, 1.0, q.ln(), n);
                assert!((0.0..=1.0).contains(&u), "{u}");
                let residual = u.powf(n) - q * (1.0 - u);
                // Newton's last step, and round-off of the difference where q is large.
                let bound = 1e-8 * q.min(1.0) + 1e-15 * q;
                assert!(residual.abs() < bound, "n {n}, q {q}: {residual}");
                let single = f64::from(share(1.0_f32, 1.0, q.ln() as f32, n));
                assert!(
                    (single - u).abs() < 1e-5 * u + 1e-30,
                    "n {n}, q {q}: {single} {u}"
                );
            }
        }
    }

    #[test]
    fn nothing_flows_in_no_time() {
        assert_eq!(share(0.1, 0.0, 3.0, 0.5), 0.0);
        assert_eq!(share(0.1_f32, 0.0, 3.0, 0.5), 0.0);
    }
}
