//! Laws of the constitutive models: stress is the derivative of energy, rotations do no work, closed forms.

use super::{
    Coefficients, Law, Material, Trial,
    laws::elastic_laws,
    limits::{DeformationBounds, critical_dt, max_stretch_squared},
    polar::rotation,
    svd::{Svd, svd},
    testing::Random,
};
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Young's modulus [Pa] and Poisson's ratio of the tested materials, and Lamé's parameters that follow.
const E: f64 = 1e6;
const NU: f64 = 0.3;
const LAMBDA: f64 = E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU));
const MU: f64 = E / (2.0 * (1.0 + NU));

fn material(law: Law) -> Material {
    Material {
        name: "tested".into(),
        law,
        youngs_modulus: E,
        poisson_ratio: NU,
        density: 1000.0,
        loss: 0.0,
    }
}

/// Stress of a state that has not flowed.
fn stress<R: Real>(law: Law, f: &Mat3<R>) -> Sym3<R> {
    let trial = Trial {
        f: *f,
        memory: R::splat(0.0),
        gradient: Mat3([[R::splat(0.0); 3]; 3]),
        dt: R::splat(0.0),
    };
    let k = Coefficients::new(&material(law));
    law.respond(&trial, &k.splat()).tau
}

fn energy(law: Law, f: &Mat3<f64>) -> f64 {
    law.energy_density(f, 0.0, &Coefficients::new(&material(law)))
}

fn to_f32(m: &Mat3<f64>) -> Mat3<f32> {
    Mat3(m.0.map(|row| row.map(|x| x as f32)))
}

fn to_f64(m: &Mat3<f32>) -> Mat3<f64> {
    Mat3(m.0.map(|row| row.map(f64::from)))
}

fn distance<R: Real>(a: &Mat3<R>, b: &Mat3<R>) -> R {
    a.sub(b).norm_squared().sqrt()
}

/// `tau_ij C_ij`, the power of a velocity gradient per rest volume.
fn power(tau: &Sym3<f64>, c: &Mat3<f64>) -> f64 {
    let full = Mat3([
        [tau[0], tau[1], tau[2]],
        [tau[1], tau[3], tau[4]],
        [tau[2], tau[4], tau[5]],
    ]);
    (0..3)
        .flat_map(|i| (0..3).map(move |j| (i, j)))
        .map(|(i, j)| full.0[i][j] * c.0[i][j])
        .sum()
}

#[test]
fn stress_is_the_derivative_of_energy() {
    let mut random = Random::new(1);
    for law in elastic_laws() {
        for _ in 0..200 {
            let (f, _) = random.deformation(0.5, 2.0, false);
            let c = Mat3(std::array::from_fn(|_| {
                std::array::from_fn(|_| random.uniform(-1.0, 1.0))
            }));
            let psi = |h: f64| {
                let moved = Mat3::identity().blend(1.0, &c, h).mul(&f);
                energy(law, &moved)
            };
            // Fourth-order central difference: truncation h^4 ~ 1e-12, round-off 1e-16 / h ~ 1e-13, both
            // against energies and powers of order 10 E.
            let h = 1e-3;
            let slope = (8.0 * (psi(h) - psi(-h)) - (psi(2.0 * h) - psi(-2.0 * h))) / (12.0 * h);
            let expected = power(&stress(law, &f), &c);
            assert!(
                (slope - expected).abs() < 1e-8 * (MU + expected.abs()),
                "{law:?}: energy slope {slope}, stress power {expected}"
            );
        }
    }
}

#[test]
fn uniaxial_stretch_gives_the_closed_form_stress() {
    for s in [0.4, 0.8, 1.0, 1.3, 3.0] {
        let f = Mat3::diagonal([s, 1.0, 1.0]);
        let corotated = stress(Law::FixedCorotated, &f);
        let bulk = LAMBDA * (s - 1.0) * s;
        let expected = [2.0 * MU * (s - 1.0) * s + bulk, 0.0, 0.0, bulk, 0.0, bulk];
        for (got, want) in corotated.iter().zip(expected) {
            assert!((got - want).abs() < 1e-8 * MU, "{corotated:?}, stretch {s}");
        }
        let neo = stress(Law::NeoHookean, &f);
        let bulk = LAMBDA * s.ln();
        let expected = [MU * (s * s - 1.0) + bulk, 0.0, 0.0, bulk, 0.0, bulk];
        for (got, want) in neo.iter().zip(expected) {
            assert!((got - want).abs() < 1e-8 * MU, "{neo:?}, stretch {s}");
        }
    }
}

#[test]
fn corotated_energy_is_that_of_the_distance_from_the_rotation() {
    let mut random = Random::new(7);
    for case in 0..2_000 {
        let (low, high) = [(0.99, 1.01), (0.5, 2.0), (0.001, 3.0), (0.0, 1e-3)][case % 4];
        let (f, r) = random.deformation(low, high, case % 8 > 5);
        let volumetric = 0.5 * LAMBDA * (f.det() - 1.0).powi(2);
        let expected = MU * f.sub(&r).norm_squared() + volumetric;
        let energy = energy(Law::FixedCorotated, &f);
        // The difference of terms of order 3 mu cancels to a few roundings.
        let tolerance = 1e-14 * (3.0 * MU + expected);
        assert!((energy - expected).abs() < tolerance, "{energy} {expected}");
    }
    let crushed = energy(Law::FixedCorotated, &Mat3([[0.0; 3]; 3]));
    assert!((crushed - 3.0 * MU - 0.5 * LAMBDA).abs() < 1e-8 * MU);
}

#[test]
fn rotating_a_body_rotates_its_stress_and_keeps_its_energy() {
    let mut random = Random::new(2);
    for law in elastic_laws() {
        for _ in 0..200 {
            let (f, _) = random.deformation(0.5, 2.0, false);
            let q = random.rotation();
            let turned = q.mul(&f);
            let psi = energy(law, &f);
            let psi_turned = energy(law, &turned);
            assert!((psi - psi_turned).abs() < 1e-11 * (psi + MU));
            let c = Mat3(std::array::from_fn(|_| {
                std::array::from_fn(|_| random.uniform(-1.0, 1.0))
            }));
            let before = power(&stress(law, &f), &c);
            let c_turned = q.mul(&c).mul_transposed(&q);
            let after = power(&stress(law, &turned), &c_turned);
            assert!((before - after).abs() < 1e-10 * (before.abs() + MU));
            let rest = stress(law, &q);
            assert!(rest.iter().all(|t| t.abs() < 1e-8 * MU), "{rest:?}");
        }
    }
}

/// Worst Frobenius error of the `f32` rotation over random `F`.
fn polar_error(low: f64, high: f64, inverted: bool) -> f64 {
    let mut random = Random::new(3);
    (0..20_000)
        .map(|_| {
            let (f, r) = random.deformation(low, high, inverted);
            distance(&to_f64(&rotation(&to_f32(&f))), &r)
        })
        .fold(0.0, f64::max)
}

#[test]
fn rotation_reaches_single_precision_for_ordinary_stretches() {
    // Newton reaches 3e-7 here; the input's own rounding turns R by up to 6e-8 / (s_i + s_j).
    assert!(polar_error(0.9, 1.1, false) < 6e-7);
    assert!(polar_error(0.5, 2.0, false) < 6e-7);
    let error = polar_error(0.25, 4.0, false);
    assert!(error < 2e-6, "{error}");
}

#[test]
fn rotation_survives_extreme_and_inverted_deformation() {
    let error = polar_error(0.1, 5.0, false);
    assert!(error < 2e-5, "{error}");
    // A lane is accepted up to |R^T R - I| = 1e-5, that is an error of 5e-6; one third of that was measured for
    // the singular value decomposition.
    let error = polar_error(0.01, 2.0, false);
    assert!(error < 2e-5, "{error}");
    let error = polar_error(0.5, 2.0, true);
    assert!(error < 2e-5, "{error}");
}

#[test]
fn singular_values_rebuild_the_matrix_with_proper_rotations() {
    let mut random = Random::new(4);
    for case in 0..20_000 {
        let (mut f, _) = random.deformation(0.01, 3.0, case % 2 == 1);
        match case % 10 {
            8 => f = Mat3::diagonal([0.0, 2.0, 0.0]),
            9 => f = Mat3([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [-1.0, -2.0, -3.0]]),
            _ => {}
        }
        let f = to_f32(&f);
        let Svd { u, sigma, v } = svd(&f);
        let rebuilt = u.mul(&Mat3::diagonal(sigma)).mul_transposed(&v);
        // Relative to the norm (up to 9): a few tens of roundings of 6e-8.
        assert!(distance(&rebuilt, &f) < 1e-5, "{f:?}: {sigma:?}");
        for q in [u, v] {
            let identity = q.mul_transposed(&q);
            assert!(distance(&identity, &Mat3::identity()) < 5e-6, "{f:?}");
            assert!((q.det() - 1.0).abs() < 5e-6);
        }
        let noise = 1e-6 * sigma[0];
        assert!(sigma[0] >= sigma[1] - noise && sigma[1] >= sigma[2].abs() - noise);
    }
}

#[test]
fn zero_and_nan_matrices_are_contained() {
    let zero = rotation(&Mat3([[0.0_f32; 3]; 3]));
    assert!(distance(&zero.mul_transposed(&zero), &Mat3::identity()) < 1e-6);
    for law in elastic_laws() {
        // The guard finds bad particles by their stress: a law must not turn NaN into a finite value.
        let tau = stress(law, &Mat3([[f32::NAN; 3]; 3]));
        assert!(tau.iter().all(|t| t.is_nan()), "{law:?}: {tau:?}");
    }
}

/// And never below it.
#[test]
fn stretch_bound_is_at_most_a_third_above_the_square() {
    let mut random = Random::new(5);
    for _ in 0..2_000 {
        let (f, _) = random.deformation(0.05, 4.0, false);
        let exact = svd(&f).sigma[0].powi(2);
        let bound = max_stretch_squared(&f);
        assert!(bound > exact * (1.0 - 1e-12) && bound < exact * (4.0 / 3.0 + 1e-12));
    }
}

/// `C : d tau / dt` for the velocity gradient `C`: the stiffness that an isolated particle feels.
fn stiffness(law: Law, f: &Mat3<f64>, c: &Mat3<f64>) -> f64 {
    let h = 1e-6;
    let at = |h: f64| {
        let moved = Mat3::identity().blend(1.0, c, h).mul(f);
        power(&stress(law, &moved), c)
    };
    (at(h) - at(-h)) / (2.0 * h)
}

#[test]
fn critical_step_uses_the_stiffest_tangent_within_its_bounds() {
    let mut random = Random::new(6);
    let (rho0, dx) = (1000.0, 0.1);
    for law in elastic_laws() {
        for case in 0..2_000 {
            let (f, _) = random.deformation(0.3, 3.0, law == Law::FixedCorotated && case % 4 == 0);
            let sigma = svd(&f).sigma;
            let bounds = DeformationBounds {
                max_stretch: sigma[0],
                min_j: f.det(),
                max_j: f.det(),
                max_stiffness: 1.0,
            };
            let dt = critical_dt(&material(law), rho0, dx, &bounds);
            let limit = rho0 * dx * dx / (dt * dt);
            let mut c = Mat3::diagonal(std::array::from_fn(|_| random.uniform(-1.0, 1.0)));
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                c.0[i][j] = random.uniform(-1.0, 1.0);
                c.0[j][i] = c.0[i][j];
            }
            let found = stiffness(law, &f, &c) / c.norm_squared();
            assert!(
                found < limit * (1.0 + 1e-6),
                "{law:?}: {found} above {limit}, {sigma:?}"
            );
        }
        // Equal stretches, equal rates: the bound is reached. The difference quotient is good to 1e-8.
        for s in [1.0, 1.3, 2.0] {
            let f = Mat3::diagonal([s; 3]);
            let j = s * s * s;
            let bounds = DeformationBounds {
                max_stretch: s,
                min_j: j,
                max_j: j,
                max_stiffness: 1.0,
            };
            let dt = critical_dt(&material(law), rho0, dx, &bounds);
            let limit = rho0 * dx * dx / (dt * dt);
            let found = stiffness(law, &f, &Mat3::identity()) / 3.0;
            assert!(
                (found / limit - 1.0).abs() < 1e-6,
                "{law:?}: {found}, {limit}"
            );
        }
    }
}
