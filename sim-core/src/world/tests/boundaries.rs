//! Laws and stories of colliders: rest, friction, restitution, moving walls, walls thinner than a cell.

use std::sync::Arc;

use super::*;
use crate::{
    scene::{Collider, ColliderMotion, ColliderShape, Pose, TimeSpan, TriangleMesh},
    test_scenes::box_mesh,
};

const DX: f64 = 0.1;
const FRAME: f64 = 1.0 / 60.0;

/// A jelly cube of 0.4 m whose bottom is `gap` above z = 0, without gravity or boundaries.
fn cube(gap: f64) -> Scene {
    let mut scene = empty(DX);
    let jelly = elastic(Law::FixedCorotated, 1e5, 0.3);
    add_box(&mut scene, jelly, [-0.2, -0.2, gap], 0.05, [8; 3]);
    scene
}

fn turned_to_z() -> [f64; 4] {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    [half, 0.0, 0.0, half]
}

/// Every shape with its highest point at z = 0 below the cube, wide enough to carry it.
fn supports() -> Vec<(&'static str, ColliderShape, Pose)> {
    let at = |z: f64| Pose::at([0.0, 0.0, z]);
    let upright = |z: f64| Pose {
        rotation: turned_to_z(),
        ..at(z)
    };
    vec![
        (
            "half-space",
            ColliderShape::HalfSpace {
                normal: [0.0, 0.0, 1.0],
            },
            at(0.0),
        ),
        (
            "box",
            ColliderShape::Box {
                half_extents: [0.6, 0.6, 0.3],
            },
            at(-0.3),
        ),
        (
            "thin box",
            ColliderShape::Box {
                half_extents: [0.6, 0.6, 0.005],
            },
            at(-0.005),
        ),
        ("sphere", ColliderShape::Sphere { radius: 2.0 }, at(-2.0)),
        (
            "cylinder",
            ColliderShape::Cylinder {
                radius: 0.7,
                half_height: 0.3,
            },
            upright(-0.3),
        ),
        (
            "capsule",
            ColliderShape::Capsule {
                radius: 1.5,
                half_height: 0.5,
            },
            at(-1.5),
        ),
        (
            "mesh",
            ColliderShape::Mesh(Arc::new(slab(0.6, 0.6))),
            at(0.0),
        ),
        (
            "thin mesh",
            ColliderShape::Mesh(Arc::new(slab(0.6, 0.01))),
            at(0.0),
        ),
        ("sheet", ColliderShape::Mesh(Arc::new(sheet(0.6))), at(0.0)),
    ]
}

/// A closed box with its top at z = 0.
fn slab(half: f64, thickness: f64) -> TriangleMesh {
    let mut mesh = box_mesh([half, half, 0.5 * thickness]);
    for point in &mut mesh.points {
        point[2] -= 0.5 * thickness;
    }
    mesh
}

/// An open square at z = 0.
fn sheet(half: f64) -> TriangleMesh {
    TriangleMesh {
        points: vec![
            [-half, -half, 0.0],
            [half, -half, 0.0],
            [half, half, 0.0],
            [-half, half, 0.0],
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

fn lowest(world: &World) -> f64 {
    let heights = world.positions().iter().map(|x| f64::from(x[2]));
    heights.fold(f64::INFINITY, f64::min)
}

#[test]
fn a_cube_rests_on_every_shape_with_its_weight() {
    for (name, shape, pose) in supports() {
        let mut scene = cube(0.05);
        scene.gravity = [0.0, 0.0, -9.81];
        scene.colliders.push(Collider {
            friction: Some(0.5),
            ..Collider::fixed(name, shape, pose, Surface::Separate)
        });
        let mut world = World::new(scene).expect("valid scene");
        let (mut impulse, mut time) = (0.0, 0.0);
        for frame in 0..150 {
            let report = world.step(FRAME, &[]);
            assert!(report.left_domain.is_empty() && report.quarantined.is_empty());
            if frame >= 90 {
                impulse += report.objects[0].contact_impulse[2];
                time += FRAME;
            }
        }
        let state = world.report().objects[0];
        // What bouncing is left after 1.5 s changes the mean force over the last second by a few percent.
        let weight = impulse / (time * state.mass * 9.81);
        assert!((weight - 1.0).abs() < 0.06, "{name}: {weight}");
        // It fell onto it at 1 m/s.
        assert!(norm(state.linear_velocity) < 0.3, "{name}: {state:?}");
        // It stands on the top: its own weight squeezes it by 8 mm, the grid lets it sink by up to half a cell.
        let height = state.com[2];
        assert!((0.14..0.26).contains(&height), "{name}: {height}");
        assert!(
            norm([state.com[0], state.com[1], 0.0]) < 0.05,
            "{name}: {state:?}"
        );
    }
}

/// How far a stiff cube slides down a slope of 24 degrees in one second, and how far Coulomb says.
fn slide_down(shape: &ColliderShape, top: f64) -> [f64; 2] {
    let angle = 24_f64.to_radians();
    let friction = 15_f64.to_radians().tan();
    let mut scene = cube(0.005);
    scene.objects[0].material.youngs_modulus = 1e6;
    scene.gravity = [9.81 * angle.sin(), 0.0, -9.81 * angle.cos()];
    scene.objects[0].linear_velocity = [1.0, 0.0, 0.0];
    let pose = Pose::at([0.0, 0.0, top]);
    scene.colliders.push(Collider {
        friction: Some(friction),
        ..Collider::fixed("slope", shape.clone(), pose, Surface::Separate)
    });
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().objects[0].com[0];
    for _ in 0..60 {
        world.step(FRAME, &[]);
    }
    let acceleration = 9.81 * (angle.sin() - friction * angle.cos());
    let moved = world.report().objects[0].com[0] - start;
    [moved, 1.0 + 0.5 * acceleration]
}

#[test]
fn friction_on_walls_thinner_than_a_cell_is_coulombs() {
    let normal = [0.0, 0.0, 1.0];
    let thick = slide_down(&ColliderShape::HalfSpace { normal }, 0.0);
    let half_extents = [9.0, 9.0, 0.005];
    let thin = slide_down(&ColliderShape::Box { half_extents }, -0.005);
    let sheet = ColliderShape::Mesh(Arc::new(sheet(9.0)));
    let sheet = slide_down(&sheet, 0.0);
    let all = [thick, thin, sheet];
    for [moved, expected] in all {
        // The gate of the validation suite for friction on the grid.
        assert!((moved / expected - 1.0).abs() < 0.01, "{all:?}");
    }
}

#[test]
fn restitution_gives_back_its_part_of_the_speed() {
    for restitution in [0.25, 0.5, 1.0] {
        let mut scene = empty(DX);
        scene.gravity = [0.0, 0.0, -9.81];
        let jelly = elastic(Law::FixedCorotated, 1e5, 0.3);
        add_box(&mut scene, jelly, [0.01, 0.02, 0.5], 0.05, [1; 3]);
        scene.colliders.push(Collider {
            restitution,
            ..Collider::fixed(
                "floor",
                ColliderShape::HalfSpace {
                    normal: [0.0, 0.0, 1.0],
                },
                Pose::IDENTITY,
                Surface::Separate,
            )
        });
        let mut world = World::new(scene).expect("valid scene");
        let (mut fall, mut rise) = (0.0_f64, 0.0_f64);
        for _ in 0..60 {
            let v = world.step(FRAME, &[]).objects[0].linear_velocity[2];
            fall = fall.min(v);
            rise = rise.max(v);
        }
        // Heights of frames, not of the contact: a frame of gravity may be missing at either end.
        let slack = 9.81 * FRAME * (1.0 + restitution);
        assert!((rise + restitution * fall).abs() < slack, "{fall} {rise}");
        assert!(rise > 0.9 * restitution * 3.13 - slack, "{rise}");
    }
}

/// At the largest speed.
#[test]
fn nothing_passes_a_wall_of_a_tenth_of_a_cell() {
    let shapes = [
        ColliderShape::Box {
            half_extents: [2.0, 2.0, 0.005],
        },
        ColliderShape::Mesh(Arc::new(sheet(2.0))),
        ColliderShape::Cylinder {
            radius: 2.0,
            half_height: 0.005,
        },
    ];
    for shape in shapes {
        let upright = matches!(shape, ColliderShape::Cylinder { .. });
        let mut scene = cube(0.3);
        // 40 m/s: the substep is limited by the speed, half a cell each, five times the wall.
        scene.objects[0].linear_velocity = [1.0, 0.0, -40.0];
        let pose = Pose {
            rotation: if upright {
                turned_to_z()
            } else {
                [0.0, 0.0, 0.0, 1.0]
            },
            translation: [0.0; 3],
        };
        scene
            .colliders
            .push(Collider::fixed("wall", shape, pose, Surface::Separate));
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..30 {
            let report = world.step(1e-3, &[]);
            assert!(lowest(&world) > 0.0, "{}", lowest(&world));
            assert!(report.quarantined.is_empty(), "{:?}", report.quarantined);
        }
        let v = world.report().objects[0].linear_velocity;
        assert!(v[2] > -1.0, "it was stopped: {v:?}");
    }
}

#[test]
fn a_paddle_pushes_with_its_speed_whether_thick_or_thin() {
    for half in [0.3, 0.005] {
        let mut scene = cube(0.0);
        let mut paddle = Collider::fixed(
            "paddle",
            ColliderShape::Box {
                half_extents: [half, 1.0, 1.0],
            },
            Pose::at([-0.4 - half, 0.0, 0.2]),
            Surface::Slip,
        );
        paddle.motion = ColliderMotion::Velocity {
            linear: [2.0, 0.0, 0.0],
            angular: [0.0; 3],
            span: TimeSpan {
                start: 0.0,
                end: 0.5,
            },
        };
        paddle.surface = Surface::Separate;
        scene.colliders.push(paddle);
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..29 {
            world.step(FRAME, &[]);
        }
        let pushed = world.report().objects[0].linear_velocity[0];
        // An elastic body leaves a wall that hits it faster than the wall, at most twice as fast.
        assert!((1.9..4.0).contains(&pushed), "{half}: {pushed}");
        let back = world.positions().iter().map(|x| f64::from(x[0]));
        let back = back.fold(f64::INFINITY, f64::min);
        let face = -0.4 + 2.0 * 29.0 * FRAME;
        // The grid lets particles into a thick paddle by less than a cell.
        assert!(
            back > face - if half > 0.1 { DX } else { 0.0 },
            "{back} {face}"
        );
    }
}

#[test]
fn a_sticky_plate_carries_what_stands_on_it_round() {
    let mut scene = cube(0.005);
    let mut plate = Collider::fixed(
        "plate",
        ColliderShape::Cylinder {
            radius: 1.0,
            half_height: 0.5,
        },
        Pose {
            rotation: turned_to_z(),
            translation: [0.0, 0.0, -0.5],
        },
        Surface::Sticky,
    );
    plate.motion = ColliderMotion::Velocity {
        linear: [0.0; 3],
        angular: [0.0, 0.0, 1.0],
        span: TimeSpan::ALWAYS,
    };
    scene.gravity = [0.0, 0.0, -9.81];
    scene.colliders.push(plate);
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..120 {
        world.step(FRAME, &[]);
    }
    let spin = world.report().objects[0].angular_velocity;
    assert!((spin[2] - 1.0).abs() < 0.05, "{spin:?}");
}

#[test]
fn the_fortieth_collider_acts_as_if_it_were_alone() {
    let run = |count: i32| {
        let mut scene = cube(0.02);
        scene.gravity = [0.0, 0.0, -9.81];
        scene.objects[0].linear_velocity = [0.3, 0.1, 0.0];
        for n in 40 - count..40 {
            let i = f64::from(39 - n);
            let shape = if n % 2 == 0 {
                ColliderShape::Sphere { radius: 0.5 }
            } else {
                let half_extents = [0.7, 0.7, 0.5];
                ColliderShape::Box { half_extents }
            };
            let pose = Pose::at([1.5 * (i % 7.0), 1.5 * (i / 7.0).trunc(), -0.5]);
            scene.colliders.push(Collider {
                friction: Some(0.3),
                ..Collider::fixed(&format!("block {n}"), shape, pose, Surface::Separate)
            });
        }
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..40 {
            world.step(FRAME, &[]);
        }
        world.positions().to_vec()
    };
    let alone = run(1);
    assert_eq!(run(40), alone);
    let lowest = alone.iter().map(|x| x[2]).fold(f32::INFINITY, f32::min);
    assert!(lowest > -0.1, "it stands on the last one: {lowest}");
}

#[test]
fn a_mesh_box_acts_like_a_box() {
    let run = |mesh: bool| {
        let mut scene = cube(0.02);
        scene.gravity = [0.0, 0.0, -9.81];
        scene.objects[0].linear_velocity = [0.5, 0.0, 0.0];
        let (shape, z) = if mesh {
            (ColliderShape::Mesh(Arc::new(slab(0.8, 0.6))), 0.0)
        } else {
            let half_extents = [0.8, 0.8, 0.3];
            (ColliderShape::Box { half_extents }, -0.3)
        };
        scene.colliders.push(Collider {
            friction: Some(0.3),
            ..Collider::fixed("table", shape, Pose::at([0.0, 0.0, z]), Surface::Separate)
        });
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..40 {
            world.step(FRAME, &[]);
        }
        world.report().objects[0].com
    };
    // The same distances, computed in another way: round-off, grown by 400 substeps.
    let error = distance(run(false), run(true));
    assert!(error < 1e-4, "{error:e}");
}
