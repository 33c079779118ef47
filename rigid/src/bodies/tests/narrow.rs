//! What lies on colliders that are narrower than its points are apart.

use std::sync::Arc;

use super::*;
use crate::{
    rotation::from_rotation_vector,
    scene::{Collider, ColliderShape, Pose, TriangleMesh},
    test_scenes::box_mesh,
};

/// Half the width of all supports [m]; points of the bodies are 0.1 m apart, of the ring 0.05.
const NARROW: f64 = 0.02;
/// Height of their tops [m].
const TOP: f64 = 0.3;

/// Turned so that its y axis is along z.
fn upright(x: f64, y: f64, z: f64) -> Pose {
    Pose {
        rotation: from_rotation_vector([0.5 * std::f64::consts::PI, 0.0, 0.0]),
        ..Pose::at([x, y, z])
    }
}

/// A support that goes up to the [`TOP`] there: a post, or a rail along y, of every shape.
fn support(kind: usize, x: f64, y: f64) -> Option<(&'static str, ColliderShape, Pose)> {
    let (deep, long) = (0.1, 2.0);
    let mesh = |half: [f64; 3]| ColliderShape::Mesh(Arc::new(box_mesh(half)));
    let post = [NARROW, NARROW, deep];
    let rail = [NARROW, long, deep];
    let low = TOP - deep;
    let capsule = |half_height: f64| ColliderShape::Capsule {
        radius: NARROW,
        half_height,
    };
    let cylinder = |half_height: f64| ColliderShape::Cylinder {
        radius: NARROW,
        half_height,
    };
    Some(match kind {
        0 => (
            "post",
            ColliderShape::Box { half_extents: post },
            Pose::at([x, y, low]),
        ),
        1 => (
            "rail",
            ColliderShape::Box { half_extents: rail },
            Pose::at([x, 0.0, low]),
        ),
        2 => (
            "ball",
            ColliderShape::Sphere { radius: NARROW },
            Pose::at([x, y, TOP - NARROW]),
        ),
        3 => ("pole", cylinder(deep), upright(x, y, low)),
        4 => (
            "round rail",
            cylinder(long),
            Pose::at([x, 0.0, TOP - NARROW]),
        ),
        5 => ("finger", capsule(deep - NARROW), upright(x, y, low)),
        6 => ("bar", capsule(long), Pose::at([x, 0.0, TOP - NARROW])),
        7 => ("mesh post", mesh(post), Pose::at([x, y, low])),
        8 => ("mesh rail", mesh(rail), Pose::at([x, 0.0, low])),
        9 => {
            // A sheet, without an inside: what lies on it keeps off by its skin.
            let sheet = TriangleMesh {
                points: vec![
                    [-NARROW, -long, 0.0],
                    [NARROW, -long, 0.0],
                    [NARROW, long, 0.0],
                    [-NARROW, long, 0.0],
                ],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
            };
            let at = Pose::at([x, 0.0, TOP - 0.05 * DX]);
            ("sheet", ColliderShape::Mesh(Arc::new(sheet)), at)
        }
        _ => return None,
    })
}

/// A flat body of each form, with half its height and how well its surface is known [m].
fn bodies() -> Vec<(&'static str, Vec<Grain>, f64)> {
    let center = [0.0, 0.0, TOP + 0.1];
    let ring = |r: Vec3| (0.3..0.6).contains(&r[0].hypot(r[1]));
    vec![
        ("plate", block(center, 0.05, [24, 24, 2]), 1e-4),
        ("disk", drum(center, 0.6, 0.05, 0.025), 1e-4),
        ("ring", carved(center, 0.05, [26, 26, 2], ring), 0.015),
    ]
}

#[test]
fn flat_bodies_lie_on_what_is_narrower_than_their_points() {
    for (body, grains, exact) in bodies() {
        for kind in 0.. {
            let mut name = "";
            let mut stage = Stage::new([0.0, 0.0, -9.81]);
            stage.surface = (0.0, 0.3);
            // Half way between points.
            for (x, y) in [(0.35, 0.05), (-0.25, 0.35), (-0.25, -0.35)] {
                let Some((of_kind, shape, pose)) = support(kind, x, y) else {
                    break;
                };
                name = of_kind;
                stage.scene.colliders.push(Collider {
                    friction: Some(0.3),
                    ..Collider::fixed(name, shape, pose, Surface::Separate)
                });
            }
            if name.is_empty() {
                break;
            }
            let id = stage.add(&grains);
            for _ in 0..90 {
                stage.step(1.0 / 60.0);
            }
            let found = stage.bodies[id];
            let height = found.com[2] - TOP - 0.05;
            assert!(height.abs() < exact, "{body} on {name}: {height}");
            let aside = found.com[0].hypot(found.com[1]);
            assert!(aside < 0.01, "{body} on {name}: {aside} aside");
        }
    }
}

/// Half a turn of a box about an edge that crosses that of a rail at a right angle: the impulse is along the cross product of the
/// edges, so that nothing goes sideways.
#[test]
fn edges_that_cross_push_along_their_cross_product() {
    for lean in [0.3_f64, 0.785] {
        let mut stage = Stage::new([0.0; 3]);
        let half = 0.1;
        // An edge of each looks at the other: that of the rail along y.
        let rail = ColliderShape::Box {
            half_extents: [half, 2.0, half],
        };
        let pose = Pose {
            rotation: from_rotation_vector([0.0, std::f64::consts::FRAC_PI_4, 0.0]),
            ..Pose::IDENTITY
        };
        let mut rail = Collider::fixed("rail", rail, pose, Surface::Separate);
        rail.restitution = 1.0;
        stage.scene.colliders.push(rail);
        let id = stage.add(&block([0.0; 3], 0.05, [24, 4, 4]));
        // The box is along x, turned about it.
        let height = std::f64::consts::SQRT_2 * half + half * (lean.cos() + lean.sin());
        stage.bodies[id].com = [0.033, 0.021, height + 0.01];
        stage.bodies[id].rotation = crate::rotation::product(
            from_rotation_vector([lean, 0.0, 0.0]),
            stage.bodies[id].rotation,
        );
        stage.bodies[id].velocity = [0.0, 0.0, -1.0];
        for _ in 0..3 {
            stage.step(1.0 / 60.0);
        }
        let body = stage.bodies[id];
        let [x, y, z] = body.velocity;
        assert!(
            x.abs() < 1e-6 && y.abs() < 1e-6,
            "{lean}: sideways {x} {y} {z}"
        );
        let energy = body.kinetic_energy(&stage.shapes[id].inertia);
        let before = 0.5 * stage.shapes[id].inertia.mass;
        assert!((energy / before - 1.0).abs() < 1e-6, "{lean}: {energy}");
        assert!(z > -0.9, "{lean}: {z}");
    }
}

/// What slides over a seam.
fn sliders() -> Vec<(&'static str, Vec<Grain>, f64)> {
    vec![
        ("plate", block([0.0; 3], 0.05, [10, 10, 2]), 0.05),
        ("plank", block([0.0; 3], 0.05, [20, 4, 2]), 0.05),
        ("disk", drum([0.0; 3], 0.3, 0.05, 0.025), 0.05),
        ("can", drum([0.0; 3], 0.2, 0.2, 0.05), 0.2),
        ("cube", block([0.0; 3], 0.05, [6, 6, 6]), 0.15),
    ]
}

#[test]
fn what_slides_over_the_seam_of_two_flush_solids_slides_on() {
    let (speed, g) = (2.0, 9.81);
    let mut caught = vec![];
    for (name, grains, half) in sliders() {
        for on_bodies in [false, true] {
            for friction in [0.0, 0.3] {
                // At colliders a step of a ten-thousandth of a cell is none.
                let steps: &[f64] = if on_bodies { &[0.0] } else { &[0.0, 1e-4 * DX] };
                for &step in steps {
                    let mut stage = Stage::new([0.0, 0.0, -g]);
                    stage.surface = (0.0, friction);
                    let id = stage.add(&grains);
                    for (x, height) in [(-1.6, 0.0), (2.4, step)] {
                        let at = [x + 0.013, 0.0, height - 0.2];
                        if on_bodies {
                            let table = stage.add(&block(at, 0.4, [10, 10, 1]));
                            stage.drives[table] = Drive::Kinematic {
                                velocity: [0.0; 3],
                                spin: [0.0; 3],
                            };
                        } else {
                            let shape = ColliderShape::Box {
                                half_extents: [2.0, 2.0, 0.2],
                            };
                            stage.scene.colliders.push(Collider {
                                friction: Some(friction),
                                ..Collider::fixed("table", shape, Pose::at(at), Surface::Separate)
                            });
                        }
                    }
                    stage.bodies[id].com = [-0.2, 0.0, half];
                    stage.bodies[id].velocity = [speed, 0.0, 0.0];
                    let (mut highest, mut time) = (0.0_f64, 0.0);
                    while time < 0.8 {
                        stage.step(1.0 / 60.0);
                        time += 1.0 / 60.0;
                        highest = highest.max(stage.bodies[id].com[2]);
                    }
                    let way = stage.bodies[id].com[0] + 0.2;
                    let expected = match friction > 0.0 {
                        true => speed * speed / (2.0 * friction * g),
                        false => speed * time,
                    };
                    let case = (name, on_bodies, friction, step);
                    let slides = (way / expected - 1.0).abs() < 0.01;
                    if !slides || highest > half + 1e-3 * DX + step {
                        caught.push(format!("{case:?}: {way} of {expected} m, {highest} high"));
                    }
                }
            }
        }
    }
    assert!(caught.is_empty(), "{caught:#?}");
}

/// A step that is one, and a wall, stop what slides.
#[test]
fn what_slides_is_stopped_by_what_stands_in_its_way() {
    for height in [0.2 * DX, 0.3] {
        let mut stage = Stage::new([0.0, 0.0, -9.81]);
        let id = stage.add(&block([0.0; 3], 0.05, [10, 10, 2]));
        for (x, top) in [(-1.6, 0.0), (2.4, height)] {
            let shape = ColliderShape::Box {
                half_extents: [2.0, 2.0, 0.2],
            };
            let at = Pose::at([x, 0.0, top - 0.2]);
            let table = Collider::fixed("table", shape, at, Surface::Separate);
            stage.scene.colliders.push(table);
        }
        stage.bodies[id].com = [-0.2, 0.0, 0.05];
        stage.bodies[id].velocity = [1.0, 0.0, 0.0];
        for _ in 0..60 {
            stage.step(1.0 / 60.0);
        }
        let x = stage.bodies[id].com[0];
        assert!(x < 0.4 - 0.25 + 1e-3, "{height}: {x}");
    }
}
