//! Snow: fixed corotated elasticity whose stretches are clamped, with hardening and softening (Stomakhin et al.
//! 2013, ACM Trans. Graph. 32, 102).
//!
//! Principal elastic stretches stay within `1 - critical_compression` and `1 + critical_stretch`; what goes beyond
//! becomes plastic. Both moduli are multiplied by `exp(hardening (1 - J_p))`, `J_p` the plastic volume ratio:
//! compressed snow gets stiffer, stretched snow softer, between the factors 1/32 and 32. Memory is `J_p - 1`.

use super::{
    Coefficients, Response, Trial, fixed_corotated, limits::max_stretch_squared_of,
    polar::nearly_rotation, svd::svd,
};
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Largest factor on the moduli; its reciprocal is the smallest. Compacted to ice, `J_p` near 0.4, the formula asks
/// for 400, and for nothing when torn: neither is snow any more.
pub const FACTOR_MAX: f64 = 32.0;

/// Range of the plastic volume ratio: from ice to a cloud.
pub const PLASTIC_VOLUME: [f64; 2] = [0.1, 10.0];

/// Principal stretches below this, inverted ones among them, count as this when plastic volume is booked.
const STRETCH_MIN: f64 = 0.05;

/// `[critical compression, critical stretch, hardening, 0]`.
pub(super) fn parameters(compression: f64, stretch: f64, hardening: f64) -> [f64; 4] {
    [compression, stretch, hardening, 0.0]
}

/// Factor on the moduli.
#[inline(always)]
pub(super) fn stiffness<R: Real>(memory: R, k: &Coefficients<R>) -> R {
    let end = R::splat(FACTOR_MAX.ln());
    (-(memory * k.parameters[2])).min(end).max(-end).exp()
}

/// Return mapping and stress. Lanes whose stretches are within the limits for certain need no eigenvectors.
#[inline(always)]
pub fn respond<R: Real>(trial: &Trial<R>, k: &Coefficients<R>) -> Response<R> {
    let one = R::splat(1.0);
    let [compression, stretch, ..] = k.parameters;
    let (low, high) = (one - compression, one + stretch);
    let b = trial.f.mul_transposed_sym(&trial.f);
    // Eigenvalues of b, the squared stretches, are within sqrt(2/3) |dev b| of their mean.
    let mean = (b[0] + (b[3] + b[5])) * R::splat(1.0 / 3.0);
    let spread = max_stretch_squared_of(&b) - mean;
    let j = trial.f.det();
    let within =
        (mean + spread).lt(high * high) & (low * low).lt(mean - spread) & R::splat(0.0).lt(j);
    let factor = stiffness(trial.memory, k);
    let r = nearly_rotation(&trial.f);
    let (lambda, mu) = (k.lambda * factor, k.mu * factor);
    let mut response = Response {
        f: trial.f,
        memory: trial.memory,
        tau: fixed_corotated::stress_about(&trial.f, &r, j, lambda, mu),
        stretch_squared: mean + spread,
        j,
        stiffness: factor,
    };
    // Written so that NaN counts as outside.
    if R::any(!within) {
        response = Response::select(within, &response, &respond_by_svd(trial, k));
    }
    response
}

/// As [`respond`], by principal stretches: any deformation.
#[inline(always)]
pub fn respond_by_svd<R: Real>(trial: &Trial<R>, k: &Coefficients<R>) -> Response<R> {
    let one = R::splat(1.0);
    let floor = R::splat(STRETCH_MIN);
    let [compression, stretch, ..] = k.parameters;
    let (low, high) = (one - compression, one + stretch);
    let d = svd(&trial.f);
    let mut sigma = d.sigma;
    let mut yields = one.lt(one);
    let mut ratio = one;
    for n in 0..3 {
        let s = d.sigma[n];
        let (below, above) = (s.lt(low), high.lt(s));
        sigma[n] = R::select(below, low, R::select(above, high, s));
        yields = yields | below | above;
        ratio = ratio * (R::select(s.lt(floor), floor, s) / sigma[n]);
    }
    let [least, most] = PLASTIC_VOLUME;
    let volume = trial.memory.mul_add(ratio, ratio) - one;
    let volume = volume.max(R::splat(least - 1.0)).min(R::splat(most - 1.0));
    let memory = R::select(yields, volume, trial.memory);
    let factor = stiffness(memory, k);
    let (lambda, mu) = (k.lambda * factor, k.mu * factor);
    let j = sigma[0] * sigma[1] * sigma[2];
    let pressure = lambda * (j - one) * j;
    let mut tau = sigma;
    for n in 0..3 {
        tau[n] = (mu + mu).mul_add((sigma[n] - one) * sigma[n], pressure);
    }
    let mapped = d.u.mul(&Mat3::diagonal(sigma)).mul_transposed(&d.v);
    let tau: Sym3<R> = d.u.mul(&Mat3::diagonal(tau)).mul_transposed_sym(&d.u);
    Response {
        f: Mat3::select(yields, &mapped, &trial.f),
        memory,
        tau,
        stretch_squared: sigma[0] * sigma[0],
        j,
        stiffness: factor,
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        mat3::Mat3,
        materials::{
            Law,
            testing::{Random, prepared, trial},
        },
    };

    const SNOW: Law = Law::Snow {
        critical_compression: 0.025,
        critical_stretch: 0.0075,
        hardening: 10.0,
    };

    /// Stress along x after stretching by `total` in `steps` equal steps, from a closed form and from the law.
    fn stretched(total: f64, steps: i32) -> (f64, f64) {
        let k = prepared(SNOW, 1.4e5, 0.2);
        let step = Mat3::diagonal([total.powf(1.0 / f64::from(steps)), 1.0, 1.0]);
        let (mut f, mut memory, mut tau) = (Mat3::identity(), 0.0, [0.0; 6]);
        for _ in 0..steps {
            let response = SNOW.respond(&trial(&step.mul(&f), memory, 1e-4), &k);
            (f, memory, tau) = (response.f, response.memory, response.tau);
        }
        let elastic = total.clamp(0.975, 1.0075);
        let plastic = total / elastic;
        let factor = (10.0 * (1.0 - plastic)).exp();
        let slope = 2.0 * k.mu + k.lambda;
        assert!(
            (memory - (plastic - 1.0)).abs() < 1e-11,
            "{memory} {plastic}"
        );
        (factor * slope * (elastic - 1.0) * elastic, tau[0])
    }

    #[test]
    fn compression_hardens_and_stretching_softens_exponentially() {
        for total in [0.98, 0.95, 0.8, 0.7, 1.005, 1.05, 1.3] {
            for steps in [1, 10, 300] {
                let (expected, found) = stretched(total, steps);
                assert!(
                    (found / expected - 1.0).abs() < 1e-8,
                    "{total}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn stiffness_stays_between_its_limits() {
        let k = prepared(SNOW, 1.4e5, 0.2);
        let at = |memory| {
            SNOW.respond(&trial(&Mat3::identity(), memory, 0.0), &k)
                .stiffness
        };
        assert!((at(-0.9) - 32.0).abs() < 1e-12 && (at(5.0) - 1.0 / 32.0).abs() < 1e-12);
        assert!((at(-0.1) - 1.0_f64.exp()).abs() < 1e-12);
    }

    #[test]
    fn stress_within_the_limits_is_the_derivative_of_energy() {
        let k = prepared(SNOW, 1.4e5, 0.2);
        let mut random = Random::new(41);
        for _ in 0..200 {
            let (f, _) = random.deformation(0.985, 1.004, false);
            let c = Mat3(std::array::from_fn(|_| {
                std::array::from_fn(|_| random.uniform(-1.0, 1.0))
            }));
            let memory = -0.05;
            let psi = |h: f64| {
                let moved = Mat3::identity().blend(1.0, &c, h).mul(&f);
                SNOW.energy_density(&moved, memory, &k)
            };
            // Fourth order; the energy near rest cancels to 1e-16 of mu.
            let h = 1e-4;
            let slope = (8.0 * (psi(h) - psi(-h)) - (psi(2.0 * h) - psi(-2.0 * h))) / (12.0 * h);
            let t = SNOW.respond(&trial(&f, memory, 0.0), &k).tau;
            let t = Mat3([[t[0], t[1], t[2]], [t[1], t[3], t[4]], [t[2], t[4], t[5]]]);
            let power: f64 = (0..9).map(|n| t.0[n / 3][n % 3] * c.0[n / 3][n % 3]).sum();
            assert!((slope - power).abs() < 1e-9 * k.mu, "{slope} {power}");
        }
    }
}
