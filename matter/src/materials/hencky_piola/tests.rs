//! Matter over rest positions flows as the law does over the present ones.

use super::*;
use crate::materials::{
    laws::elastic_laws,
    testing::{Random, equivalent_stress, extension, prepared},
};

const METAL: Law = Law::VonMises {
    yield_stress: 2e4,
    hardening: 1e5,
};
const LAWS: [Law; 4] = [
    METAL,
    Law::Plasticine {
        yield_stress: 2e4,
        softening: 4e4,
    },
    Law::Foam {
        yield_stress: 1e4,
        viscosity: 50.0,
        exponent: 0.6,
    },
    Law::Hencky,
];
const E: f64 = 1e6;
const NU: f64 = 0.3;

fn at(f: &Mat3<f64>) -> Deformation<'static, f64> {
    Deformation {
        axes: None,
        h: f.sub(&Mat3::identity()),
    }
}

/// A path of small random deformations one after the other.
fn path(random: &mut Random, steps: usize, size: f64) -> Vec<Mat3<f64>> {
    let mut f = Mat3::identity();
    let step = |random: &mut Random, f: &Mat3<f64>| {
        let d = Mat3(std::array::from_fn(|_| {
            std::array::from_fn(|_| random.uniform(-size, size))
        }));
        f.blend(1.0, &d.mul(f), 1.0)
    };
    let mut all = vec![];
    for _ in 0..steps {
        f = step(random, &f);
        all.push(f);
    }
    all
}

#[test]
fn flow_over_rest_positions_is_that_of_the_law() {
    let mut random = Random::new(41);
    for law in LAWS {
        let k = prepared(law, E, NU);
        for _ in 0..20 {
            let (mut point, mut before) = (Point::rest(), Mat3::identity());
            let (mut f_e, mut memory) = (Mat3::identity(), 0.0);
            for f in path(&mut random, 60, 0.01) {
                let answer = respond(law, &at(&f), &point, (1e-3, true), &k);
                let step = f.mul(&inverse(&before));
                let trial = Trial {
                    f: step.mul(&f_e),
                    memory,
                    gradient: Mat3([[0.0; 3]; 3]),
                    dt: 1e-3,
                };
                let expected = law.respond(&trial, &k);
                (point, before) = (answer.point, f);
                (f_e, memory) = (expected.f, expected.memory);
                // Round-off of sixty steps at strains of some tenths.
                let tau = answer.piola.stress.mul_transposed_sym(&f);
                for n in 0..6 {
                    assert!((tau[n] - expected.tau[n]).abs() < 1e-11 * E, "{law:?}");
                }
                assert!((point.memory - memory).abs() < 1e-12);
            }
            assert!(memory > 0.0 || law == Law::Hencky);
        }
    }
}

fn inverse(f: &Mat3<f64>) -> Mat3<f64> {
    scaled(&f.cofactor().transpose(), 1.0 / f.det())
}

#[test]
fn axes_of_the_grid_change_nothing() {
    let mut random = Random::new(42);
    let k = prepared(METAL, E, NU);
    for _ in 0..50 {
        let axes = random.rotation();
        let (f, _) = random.deformation(0.8, 1.25, false);
        let turned = Deformation {
            axes: Some(&axes),
            h: f.mul(&axes).sub(&axes),
        };
        let expected = respond(METAL, &at(&f), &Point::rest(), (1e-3, true), &k);
        let answer = respond(METAL, &turned, &Point::rest(), (1e-3, true), &k);
        let over_world = answer.piola.stress.mul_transposed(&axes);
        let error = over_world.sub(&expected.piola.stress).norm_squared().sqrt();
        assert!(error < 1e-11 * E, "{error}");
        assert!((answer.point.memory - expected.point.memory).abs() < 1e-13);
    }
}

#[test]
fn stretched_metal_follows_its_hardening_line() {
    let k = prepared(METAL, E, NU);
    let mut point = Point::rest();
    for step in 1..=1_000 {
        let total = 1e-3 * f64::from(step);
        let f = extension(total);
        let answer = respond(METAL, &at(&f), &point, (1e-6, true), &k);
        point = answer.point;
        // 3 mu (total - alpha) = yield_stress + hardening alpha
        let alpha = ((3.0 * k.mu * total - 2e4) / (3.0 * k.mu + 1e5)).max(0.0);
        let stress = equivalent_stress(&answer.piola.stress.mul_transposed_sym(&f));
        // Round-off of a thousand steps.
        assert!((point.memory - alpha).abs() < 1e-11, "{alpha}");
        assert!((stress - 3.0 * k.mu * (total - alpha)).abs() < 1e-11 * E);
        let plastic = point.plastic.blend(1.0, &Mat3::identity(), 1.0);
        assert!((plastic.det() - 1.0).abs() < 1e-12);
    }
}

/// Of matter inside out and crushed as well: what no state remembers is the slope of an energy all the same.
#[test]
fn elastic_stress_of_what_has_flowed_is_the_slope_of_energy() {
    let mut random = Random::new(43);
    let k = prepared(Law::Hencky, E, NU);
    for n in 0..60 {
        let (f, _) = random.deformation([0.8, 0.1][n % 2], [1.2, 1.8][n % 2], n % 3 == 0);
        let (plastic, _) = random.deformation(0.7, 1.4, false);
        let point = Point {
            plastic: plastic.sub(&Mat3::identity()),
            memory: 0.0,
        };
        let p = respond(Law::Hencky, &at(&f), &point, (0.0, true), &k)
            .piola
            .stress;
        let d = path(&mut random, 1, 1.0)[0].sub(&Mat3::identity());
        let h = 1e-6;
        let value = |s: f64| energy(Law::Hencky, &at(&f.blend(1.0, &d, s)), &point, &k);
        let slope = (value(h) - value(-h)) / (2.0 * h);
        let along: f64 = (0..9).map(|n| p.0[n / 3][n % 3] * d.0[n / 3][n % 3]).sum();
        // Central differences of second order, and of third where a stretch passes the end of the logarithm.
        assert!(
            (slope - along).abs() < 1e-4 * (E + along.abs()),
            "{slope} {along}"
        );
    }
}

#[test]
fn tangent_bound_holds_for_what_has_flowed() {
    let mut random = Random::new(44);
    let k = prepared(Law::Hencky, E, NU);
    for n in 0..300 {
        let (low, high) = [(0.9, 1.1), (0.5, 2.0), (0.2, 1.5)][n % 3];
        let (f, _) = random.deformation(low, high, false);
        let (plastic, _) = random.deformation(0.5, 2.0, false);
        let point = Point {
            plastic: plastic.sub(&Mat3::identity()),
            memory: 0.0,
        };
        let bound = respond(Law::Hencky, &at(&f), &point, (0.0, true), &k)
            .piola
            .tangent;
        for _ in 0..20 {
            let d = path(&mut random, 1, 1.0)[0].sub(&Mat3::identity());
            let h = 1e-5;
            let stress = |s: f64| {
                let at = at(&f.blend(1.0, &d, s));
                respond(Law::Hencky, &at, &point, (0.0, true), &k)
                    .piola
                    .stress
            };
            let change = stress(h).sub(&stress(-h));
            let along: f64 = (0..9)
                .map(|n| change.0[n / 3][n % 3] * d.0[n / 3][n % 3])
                .sum();
            let curvature = along / (2.0 * h * d.norm_squared());
            assert!(curvature < 1.001 * bound, "{n}: {curvature} {bound}");
        }
    }
}

#[test]
fn crushed_and_inverted_points_answer_and_do_not_forget() {
    let mut random = Random::new(45);
    for law in LAWS {
        let k = prepared(law, E, NU);
        for n in 0..50 {
            let (f, _) = random.deformation(0.02, 0.25, n % 2 == 0);
            let answer = respond(law, &at(&f), &Point::rest(), (1e-3, true), &k);
            assert!(!answer.flows && answer.point.memory == 0.0);
            let size = answer.piola.stress.norm_squared();
            assert!(size.is_finite() && answer.piola.tangent.is_finite());
        }
    }
}

#[test]
fn laws_without_flow_keep_the_shape_that_matter_has() {
    let mut random = Random::new(46);
    for law in elastic_laws() {
        let k = prepared(law, E, NU);
        let (f, _) = random.deformation(0.6, 1.7, false);
        let point = Point {
            plastic: inverse(&f).sub(&Mat3::identity()),
            memory: 0.3,
        };
        let answer = respond(law, &at(&f), &point, (1e-3, true), &k);
        // Round-off: all of it is plastic.
        assert!(answer.piola.stress.norm_squared().sqrt() < 1e-11 * E);
        assert!(!answer.flows && answer.point.memory == 0.3);
        assert!(energy(law, &at(&f), &point, &k).abs() < 1e-8 * E);
    }
}
