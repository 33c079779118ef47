//! Damping: velocities decay at the stated rate, whatever the substep.

use super::*;

/// A box in free flight.
fn flight(damping: f64, gravity: f64, cfl: f64) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -gravity];
    scene.cfl = cfl;
    scene.conditions.damping = damping;
    let soft = elastic(Law::FixedCorotated, 1e5, 0.3);
    add_box(&mut scene, soft, [-0.2, -0.17, 0.06], 0.05, [8, 7, 6]);
    scene.objects[0].linear_velocity = [3.0, 0.0, 1.0];
    scene
}

#[test]
fn velocity_decays_exponentially_for_any_substep() {
    for cfl in [0.1, 0.5] {
        let mut world = World::new(flight(2.0, 0.0, cfl)).expect("valid scene");
        for _ in 0..30 {
            world.step(1.0 / 60.0, &[]);
        }
        let v = world.report().objects[0].linear_velocity;
        let left = (-2.0f64 * 0.5).exp();
        // The product of the substeps' factors is exact but for single precision: an error of 6e-8 in each of some
        // hundred substeps.
        let error = distance(v, [3.0 * left, 0.0, left]);
        assert!(error < 3.0 * 1e-5, "{v:?} at cfl {cfl}");
    }
}

#[test]
fn a_damped_fall_ends_at_gravity_over_rate() {
    let mut world = World::new(flight(5.0, 9.81, 0.5)).expect("valid scene");
    let mut dt: f64 = 0.0;
    for _ in 0..240 {
        dt = dt.max(world.step(1.0 / 60.0, &[]).dt);
    }
    let v = world.report().objects[0].linear_velocity;
    // Symplectic Euler, v <- (v + g dt) exp(-rate dt), has its fixed point at g dt / (exp(rate dt) - 1): g / rate less
    // about g dt / 2. The start has decayed by exp(-20).
    let fixed_point = -9.81 * dt / ((5.0 * dt).exp() - 1.0);
    assert!(
        (v[2] - fixed_point).abs() < 1e-4,
        "{v:?} against {fixed_point}"
    );
    assert!(v[0].abs() < 1e-4, "{v:?}");
}

#[test]
fn both_solvers_damp_alike() {
    let mut scene = flight(4.0, 9.81, 0.5);
    scene.objects[0].velocity_gradient = spin([2.0, -3.0, 1.0]);
    let mut world = World::new(scene.clone()).expect("valid scene");
    let mut reference = ReferenceWorld::new(&scene);
    for _ in 0..12 {
        let (fast, exact) = (world.step(1.0 / 60.0, &[]), reference.step(1.0 / 60.0, &[]));
        assert_eq!(fast.substeps, exact.substeps);
        let (fast, exact) = (&fast.objects[0], &exact.objects[0]);
        // Positions and velocities are near 1 and 10: what single precision leaves after a hundred substeps.
        assert!(distance(fast.com, exact.com) < 1e-5, "{fast:?} {exact:?}");
        assert!(
            distance(fast.linear_velocity, exact.linear_velocity) < 1e-4,
            "{fast:?} {exact:?}"
        );
        assert!(
            distance(fast.angular_momentum, exact.angular_momentum)
                < 1e-3 * norm(exact.angular_momentum)
        );
    }
}
