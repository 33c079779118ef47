//! What lies on a collider that moves goes along with it.

use super::*;
use crate::{
    mat3::cross,
    scene::{Collider, ColliderMotion, ColliderShape, Pose, Solver, TimeSpan},
};

const GRAVITY: f64 = 10.0;

/// A block of elastic matter at rest on a slab that moves.
fn on_slab(frame_rate: f64, linear: [f64; 3], angular: [f64; 3], away: f64) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -GRAVITY];
    scene.frame_rate = frame_rate;
    let material = elastic(Law::NeoHookean, 1e5, 0.3);
    let id = add_box(
        &mut scene,
        material,
        [away - 0.2, -0.2, 0.0],
        0.05,
        [8, 8, 6],
    );
    let object = &mut scene.objects[id];
    object.solver = Solver::Lagrangian;
    // It moves as the slab does.
    object.linear_velocity = cross(angular, [away, 0.0, 0.0]);
    for a in 0..3 {
        object.linear_velocity[a] += linear[a];
    }
    object.velocity_gradient = spin(angular);
    let shape = ColliderShape::Box {
        half_extents: [4.0, 4.0, 0.5],
    };
    let slab = Pose::at([0.0, 0.0, -0.5]);
    scene.colliders.push(Collider {
        friction: Some(0.8),
        motion: ColliderMotion::Velocity {
            linear,
            angular,
            span: TimeSpan::ALWAYS,
        },
        ..Collider::fixed("slab", shape, slab, Surface::Separate)
    });
    scene
}

/// Sand that falls elsewhere: solids then move in spans as short as its substeps.
fn add_sand(scene: &mut Scene) {
    let law = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 0.0,
    };
    add_box(
        scene,
        elastic(law, 1e5, 0.2),
        [0.0, 6.0, 8.0],
        0.05,
        [2, 2, 2],
    );
}

#[test]
fn a_belt_takes_a_block_along_at_any_frame_rate() {
    let speed = 0.5;
    for frame_rate in [60.0, 200.0, 1000.0] {
        for beside_sand in [false, true] {
            for surface in [Surface::Separate, Surface::Sticky] {
                let mut scene = on_slab(frame_rate, [speed, 0.0, 0.0], [0.0; 3], 0.0);
                scene.colliders[0].surface = surface;
                if beside_sand {
                    add_sand(&mut scene);
                }
                let mut world = World::new(scene).expect("valid");
                let start = world.report().objects[0].com;
                let frames = (0.3 * frame_rate) as u32;
                for _ in 0..frames {
                    world.step(1.0 / frame_rate, &[]);
                }
                let end = world.report().objects[0];
                let behind = start[0] + 0.3 * speed - end.com[0];
                let case = (frame_rate, beside_sand, surface);
                // A hundredth of a cell; one substep per frame without a hold was 3 to 150 mm.
                assert!(behind.abs() < 1e-3, "{case:?}: {behind}");
                let slower = end.linear_velocity[0] - speed;
                assert!(slower.abs() < 0.01 * speed, "{case:?}: {slower}");
            }
        }
    }
}

#[test]
fn a_turntable_keeps_a_block_where_it_is_on_it() {
    let (spin, away) = (1.5, 1.0);
    for frame_rate in [60.0, 1000.0] {
        for surface in [Surface::Separate, Surface::Sticky] {
            let mut scene = on_slab(frame_rate, [0.0; 3], [0.0, 0.0, spin], away);
            scene.colliders[0].surface = surface;
            let mut world = World::new(scene).expect("valid");
            let frames = (0.4 * frame_rate) as u32;
            for _ in 0..frames {
                world.step(1.0 / frame_rate, &[]);
            }
            let end = world.report().objects[0];
            let [x, y, _] = end.com;
            let case = (frame_rate, surface);
            // It leans outwards by its elasticity, rho w^2 r h^2 / 3 G of 2 mm, and swings by as much again; with springs of friction it is 5.4 mm.
            assert!((x.hypot(y) - away).abs() < 6e-3, "{case:?}: {x} {y}");
            let turned = y.atan2(x);
            assert!(
                (turned - 0.4 * spin).abs() < 2e-3,
                "{case:?}: {turned} {}",
                0.4 * spin
            );
        }
    }
}
