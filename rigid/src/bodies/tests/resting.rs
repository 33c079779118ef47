//! Sliding, rolling, lying still.

use super::*;
use crate::{
    rotation::from_rotation_vector,
    scene::{Collider, ColliderMotion, ColliderShape, Pose, TimeSpan},
};

const G: f64 = 9.81;

/// Gravity as on an incline of `angle` [rad] down x.
fn on_incline(angle: f64) -> Vec3 {
    [G * angle.sin(), 0.0, -G * angle.cos()]
}

#[test]
fn a_block_on_an_incline_slides_or_sticks() {
    let angle = 24.0_f64.to_radians();
    for friction in [15.0_f64.to_radians().tan(), 0.6] {
        let mut stage = Stage::new(on_incline(angle));
        stage.plane([0.0, 0.0, 1.0], friction, 0.0);
        let id = stage.add(&block([0.0, 0.0, 0.1], 0.05, [6, 6, 4]));
        for _ in 0..120 {
            stage.step(1.0 / 60.0);
        }
        let way = stage.bodies[id].com[0];
        let slide = (G * (angle.sin() - friction * angle.cos())).max(0.0);
        let expected = 0.5 * slide * 4.0;
        assert!(
            // What sticks creeps by a ten-millionth of a metre: contact of the solver is soft.
            (way - expected).abs() < 1e-3 * expected.max(1e-3),
            "{way} {expected}"
        );
        assert!((stage.bodies[id].com[2] - 0.1).abs() < 1e-6);
    }
}

/// Laid down or dropped.
#[test]
fn a_ball_on_an_incline_rolls_or_slips() {
    let angle = 45.0_f64.to_radians();
    let radius = 0.5;
    for friction in [0.1, 0.2, 0.5] {
        for drop in [0.0, 1.1 * DX] {
            let mut stage = Stage::new(on_incline(angle));
            stage.plane([0.0, 0.0, 1.0], friction, 0.0);
            let id = stage.add(&ball([0.0; 3], radius, 0.05));
            let r = stage.shapes[id].radius;
            stage.bodies[id].com = [0.0, 0.0, r + drop];
            // Until it lands it falls down the slope as well.
            let landing = (2.0 * drop / (G * angle.cos())).sqrt();
            while stage.time < landing {
                stage.step(1.0 / 240.0);
            }
            let begin = stage.bodies[id];
            let time = stage.time;
            for _ in 0..240 {
                stage.step(1.0 / 240.0);
            }
            let t = stage.time - time;
            let body = &stage.bodies[id];
            let way = body.com[0] - begin.com[0] - t * begin.velocity[0];
            let (normal, down) = (G * angle.cos(), G * angle.sin());
            let spin = |b: &Body| b.spin(&stage.shapes[id].inertia)[1];
            let sticks = friction >= 2.0 / 7.0 * angle.tan();
            if sticks && drop == 0.0 {
                let expected = 5.0 / 14.0 * down * t * t;
                assert!((way / expected - 1.0).abs() < 0.005, "{way} {expected}");
                // Normal and friction are solved one after the other, eight times in a step.
                let slip = spin(body) * r / body.velocity[0] - 1.0;
                assert!(slip.abs() < 1e-3, "{slip}");
            } else if !sticks {
                let expected = 0.5 * (down - friction * normal) * t * t;
                assert!((way / expected - 1.0).abs() < 0.005, "{way} {expected}");
                let expected = 2.5 * friction * normal * t / r;
                let found = spin(body) - spin(&begin);
                assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
            } else {
                // Landed with slip, it ends up rolling.
                let slip = spin(body) * r / body.velocity[0] - 1.0;
                assert!(slip.abs() < 1e-3, "{slip}");
            }
        }
    }
}

/// Largest way that a body of a stage that has settled for a second goes in `frames` sixtieths of one [m].
fn drift(stage: &mut Stage, frames: usize) -> f64 {
    for _ in 0..60 {
        stage.step(1.0 / 60.0);
    }
    let start = stage.bodies.clone();
    for _ in 0..frames {
        stage.step(1.0 / 60.0);
    }
    let ways = stage.bodies.iter().zip(&start);
    ways.map(|(b, s)| length(sub(b.com, s.com)))
        .fold(0.0, f64::max)
}

#[test]
fn a_stack_of_five_rests() {
    let mut stage = Stage::new([0.0, 0.0, -G]);
    stage.plane([0.0, 0.0, 1.0], 0.5, 0.3);
    stage.surface = (0.3, 0.5);
    for n in 0..5 {
        let z = 0.1 + 0.2 * f64::from(n) + 1e-3 * f64::from(n);
        let aside = 0.01 * f64::from(n % 2);
        stage.add(&block([aside, 0.0, z], 0.05, [4, 4, 4]));
    }
    let drift = drift(&mut stage, 300);
    assert!(drift < 0.01 * DX, "{drift}");
    let fastest = stage
        .bodies
        .iter()
        .map(|b| length(b.velocity))
        .fold(0.0, f64::max);
    // It trembles by some micrometres.
    assert!(fastest < 2e-3, "{fastest:e}");
}

#[test]
fn a_hundred_times_the_mass_rests_on_a_small_block() {
    let mut stage = Stage::new([0.0, 0.0, -G]);
    stage.plane([0.0, 0.0, 1.0], 0.5, 0.0);
    stage.surface = (0.0, 0.5);
    stage.add(&block([0.0, 0.0, 0.1], 0.05, [4, 4, 4]));
    let mut heavy = block([0.0, 0.0, 0.3], 0.05, [4, 4, 4]);
    for g in &mut heavy {
        g.mass *= 100.0;
    }
    stage.add(&heavy);
    let drift = drift(&mut stage, 3600);
    assert!(drift < 0.01 * DX, "{drift}");
    assert!(
        (stage.bodies[1].com[2] - 0.3).abs() < 0.05 * DX,
        "{:?}",
        stage.bodies[1]
    );
}

/// What a box lies on that turns about z.
#[derive(Clone, Copy, Debug)]
enum Turntable {
    Collider,
    /// A body that is moved.
    Moved,
    /// A heavy body that turns on its own.
    Free,
}

#[test]
fn what_sticks_to_a_turntable_stays_where_it_is_on_it() {
    let spin = 1.5;
    for turntable in [Turntable::Collider, Turntable::Moved, Turntable::Free] {
        for rate in [60.0, 240.0] {
            let mut stage = Stage::new([0.0, 0.0, -G]);
            stage.surface = (0.0, 0.5);
            let id = stage.add(&block([1.0, 0.0, 0.05], 0.05, [2, 2, 2]));
            match turntable {
                Turntable::Collider => {
                    let shape = ColliderShape::Box {
                        half_extents: [2.0, 2.0, 0.1],
                    };
                    let at = Pose::at([0.0, 0.0, -0.1]);
                    stage.scene.colliders.push(Collider {
                        friction: Some(0.5),
                        motion: ColliderMotion::Velocity {
                            linear: [0.0; 3],
                            angular: [0.0, 0.0, spin],
                            span: TimeSpan::ALWAYS,
                        },
                        ..Collider::fixed("table", shape, at, Surface::Separate)
                    });
                }
                Turntable::Moved | Turntable::Free => {
                    let table = stage.add(&block([0.0, 0.0, -0.25], 0.5, [8, 8, 1]));
                    let inertia = stage.shapes[table].inertia;
                    stage.bodies[table].set_spin(&inertia, [0.0, 0.0, spin]);
                    if matches!(turntable, Turntable::Moved) {
                        stage.drives[table] = Drive::Kinematic {
                            velocity: [0.0; 3],
                            spin: [0.0, 0.0, spin],
                        };
                    } else {
                        stage.plane([0.0, 0.0, 1.0], 0.0, 0.0);
                        stage.scene.colliders[0].pose.translation[2] = -0.5;
                    }
                }
            }
            let inertia = stage.shapes[id].inertia;
            stage.bodies[id].velocity = [0.0, spin, 0.0];
            stage.bodies[id].set_spin(&inertia, [0.0, 0.0, spin]);
            for _ in 0..rate as u32 {
                stage.step(1.0 / rate);
            }
            let center = match turntable {
                Turntable::Free => stage.bodies[1].com,
                _ => [0.0; 3],
            };
            let [x, y, _] = sub(stage.bodies[id].com, center);
            let case = (turntable, rate);
            // Velocities of the start of a step would take it 1.2 mm outwards. What is left is friction that follows the turn.
            assert!((x.hypot(y) - 1.0).abs() < 5e-4, "{case:?}: {}", x.hypot(y));
            // A body that turns on its own is slowed by what it carries.
            if !matches!(turntable, Turntable::Free) {
                let turned = y.atan2(x).rem_euclid(std::f64::consts::TAU);
                assert!((turned - spin).abs() < 1e-3, "{case:?}: {turned}");
            }
            let own = stage.bodies[id].spin(&inertia)[2];
            let below = stage.bodies.get(1).zip(stage.shapes.get(1));
            let below = below.map_or(spin, |(body, shape)| body.spin(&shape.inertia)[2]);
            // Two free bodies share the torque of forces at points that move with one of them.
            let most = if matches!(turntable, Turntable::Free) {
                0.01
            } else {
                1e-3
            };
            assert!((own - below).abs() < most, "{case:?}: {own} on {below}");
        }
    }
}

/// What is round about the axis of a cylinder ends with it: a box on the lid is near the axis, and far from the side.
#[test]
fn a_box_lies_still_on_a_lid_wherever_it_is_on_it() {
    for x in [0.0, 0.3, 1.0, 1.9, 1.97] {
        for friction in [0.0, 0.5] {
            let mut stage = Stage::new([0.0, 0.0, -G]);
            let id = stage.add(&block([x, 0.0, 0.05], 0.05, [2, 2, 2]));
            let lid = ColliderShape::Cylinder {
                radius: 2.0,
                half_height: 0.2,
            };
            let at = Pose {
                translation: [0.0, 0.0, -0.2],
                rotation: from_rotation_vector([std::f64::consts::FRAC_PI_2, 0.0, 0.0]),
            };
            stage.scene.colliders.push(Collider {
                friction: Some(friction),
                ..Collider::fixed("lid", lid, at, Surface::Separate)
            });
            let start = stage.bodies[id].com;
            for _ in 0..120 {
                stage.step(1.0 / 60.0);
            }
            let way = sub(stage.bodies[id].com, start);
            // It went outwards by a tenth of a metre in two seconds. Overlap of rest is a ten-thousandth of a cell.
            assert!(length(way) < 1e-4, "{x} with {friction}: {way:?}");
        }
    }
}

/// Under a ceiling that sticks, and on a wall that slips, both pulled away from it.
#[test]
fn what_colliders_hold_stays_on_them() {
    for (surface, normal, gravity) in [
        (Surface::Sticky, [0.0, 0.0, -1.0], [0.0, 1.0, -G]),
        (Surface::Slip, [1.0, 0.0, 0.0], [2.0, 0.0, -G]),
    ] {
        let mut stage = Stage::new(gravity);
        add_plane(&mut stage.scene, [0.0; 3], normal, surface, 0.0);
        let id = stage.add(&block(normal.map(|n| 0.1 * n), 0.05, [4; 3]));
        let start = stage.bodies[id].com;
        let seconds = 0.5;
        for _ in 0..30 {
            stage.step(1.0 / 60.0);
        }
        let way = sub(stage.bodies[id].com, start);
        let expected = match surface {
            Surface::Sticky => [0.0; 3],
            _ => [0.0, 0.0, -0.5 * G * seconds * seconds],
        };
        let error = length(sub(way, expected));
        // A joint gives way by its own softness, and what falls is taken half an iteration late.
        assert!(error < 2e-3, "{surface:?}: {way:?} for {expected:?}");
    }
}
