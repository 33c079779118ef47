//! What nothing touches.

use super::*;

#[test]
fn a_thrown_body_flies_a_parabola() {
    let mut stage = Stage::new([0.3, 0.0, -9.81]);
    let id = stage.add(&block([1.0, 2.0, 30.0], 0.1, [4, 3, 2]));
    stage.bodies[id].velocity = [3.0, -1.0, 10.0];
    let (start, v) = (stage.bodies[id].com, stage.bodies[id].velocity);
    for _ in 0..120 {
        stage.step(1.0 / 60.0);
    }
    let t = 2.0;
    for a in 0..3 {
        let expected = start[a] + t * v[a] + 0.5 * t * t * stage.scene.gravity[a];
        let error = stage.bodies[id].com[a] - expected;
        // Round-off of some hundred sums of numbers of order 10.
        assert!(error.abs() < 1e-12, "{error:e}");
    }
}

#[test]
fn a_tumbling_body_keeps_its_energy_and_angular_momentum() {
    let (shape, mut body) = formed(&block([0.0; 3], 0.1, [9, 6, 3])).expect("has mass");
    body.set_spin(&shape.inertia, [3.0, 4.0, 2.0]);
    let energy = body.kinetic_energy(&shape.inertia);
    let momentum = body.angular_momentum;
    let spin = body.spin(&shape.inertia);
    let mut wandered = 0.0_f64;
    for _ in 0..100_000 {
        body = body.after(&shape.inertia, [0.0; 3], [0.0; 3], 1e-3);
        wandered = wandered.max(length(sub(body.spin(&shape.inertia), spin)));
    }
    // No axis of symmetry: the spin wanders, so this is no steady state.
    assert!(wandered > 1.0, "{wandered}");
    assert_eq!(body.angular_momentum, momentum);
    let error = body.kinetic_energy(&shape.inertia) / energy - 1.0;
    // A random walk of round-off: 1.1e-16 times the root of 1e5 steps, a few roundings each.
    assert!(error.abs() < 3e-13, "{error:e}");
}

#[test]
fn a_turn_that_nothing_resolves_keeps_energy_and_momentum() {
    let (shape, begin) = formed(&block([0.0; 3], 0.1, [9, 6, 3])).expect("has mass");
    // From 60 times over in a step to what the frame of no scene resolves.
    for spin in [4e5, 1e9, 1e15] {
        let mut body = begin;
        body.set_spin(&shape.inertia, [0.8 * spin, spin, 0.1 * spin]);
        let energy = body.kinetic_energy(&shape.inertia);
        let (momentum, rotation) = (body.angular_momentum, body.rotation);
        for _ in 0..1000 {
            body = body.after(&shape.inertia, [0.0; 3], [0.0; 3], 1e-3);
        }
        assert_eq!(body.angular_momentum, momentum);
        assert_ne!(body.rotation, rotation);
        let error = body.kinetic_energy(&shape.inertia) / energy - 1.0;
        // Round-off of 1000 products of quaternions.
        assert!(error.abs() < 1e-12, "{spin}: {error:e}");
    }
}

#[test]
fn a_steady_spin_turns_as_far_as_it_says() {
    let (shape, mut body) = formed(&block([0.0; 3], 0.1, [9, 6, 3])).expect("has mass");
    // About an axis of inertia.
    body.set_spin(&shape.inertia, [0.0, 10.0, 0.0]);
    let start = body.point([0.3, 0.2, 0.1]);
    for _ in 0..240 {
        body = body.after(&shape.inertia, [0.0; 3], [0.0; 3], 1.0 / 240.0);
    }
    let (sin, cos) = 10.0_f64.sin_cos();
    let [x, y, z] = sub(start, body.com);
    let expected = [cos * x + sin * z, y, cos * z - sin * x];
    let error = length(sub(sub(body.point([0.3, 0.2, 0.1]), body.com), expected));
    // Round-off of 240 products of quaternions; the midpoint rule itself is late by 1.4e-3 rad here.
    assert!(error < 1e-13, "{error:e}");
}

#[test]
fn a_symmetric_top_precesses_as_in_closed_form() {
    let (shape, mut body) = formed(&block([0.0; 3], 0.1, [3, 3, 6])).expect("has mass");
    let axis = (0..3)
        .max_by(|&a, &b| {
            let of = |n: usize| {
                let m = shape.inertia.moments;
                let others = 0.5 * (m.iter().sum::<f64>() - m[n]);
                (m[n] - others).abs()
            };
            of(a).total_cmp(&of(b))
        })
        .expect("three axes");
    body.set_spin(&shape.inertia, [1.0, 0.5, 4.0]);
    let symmetry = |body: &Body| {
        let mut own = [0.0; 3];
        own[axis] = 1.0;
        sub(body.point(own), body.com)
    };
    // The axis turns about the angular momentum at L / I across.
    let across = shape.inertia.moments[(axis + 1) % 3];
    let rate = length(body.angular_momentum) / across;
    let start = symmetry(&body);
    let period = 2.0 * std::f64::consts::PI / rate;
    for _ in 0..2000 {
        body = body.after(&shape.inertia, [0.0; 3], [0.0; 3], period / 2000.0);
    }
    // Second order: of the order of (w dt)^2 of a turn, with up to 4 rad/s in 2000 steps of 1.5 s.
    let error = length(sub(symmetry(&body), start));
    assert!(error < 1e-4, "{error:e}");
}
