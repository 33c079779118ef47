//! Conservation, friction, stability: what must hold whatever the code looks like.

use super::*;
use crate::{mat3::dot, materials::limits::DeformationBounds, report::DtLimit};

/// Over ten thousand substeps.
#[test]
fn a_spinning_colliding_pair_conserves_momentum() {
    let mut scene = empty(0.1);
    for (law, x, v, w) in [
        (Law::FixedCorotated, -0.35, 0.15, [0.6, 0.2, -0.4]),
        (Law::NeoHookean, 0.25, -0.1, [-0.2, 0.4, 0.8]),
    ] {
        let id = add_box(
            &mut scene,
            elastic(law, 1e6, 0.3),
            [x, 0.3 * x, 0.1 * x],
            0.05,
            [7, 6, 5],
        );
        scene.objects[id].linear_velocity = [v, 0.02, 0.03];
        scene.objects[id].velocity_gradient = spin(w);
    }
    let mut world = World::new(scene).expect("valid scene");
    let first = world.report().clone();
    // Sizes against which errors count: those of the single objects, whose sums partly cancel.
    let momentum: f64 = first
        .objects
        .iter()
        .map(|o| o.mass * norm(o.linear_velocity))
        .sum();
    let angular: f64 = first.objects.iter().map(|o| norm(o.angular_momentum)).sum();
    let energy = |r: &StepReport| r.kinetic_energy + r.elastic_energy;
    let mut substeps = 0;
    while substeps < 10_000 {
        let report = world.step(1.0 / 30.0, &[]);
        substeps += report.substeps;
        assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
    }
    let last = world.report();
    // They did meet: the first object was pushed back.
    assert!(last.objects[0].linear_velocity[0] < 0.7 * first.objects[0].linear_velocity[0]);
    let error = distance(last.linear_momentum, first.linear_momentum);
    assert!(
        error < 1e-5 * momentum,
        "linear momentum moved by {error:e} of {momentum}"
    );
    let error = distance(last.angular_momentum, first.angular_momentum);
    assert!(
        error < 1e-5 * angular,
        "angular momentum moved by {error:e} of {angular}"
    );
    // The gate of the validation suite.
    assert!(
        energy(last) < 1.005 * energy(&first),
        "{} of {}",
        energy(last),
        energy(&first)
    );
}

/// A stiff block that starts at rest, touching a plane inclined by 24 degrees. The plane cuts through the grid at
/// `across` radians, gravity makes up the difference. Returns the way along the slope and off the plane.
fn slide(across: f64, friction: f64, damping: f64, frames: u32) -> (f64, f64) {
    let (dx, theta, g) = (0.05, 24.0_f64.to_radians(), 9.81);
    let about_y = |v: [f64; 3]| {
        let (s, c) = across.sin_cos();
        [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]]
    };
    let mut scene = empty(dx);
    let material = elastic(Law::FixedCorotated, 1e7, 0.3);
    add_box(&mut scene, material, [0.0; 3], 0.5 * dx, [10, 8, 4]);
    for x in &mut scene.particles.position {
        *x = about_y(*x);
    }
    let (down, normal) = (about_y([1.0, 0.0, 0.0]), about_y([0.0, 0.0, 1.0]));
    scene.gravity = about_y([g * theta.sin(), 0.0, -g * theta.cos()]);
    scene.conditions.damping = damping;
    add_plane(&mut scene, [0.0; 3], normal, Surface::Separate, friction);
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().objects[0].com;
    for _ in 0..frames {
        world.step(1.0 / 60.0, &[]);
    }
    let end = world.report().objects[0].com;
    let way = std::array::from_fn(|a| end[a] - start[a]);
    (dot(way, down), dot(way, normal))
}

#[test]
fn a_block_slides_down_an_incline_as_coulomb_says() {
    let (theta, mu) = (24.0_f64.to_radians(), 15.0_f64.to_radians().tan());
    let expected = 9.81 * (theta.sin() - mu * theta.cos());
    // The last is a plane that passes through nodes.
    for across in [24.0_f64, 10.0, 0.0] {
        let ways = [30, 60, 90].map(|frames| slide(across.to_radians(), mu, 0.0, frames));
        // Half a second apart: the second difference is the acceleration, whatever the speed at first. Measured 3e-6 to
        // 1.5e-5 off.
        let [first, second, third] = ways.map(|(along, _)| along);
        let acceleration = (third - 2.0 * second + first) / 0.25;
        let error = acceleration / expected - 1.0;
        assert!(
            error.abs() < 1e-4,
            "{across} degrees: {acceleration} m/s^2, expected {expected}"
        );
        // The load comes suddenly, so that the block rings, and where its lowest matter is up to 0.03 cells away from where
        // nodes see it, it falls first: speeds of 9.5, 3.2 and 1.2 mm/s that stay.
        let ahead = second - 0.5 * expected;
        assert!(ahead.abs() < 0.012, "{across} degrees: {ahead} m ahead");
        // Neither sinks nor lifts off by more than a fifth of a cell.
        for (_, off) in ways {
            assert!(off.abs() < 0.01, "{across} degrees: {off} m off the plane");
        }
    }
}

#[test]
fn a_block_sticks_to_an_incline_below_the_friction_angle() {
    for across in [24.0_f64, 10.0, 0.0] {
        let friction = 25.0_f64.to_radians().tan();
        // The load comes suddenly, and while the block rings it is off the plane for half of the time: it slips by 8, 12
        // and 23 mm. With finer cells it rings longer and slips farther (in half a second 9, 15 and 26 mm at cells of 5,
        // 2.5 and 1.25 cm), so that there is no figure to hold this against.
        let (along, _) = slide(across.to_radians(), friction, 0.0, 60);
        assert!(along.abs() < 0.03, "{across} degrees: slipped {along} m");
        // Damped, it stops ringing, and creeps by less than 1e-4 m/s at 95 % of what friction holds. Not so where the plane
        // lies along the grid, wherever between nodes, which is a weakness: there it creeps by 12 mm/s, and not at 90 %.
        let creep_at = |share: f64| {
            let friction = 24.0_f64.to_radians().tan() / share;
            let [before, after] =
                [60, 120].map(|frames| slide(across.to_radians(), friction, 20.0, frames).0);
            after - before
        };
        let most = if across == 0.0 { 0.015 } else { 1e-4 };
        for (share, most) in [(0.95, most), (0.9, 1e-4)] {
            let creep = creep_at(share);
            assert!(
                creep.abs() < most,
                "{across} degrees, at {share}: crept {creep} m"
            );
        }
    }
}

#[test]
fn a_resting_block_neither_sinks_nor_jitters() {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    add_box(
        &mut scene,
        elastic(Law::FixedCorotated, 1e5, 0.3),
        [0.0, 0.0, 0.0],
        0.05,
        [8, 8, 6],
    );
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.5,
    );
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().objects[0].com[2];
    for _ in 0..600 {
        world.step(1.0 / 60.0, &[]);
    }
    let settled = world.report().objects[0].com[2];
    let weight = 9.81 * world.report().objects[0].mass / 60.0;
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..120 {
        let report = world.step(1.0 / 60.0, &[]);
        let com = report.objects[0].com[2];
        (lowest, highest) = (lowest.min(com), highest.max(com));
        let force = report.objects[0].contact_impulse[2];
        assert!((force / weight - 1.0).abs() < 0.05, "{force} of {weight}");
    }
    assert!(
        (settled - start).abs() < 0.05,
        "sank from {start} to {settled}"
    );
    assert!(highest - lowest < 1e-4, "jitters by {}", highest - lowest);
    assert!(lowest > settled - 1e-3, "goes on sinking");
}

/// That of an isolated particle.
#[test]
fn the_guard_trips_above_the_critical_step_and_not_below() {
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        for (cfl, trips) in [(0.95, false), (1.05, true)] {
            let mut scene = empty(0.1);
            scene.cfl = cfl;
            add_box(
                &mut scene,
                elastic(law, 1e5, 0.3),
                [0.013, 0.024, 0.035],
                0.05,
                [1; 3],
            );
            // A rate of expansion that strains the particle by some 1e-6.
            for a in 0..3 {
                scene.objects[0].velocity_gradient[a][a] = 1e-3;
            }
            let mut world = World::new(scene).expect("valid scene");
            let mut rollbacks = 0;
            for _ in 0..40 {
                let report = world.step(1.0, &[]);
                rollbacks += report.rollbacks;
                if trips && rollbacks > 0 {
                    break;
                }
                assert!(trips || report.dt_limit == DtLimit::Sound, "{report:?}");
            }
            assert_eq!(
                rollbacks > 0,
                trips,
                "{law:?} at cfl {cfl}: {rollbacks} rollbacks"
            );
            assert!(world.deformations()[0].iter().all(|f| f.is_finite()));
        }
    }
}

#[test]
fn the_time_step_is_the_closed_form_limit() {
    let mut scene = empty(0.1);
    scene.cfl = 0.4;
    let id = add_box(
        &mut scene,
        elastic(Law::NeoHookean, 1e5, 0.3),
        [0.0; 3],
        0.05,
        [4; 3],
    );
    let m = scene.objects[id].material.clone();
    let limit = crate::materials::limits::critical_dt(&m, m.density, 0.1, &DeformationBounds::REST);
    let mut world = World::new(scene).expect("valid scene");
    let report = world.step(0.1, &[]);
    let substeps = (0.1 / (0.4 * limit)).ceil();
    assert_eq!(f64::from(report.substeps), substeps);
    assert_eq!(
        (report.dt_limit, report.dt_object),
        (DtLimit::Sound, Some(0))
    );
    assert_eq!(report.particle_updates, 64 * u64::from(report.substeps));
}
