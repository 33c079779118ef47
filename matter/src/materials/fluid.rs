//! Weakly compressible fluid: Tait's equation of state with exponent 7 (Monaghan 1994, J. Comput. Phys. 110, 399)
//! and Newtonian viscosity.
//!
//! Cauchy stress `sigma = -p I + 2 viscosity dev(sym C)`, `p = bulk_modulus / 7 (J^-7 - 1)`, `tau = J sigma`. Only
//! the volume ratio `J` matters; it is the memory, as `J - 1`, and follows `J <- J det(I + dt C)`, the way of the
//! particles themselves: `1 + dt tr C` or its exponential do not see that a vortex widens with every step, and the
//! fluid grows.
//!
//! A fluid with a free surface does not pull: beyond `J = 1` the pressure is 0 and `J` goes on to count the gap, up
//! to [`J_MAX`], so that fluid that comes together again has its volume back when it carries load. What the count is
//! wrong by, after splashes and in vortices, would let a pool sink into itself: `step/volume.rs` corrects it where
//! the grid shows more matter than the count allows.

use super::{Coefficients, Response, Trial};
use crate::{kinematics::volume_growth, num::Real};

/// Exponent of Tait's equation.
const GAMMA: f64 = 7.0;

/// Smallest volume ratio; the pressure there is `2341 bulk_modulus`.
pub const J_MIN: f64 = 0.25;

/// Largest volume ratio.
pub const J_MAX: f64 = 2.0;

/// `[bulk modulus / 7, viscosity, 0, 0]`.
pub(super) fn parameters(bulk_modulus: f64, viscosity: f64) -> [f64; 4] {
    [bulk_modulus / GAMMA, viscosity, 0.0, 0.0]
}

/// Stress and volume of a fluid; `F` passes unread.
#[inline(always)]
pub fn respond<R: Real>(trial: &Trial<R>, k: &Coefficients<R>) -> Response<R> {
    let one = R::splat(1.0);
    let zero = R::splat(0.0);
    let [modulus, viscosity, ..] = k.parameters;
    let c = &trial.gradient.0;
    let rate = c[0][0] + (c[1][1] + c[2][2]);
    let mut way = trial.gradient;
    for i in 0..3 {
        for j in 0..3 {
            way.0[i][j] = trial.dt * c[i][j];
        }
    }
    let growth = volume_growth(&way);
    let memory = (one + trial.memory).mul_add(growth, trial.memory);
    // Selected so that NaN stays NaN.
    let (least, most) = (R::splat(J_MIN - 1.0), R::splat(J_MAX - 1.0));
    let memory = R::select(memory.lt(least), least, memory);
    let memory = R::select(most.lt(memory), most, memory);
    let j = one + memory;
    // J^-6 - J = (1 - J^7) / J^6 = -(J - 1) (1 + J + ... + J^6) / J^6
    let mut sum = one;
    for _ in 0..6 {
        sum = sum.mul_add(j, one);
    }
    let j3 = j * j * j;
    let mean = modulus * memory * sum / (j3 * j3);
    let mean = R::select(zero.lt(memory), zero, mean);
    let eta = viscosity * j;
    let two_eta = eta + eta;
    let mean = two_eta.mul_add(rate * R::splat(-1.0 / 3.0), mean);
    Response {
        f: trial.f,
        memory,
        tau: [
            two_eta.mul_add(c[0][0], mean),
            eta * (c[0][1] + c[1][0]),
            eta * (c[0][2] + c[2][0]),
            two_eta.mul_add(c[1][1], mean),
            eta * (c[1][2] + c[2][1]),
            two_eta.mul_add(c[2][2], mean),
        ],
        stretch_squared: one,
        j,
        stiffness: one,
    }
}

/// Energy of compression per rest volume, `bulk_modulus / 7 ((J^-6 - 1) / 6 + J - 1)` [J/m^3]; 0 beyond `J = 1`.
#[inline(always)]
pub fn energy_density<R: Real>(memory: R, k: &Coefficients<R>) -> R {
    let j = R::splat(1.0) + memory;
    // (J - 1)^2 (6 J^5 + 5 J^4 + ... + 1) / (6 J^6): keeps its digits near rest.
    let mut sum = R::splat(6.0);
    for n in (1..6).rev() {
        sum = sum.mul_add(j, R::splat(f64::from(n)));
    }
    let j3 = j * j * j;
    let energy = k.parameters[0] * memory * memory * sum / (R::splat(6.0) * j3 * j3);
    R::select(R::splat(0.0).lt(memory), R::splat(0.0), energy)
}

/// `d tau / d ln J` of the pressure as a multiple of the bulk modulus: 1 at rest.
pub(super) fn tangent(j: f64) -> f64 {
    ((GAMMA - 1.0) * j.powf(1.0 - GAMMA) + j) / GAMMA
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        mat3::Mat3,
        materials::{
            Law,
            testing::{Random, prepared, trial},
        },
    };

    const WATER: Law = Law::Fluid {
        bulk_modulus: 2e5,
        viscosity: 1e-3,
    };

    fn moving(gradient: Mat3<f64>, memory: f64, dt: f64) -> Trial<f64> {
        Trial {
            gradient,
            ..trial(&Mat3::identity(), memory, dt)
        }
    }

    #[test]
    fn pressure_is_that_of_tait_and_the_derivative_of_energy() {
        let k = prepared(WATER, 0.0, 0.0);
        for j in [0.3, 0.7, 0.97, 0.9999, 1.0, 1.2] {
            let tau = WATER
                .respond(&trial(&Mat3::identity(), j - 1.0, 0.0), &k)
                .tau;
            let pressure: f64 = if j < 1.0 {
                2e5 / 7.0 * (f64::powi(j, -7) - 1.0)
            } else {
                0.0
            };
            assert!(
                (tau[0] + j * pressure).abs() < 1e-13 * (2e5 + pressure),
                "{j}: {tau:?}"
            );
            let h = 1e-5;
            let at = |j: f64| WATER.energy_density(&Mat3::identity(), j - 1.0, &k);
            let slope =
                (8.0 * (at(j + h) - at(j - h)) - (at(j + 2.0 * h) - at(j - 2.0 * h))) / (12.0 * h);
            // Where the pressure sets in the energy has a kink in its second derivative: an error of order h.
            let kink = if j == 1.0 { 2e5 * h } else { 0.0 };
            assert!(
                (slope + pressure).abs() < 1e-8 * (2e5 + pressure) + kink,
                "{j}: {slope} {pressure}"
            );
            if j < 1.0 {
                // -d(J p)/d ln J
                let jp = |j: f64| j * 2e5 / 7.0 * (j.powi(-7) - 1.0);
                let tangent = -j * (jp(j + 1e-6) - jp(j - 1e-6)) / 2e-6;
                assert!((super::tangent(j) * 2e5 / tangent - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn shear_is_resisted_by_viscosity_alone_and_by_no_more_than_it() {
        let law = Law::Fluid {
            bulk_modulus: 2e5,
            viscosity: 10.0,
        };
        let k = prepared(law, 0.0, 0.0);
        let mut gradient = Mat3([[0.0; 3]; 3]);
        gradient.0[0][1] = 3.0;
        let response = law.respond(&moving(gradient, 0.0, 1e-3), &k);
        assert_eq!(response.memory, 0.0);
        let expected = [0.0, 30.0, 0.0, 0.0, 0.0, 0.0];
        assert!(
            response
                .tau
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-12)
        );
        // Turning is not resisted at all, and viscosity only takes energy.
        gradient.0[1][0] = -3.0;
        assert!(
            law.respond(&moving(gradient, 0.0, 1e-3), &k)
                .tau
                .iter()
                .all(|t| t.abs() < 1e-12)
        );
        let mut random = Random::new(51);
        for _ in 0..1_000 {
            let c = Mat3(std::array::from_fn(|_| {
                std::array::from_fn(|_| random.uniform(-9.0, 9.0))
            }));
            let t = law.respond(&moving(c, 0.5, 0.0), &k).tau;
            let t = Mat3([[t[0], t[1], t[2]], [t[1], t[3], t[4]], [t[2], t[4], t[5]]]);
            let power: f64 = (0..9).map(|n| t.0[n / 3][n % 3] * c.0[n / 3][n % 3]).sum();
            assert!(power > 0.0);
        }
    }

    #[test]
    fn volume_is_that_of_the_particles_way() {
        let k = prepared(WATER, 0.0, 0.0);
        let single: Coefficients<f32> = k.splat();
        let (mut memory, mut rounded, mut moved) = (0.0, 0.0_f32, Mat3::identity());
        for step in 0..200 {
            let sign = if step % 2 == 0 { -1.0 } else { 1.0 };
            let gradient = Mat3([
                [sign * 60.0, 200.0, 0.0],
                [-200.0, sign * 30.0, 0.0],
                [0.0; 3],
            ]);
            memory = WATER.respond(&moving(gradient, memory, 1e-4), &k).memory;
            let trial = Trial {
                f: Mat3::identity(),
                memory: rounded,
                gradient: Mat3(gradient.0.map(|row| row.map(|x| x as f32))),
                dt: 1e-4,
            };
            rounded = WATER.respond(&trial, &single).memory;
            let way = Mat3(gradient.0.map(|row| row.map(|c| 1e-4 * c)));
            moved = crate::kinematics::advance_deformation(&moved, &way);
        }
        // The vortex widens: 200 steps of 0.02^2.
        assert!(
            memory > 0.05 && (memory - moved.det() + 1.0).abs() < 1e-12,
            "{memory}"
        );
        // Two hundred roundings of 6e-8 of numbers up to 0.08.
        assert!((f64::from(rounded) - memory).abs() < 2e-6, "{rounded}");
    }

    #[test]
    fn volume_stays_within_its_range_and_nan_stays_nan() {
        let k = prepared(WATER, 0.0, 0.0);
        let at =
            |rate: f64, memory| WATER.respond(&moving(Mat3::diagonal([rate; 3]), memory, 1e-3), &k);
        assert_eq!(at(1e9, 0.0).j, J_MAX);
        assert_eq!(at(-1e9, 0.0).j, J_MIN);
        assert!(at(-1e9, 0.0).tau[0].is_finite());
        assert!(at(f64::NAN, 0.0).tau.iter().all(|t| t.is_nan()));
        assert!(at(0.0, f64::NAN).tau[0].is_nan());
    }
}
