//! Bodies on bodies: towers, light below heavy, edges that cross, captures.

use super::*;
use crate::{
    rotation::{from_rotation_vector, product},
    scene::{Collider, ColliderShape, Pose},
};

const G: f64 = 9.81;

/// Farthest that a body of a stage goes in some seconds [m].
fn farthest(stage: &mut Stage, seconds: f64) -> f64 {
    let start = stage.bodies.clone();
    let mut most = 0.0_f64;
    for _ in 0..(60.0 * seconds) as usize {
        stage.step(1.0 / 60.0);
        for (body, start) in stage.bodies.iter().zip(&start) {
            most = most.max(length(sub(body.com, start.com)));
        }
    }
    most
}

fn on_floor() -> Stage {
    let mut stage = Stage::new([0.0, 0.0, -G]);
    stage.plane([0.0, 0.0, 1.0], 0.5, 0.0);
    stage.surface = (0.0, 0.5);
    stage
}

#[test]
fn towers_stand_for_twenty_seconds() {
    for count in [10, 20] {
        let mut stage = on_floor();
        for n in 0..count {
            stage.add(&block([0.0, 0.0, 0.05 + 0.1 * f64::from(n)], 0.05, [2; 3]));
        }
        // Its first load presses it together by a tenth of a millimetre.
        for _ in 0..60 {
            stage.step(1.0 / 60.0);
        }
        let drift = farthest(&mut stage, 20.0);
        assert!(drift < 1e-3, "{count}: {drift}");
    }
}

#[test]
fn what_is_light_bears_what_is_heavy() {
    for ratio in [300.0, 700.0, 1000.0] {
        let mut stage = on_floor();
        stage.add(&block([0.0, 0.0, 0.05], 0.05, [2; 3]));
        let mut heavy = block([0.0, 0.0, 0.15], 0.05, [2; 3]);
        for g in &mut heavy {
            g.mass *= ratio;
        }
        stage.add(&heavy);
        let drift = farthest(&mut stage, 5.0);
        assert!(drift < 1e-3, "{ratio}: {drift}");
    }
}

#[test]
fn a_steel_plate_stands_on_four_corks() {
    let mut stage = on_floor();
    for (x, y) in [(-0.2, -0.2), (-0.2, 0.2), (0.2, -0.2), (0.2, 0.2)] {
        let mut cork = drum([x, y, 0.05], 0.03, 0.05, 0.01);
        for g in &mut cork {
            g.mass *= 0.24;
        }
        stage.add(&cork);
    }
    let mut plate = block([0.0, 0.0, 0.125], 0.025, [20, 20, 2]);
    for g in &mut plate {
        g.mass *= 7.8;
    }
    stage.add(&plate);
    let drift = farthest(&mut stage, 5.0);
    assert!(drift < 1e-3, "{drift}");
}

/// The lower gets `m v (1 + e) / (2 + m s^2 / I)` at a place `s` off its middle along its length, and turns by that.
#[test]
fn edges_of_bodies_that_cross_push_along_their_cross_product() {
    for (e, spin) in [(1.0, -5.217), (0.5, -3.913)] {
        let mut stage = Stage::new([0.0; 3]);
        stage.surface = (e, 0.0);
        let quarter = std::f64::consts::FRAC_PI_4;
        let boxes = [
            ([8, 4, 4], [0.0; 3], [quarter, 0.0, 0.0], 0.0),
            (
                [4, 4, 8],
                [0.05, 0.382_842_712_474_619, 0.05],
                [0.0, 0.0, quarter],
                -2.0,
            ),
        ];
        for (cells, com, turn, speed) in boxes {
            let id = stage.add(&block([0.0; 3], 0.05, cells));
            let body = &mut stage.bodies[id];
            body.com = com;
            body.rotation = product(from_rotation_vector(turn), body.rotation);
            body.velocity = [0.0, speed, 0.0];
        }
        for _ in 0..6 {
            stage.step(1.0 / 60.0);
        }
        let lower = &stage.bodies[0];
        let found = lower.spin(&stage.shapes[0].inertia);
        assert!((found[2] / spin - 1.0).abs() < 1e-3, "{e}: {found:?}");
        let [x, _, z] = lower.velocity;
        assert!(x.hypot(z) < 1e-6, "{e}: {:?}", lower.velocity);
    }
}

/// A bowl, and a bent piece: nothing that has a form of its own.
fn captures() -> [(&'static str, Vec<Grain>); 2] {
    let bowl = carved([0.0; 3], 0.02, [20; 3], |r| {
        let out = length(r);
        (0.13..0.2).contains(&out) && r[2] < 0.0 && r[2] > -0.19
    });
    let bent = carved([0.0; 3], 0.02, [16, 10, 16], |r| {
        r[0] < -0.06 || r[2] < -0.06
    });
    [("bowl", bowl), ("bent", bent)]
}

#[test]
fn captures_stand_on_floors_on_boxes_and_on_each_other() {
    for (name, grains) in captures() {
        let mut stage = on_floor();
        stage.add(&block([0.0, 0.0, 0.1], 0.05, [20, 20, 4]));
        for (n, height) in [(0.0, 0.2), (2.0, 0.0)] {
            let id = stage.add(&grains);
            let lowest = grains.iter().map(|g| g.x[2]).fold(f64::INFINITY, f64::min);
            stage.bodies[id].com[0] += n;
            stage.bodies[id].com[2] += height + 0.01 - lowest + 1e-3;
        }
        for _ in 0..120 {
            stage.step(1.0 / 60.0);
        }
        let drift = farthest(&mut stage, 5.0);
        // A twentieth of a cell of its field, 0.02 m.
        assert!(drift < 1e-3, "{name}: {drift}");
        // As high over the floor as over the box.
        let up = stage.bodies[1].com[2] - stage.bodies[2].com[2];
        assert!((up - 0.2).abs() < 1e-3, "{name}: {up}");
    }
    let mut stage = on_floor();
    let [(_, bowl), _] = captures();
    for n in 0..3 {
        let id = stage.add(&bowl);
        stage.bodies[id].com[2] = 0.15 + 0.1 * f64::from(n);
    }
    for _ in 0..180 {
        stage.step(1.0 / 60.0);
    }
    let drift = farthest(&mut stage, 2.0);
    // They rock in each other.
    assert!(drift < 3e-3, "stacked: {drift}");
    let heights: Vec<f64> = stage.bodies.iter().map(|body| body.com[2]).collect();
    assert!(heights.is_sorted_by(|a, b| b - a > 0.04), "{heights:?}");
}

/// The same state gives the same bits, whatever was before it.
#[test]
fn bits_depend_on_nothing_but_the_state() {
    let fresh = || {
        let mut stage = on_floor();
        for n in 0..5 {
            let at = [0.01 * f64::from(n % 2), 0.0, 0.06 + 0.11 * f64::from(n)];
            stage.add(&block(at, 0.05, [2; 3]));
        }
        let [_, (_, bent)] = captures();
        let id = stage.add(&bent);
        stage.bodies[id].com = [0.5, 0.0, 0.3];
        stage
    };
    let mut one = fresh();
    for _ in 0..30 {
        one.step(1.0 / 60.0);
    }
    let mut other = fresh();
    other.bodies.clone_from(&one.bodies);
    other.memory.clone_from(&one.memory);
    assert!(!other.memory.is_empty());
    for _ in 0..30 {
        one.step(1.0 / 60.0);
        other.step(1.0 / 60.0);
    }
    assert_eq!(one.bodies, other.bodies);
    assert_eq!(one.memory, other.memory);
}

/// A plank on a round bar, with 1 kg at 0.4 m and 2 kg at 0.23 m on the other side.
#[test]
fn a_seesaw_falls_to_the_side_of_the_larger_moment() {
    let mut stage = Stage::new([0.0, 0.0, -G]);
    stage.surface = (0.0, 0.8);
    let bar = ColliderShape::Cylinder {
        radius: 0.1,
        half_height: 0.5,
    };
    let at = Pose::at([0.0, 0.0, -0.1]);
    stage.scene.colliders.push(Collider {
        friction: Some(0.8),
        ..Collider::fixed("bar", bar, at, Surface::Separate)
    });
    let mut plank = block([0.0, 0.0, 0.025], 0.025, [48, 8, 2]);
    for g in &mut plank {
        g.mass *= 0.5;
    }
    let plank = stage.add(&plank);
    for (x, density) in [(0.4, 1.0), (-0.23, 2.0)] {
        let mut load = block([x, 0.0, 0.1], 0.025, [4; 3]);
        for g in &mut load {
            g.mass *= density;
        }
        stage.add(&load);
    }
    for _ in 0..12 {
        stage.step(1.0 / 60.0);
    }
    let spin = stage.bodies[plank].spin(&stage.shapes[plank].inertia);
    let found = -spin[1] / stage.time;
    // The moment over the inertia about the line of contact, [0, 1, 0].
    assert!((found / 0.574 - 1.0).abs() < 0.05, "{found}: {spin:?}");
}
