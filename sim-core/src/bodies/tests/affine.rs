//! Laws of matter that deforms the same everywhere.

use crate::{
    bodies::affine::{Affine, Bulk, Lump},
    mat3::{Mat3, cross, length},
    materials::Law,
    test_scenes::elastic,
};

/// Density [kg/m^3], as in [`elastic`].
const DENSITY: f64 = 1000.0;
/// Edge of the cubes [m].
const EDGE: f64 = 0.2;
/// Young's modulus [Pa].
const STIFFNESS: f64 = 2e5;

/// A cube whose matter has been deformed by `elastic_part` when it became affine; `own` is `D_p` [m^2].
fn cube(law: Law, poisson_ratio: f64, elastic_part: Mat3<f64>, own: f64) -> Bulk {
    let volume = EDGE.powi(3);
    let mass = DENSITY * volume;
    let lump = Lump {
        volume,
        material: elastic(law, STIFFNESS, poisson_ratio),
        elastic: elastic_part,
    };
    Bulk::new(
        mass,
        Mat3::diagonal([mass * EDGE * EDGE / 12.0; 3]),
        mass * own,
        0.5 * EDGE * 3.0_f64.sqrt(),
        elastic_part,
        vec![lump],
    )
    .expect("a cube")
}

fn at_rest(map: Mat3<f64>) -> Affine {
    Affine {
        com: [0.0; 3],
        velocity: [0.0; 3],
        map: map.0,
        rate: [[0.0; 3]; 3],
    }
}

/// Stretched along all axes alike or not.
fn strained(strain: [f64; 3]) -> Mat3<f64> {
    Mat3::diagonal(strain.map(|e| 1.0 + e))
}

fn energy(bulk: &Bulk, affine: &Affine) -> f64 {
    bulk.kinetic_energy(affine) + bulk.elastic_energy(&affine.map())
}

#[test]
fn homogeneous_modes_have_their_frequencies() {
    let own = 1e-4;
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        for nu in [0.0, 0.3] {
            let bulk = cube(law, nu, Mat3::identity(), own);
            let material = elastic(law, STIFFNESS, nu);
            let (lambda, mu) = (material.lambda(), material.mu());
            // Small strains e_i on a second moment of m (L^2 / 12 + D_p) along each axis: its mass times
            // e_i'' = -V (lambda tr e + 2 mu e_i).
            let inertia = DENSITY * (EDGE * EDGE / 12.0 + own);
            for (modulus, strain) in [
                (3.0 * lambda + 2.0 * mu, [1e-4; 3]),
                (2.0 * mu, [1e-4, -0.5e-4, -0.5e-4]),
                (2.0 * mu, [1e-4, -1e-4, 0.0]),
            ] {
                let quarter = 0.5 * std::f64::consts::PI / f64::sqrt(modulus / inertia);
                let start = at_rest(strained(strain));
                let flight = bulk.flight(&start, [0.0; 3], 0.0, quarter);
                let end = flight.expect("small strains").end;
                for a in 0..3 {
                    // A step of a twentieth of the limit is late by (0.1)^2 / 24 of the phase; the rest is of second order in
                    // the strain.
                    let left = (end.map[a][a] - 1.0) / 1e-4;
                    assert!(left.abs() < 1.5e-3, "{law:?} {nu} {strain:?}: {left}");
                }
            }
        }
    }
}

#[test]
fn a_stretched_spinning_cube_keeps_its_momenta_to_round_off_and_energy_to_second_order() {
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        let before = Mat3([[1.02, 0.03, 0.0], [-0.01, 0.98, 0.02], [0.0, 0.01, 1.05]]);
        let bulk = cube(law, 0.3, before, 1e-4);
        let mut start = at_rest(strained([0.1, -0.05, 0.02]));
        start.velocity = [1.0, 2.0, -0.5];
        start.rate = [[3.0, -20.0, 4.0], [15.0, -2.0, 9.0], [1.0, -12.0, 2.0]];
        let momentum = bulk.angular_momentum(&start);
        // Of energy the largest on the way, as it swings.
        let errors = [4, 8, 16].map(|steps| {
            let (mut affine, mut worst) = (start, 0.0_f64);
            for _ in 0..64 {
                let flight = bulk.fly(&affine, [0.0; 3], 0.0, 0.002, steps);
                affine = flight.expect("moderate strains").end;
                worst = worst.max((energy(&bulk, &affine) / energy(&bulk, &start) - 1.0).abs());
            }
            assert_eq!(affine.velocity, start.velocity);
            let change = bulk.angular_momentum(&affine);
            let change: [f64; 3] = std::array::from_fn(|a| change[a] - momentum[a]);
            // A thousand steps of round-off of a few units each.
            assert!(length(change) < 1e-13 * length(momentum), "{change:?}");
            worst
        });
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 2.0).abs() < 0.2, "{law:?}: {order} of {errors:?}");
        }
        // With the steps that it takes by itself, over hundreds of periods: it swings and does not drift.
        let (mut affine, mut worst) = (start, 0.0_f64);
        for _ in 0..600 {
            let flight = bulk.flight(&affine, [0.0; 3], 0.0, 1.0 / 60.0);
            affine = flight.expect("moderate strains").end;
            worst = worst.max((energy(&bulk, &affine) / energy(&bulk, &start) - 1.0).abs());
        }
        assert!(worst < 1e-3, "{law:?}: {worst}");
    }
}

#[test]
fn what_spins_steadily_keeps_its_stretch() {
    // Spun up to where stress carries the centrifugal load: R(w t) S stays an orbit.
    let bulk = cube(Law::NeoHookean, 0.0, Mat3::identity(), 0.0);
    let (mu, inertia) = (0.5 * STIFFNESS, DENSITY * EDGE * EDGE / 12.0);
    let stretch = 1.05_f64;
    // tau = mu (s^2 - 1) per volume against w^2 s times its moment per s: w^2 s^2 I = mu (s^2 - 1).
    let w = (mu * (stretch * stretch - 1.0) / (inertia * stretch * stretch)).sqrt();
    let mut start = at_rest(Mat3::diagonal([stretch, stretch, 1.0]));
    start.rate = [[0.0, -w * stretch, 0.0], [w * stretch, 0.0, 0.0], [0.0; 3]];
    let end = bulk
        .flight(&start, [0.0; 3], 0.0, 0.05)
        .expect("moderate")
        .end;
    let size = length([end.map[0][0], end.map[1][0], end.map[2][0]]);
    // Second order in steps of at most 0.1 of the fastest mode's radian: (0.1)^2 / 8 of the strain.
    assert!((size - stretch).abs() < 1e-4, "{size}");
}

#[test]
fn gravity_and_damping_move_the_centre_of_mass_exactly() {
    let bulk = cube(Law::FixedCorotated, 0.3, Mat3::identity(), 1e-4);
    let (gravity, v) = ([0.0, -9.81, 0.0], 3.0);
    for damping in [0.0, 1e-9, 1e-4, 0.01, 0.5, 10.0] {
        let mut affine = at_rest(Mat3::identity());
        affine.velocity[1] = v;
        let mut frames = affine;
        for _ in 0..60 {
            let flight = bulk.flight(&frames, gravity, damping, 1.0 / 60.0);
            frames = flight.expect("no strain").end;
        }
        let (y, w) = match damping < 1e-3 {
            // To second order in the damping.
            true => (
                v - 0.5 * 9.81 - damping * (0.5 * v - 9.81 / 6.0),
                v - 9.81 - damping * (v - 0.5 * 9.81),
            ),
            false => {
                let (end, kept) = (-9.81 / damping, (-damping).exp());
                let way = (1.0 - kept) / damping;
                (end + (v - end) * way, end + (v - end) * kept)
            }
        };
        let tolerance = 1e-11 + 10.0 * damping.powi(2) * f64::from(damping < 1e-3);
        assert!(
            (frames.com[1] - y).abs() < tolerance,
            "{damping}: {}",
            frames.com[1] - y
        );
        assert!((frames.velocity[1] - w).abs() < tolerance, "{damping}");
    }
}

#[test]
fn what_would_turn_inside_out_is_not_followed() {
    let bulk = cube(Law::NeoHookean, 0.3, Mat3::identity(), 1e-4);
    let mut start = at_rest(Mat3::identity());
    for rate in [-1e4, 1e4, f64::NAN] {
        start.rate = Mat3::diagonal([rate, 0.0, 0.0]).0;
        assert!(
            bulk.flight(&start, [0.0; 3], 0.0, 1.0 / 60.0).is_none(),
            "{rate}"
        );
    }
    // Nor what would take too many steps.
    start.rate = Mat3::diagonal([1.0, 0.0, 0.0]).0;
    assert!(bulk.flight(&start, [0.0; 3], 0.0, 1e6).is_none());
}

#[test]
fn particles_take_over_momentum_and_never_more_energy() {
    let bulk = cube(Law::FixedCorotated, 0.3, Mat3::identity(), 1e-3);
    let mut affine = at_rest(Mat3([[1.1, 0.1, 0.0], [0.0, 0.9, 0.05], [0.02, 0.0, 0.95]]));
    affine.rate = [[5.0, -20.0, 4.0], [15.0, -8.0, 9.0], [1.0, -12.0, 6.0]];
    let momentum = bulk.angular_momentum(&affine);
    let mass = DENSITY * EDGE.powi(3);
    let spread = bulk
        .spread_at(&affine.map())
        .blend(1.0, &Mat3::diagonal([mass * 1e-3; 3]), 1.0);
    for (gain, lag) in [
        (0.0, 0.0),
        (0.0, 1e-3),
        (0.05, 0.0),
        (-0.05, 0.0),
        (1e3, 0.0),
    ] {
        let loosened = bulk.loosened(&affine, gain, lag);
        // sum m (r x v + D_p axial(C)) with v = C r.
        let moments = loosened.gradient.mul(&spread);
        let mut found = [0.0; 3];
        for b in 0..3 {
            let mut axis = [0.0; 3];
            axis[b] = 1.0;
            let turn = cross(axis, moments.column(b));
            for a in 0..3 {
                found[a] += turn[a];
            }
        }
        let error: [f64; 3] = std::array::from_fn(|a| found[a] - momentum[a]);
        assert!(length(error) < 1e-13 * length(momentum), "{error:?}");
        if lag > 0.0 {
            continue;
        }
        let kinetic = 0.5
            * (0..3)
                .map(|a| crate::mat3::dot(moments.0[a], loosened.gradient.0[a]))
                .sum::<f64>();
        let before = bulk.kinetic_energy(&affine);
        // All is accounted for, and only what cannot be paid is gained.
        let booked = before - gain - kinetic - loosened.lost;
        assert!(booked.abs() < 1e-12 * before.max(gain.abs()), "{booked}");
        assert!(
            loosened.lost >= -1e-12 || gain > before,
            "{gain}: {}",
            loosened.lost
        );
    }
}
