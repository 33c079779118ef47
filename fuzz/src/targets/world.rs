//! The small world that commands and checkpoints are tried on.

use cosplat_scene::{
    assets::ReadReport,
    scene_file::{SceneFile, build},
};
use cosplat_sim_core::World;

use super::assets;

/// Matter of two materials, a rigid body, what sleeps soon, a collider that can be moved, a domain that can be left.
pub const SCENE: &str = r#"
version = 1
name = "fuzz"
frame_rate = 60
dx = 0.1
particles_per_cell = 1
gravity = [0.0, -9.81, 0.0]

[domain]
min = [-2.0, -1.0, -2.0]
max = [2.0, 3.0, 2.0]
policy = "delete"

[[objects]]
name = "soft"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [0.2, 0.12, 0.2]
material = "soft_rubber"

[[objects]]
name = "sand"
shape = { kind = "box", size = [0.2, 0.1, 0.2] }
translation = [0.6, 0.06, 0.2]
material = "dry_sand"

[[objects]]
name = "stone"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [0.2, 0.45, 0.2]
material = "rigid"

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.4
"#;

/// Frames of that scene per second [1/s].
pub const FRAME_RATE: f64 = 60.0;

/// The world at its beginning.
pub fn new() -> World {
    let file = SceneFile::parse(SCENE).unwrap_or_else(|errors| panic!("{errors}"));
    let mut load = |_: &str| Ok((assets::few(), ReadReport::default()));
    let (scene, _) = build(&file, &mut load).unwrap_or_else(|errors| panic!("{errors}"));
    World::new(scene).unwrap_or_else(|error| panic!("{error}"))
}

/// Steps a world a little, and looks at what it would publish.
pub fn step(world: &mut World, frame: f64) {
    world.step(frame, &[]);
    check(world);
}

/// All that a world would publish is finite.
pub fn check(world: &World) {
    let places = world.positions().as_flattened().iter();
    assert!(places.copied().all(f32::is_finite), "a position");
    let shapes = world.deformations().as_flattened().iter();
    assert!(shapes.copied().all(f32::is_finite), "a deformation");
    let speeds = world.velocities().as_flattened().iter();
    assert!(speeds.copied().all(f32::is_finite), "a velocity");
    for (n, object) in world.report().objects.iter().enumerate() {
        let numbers = [
            &object.com[..],
            &object.rotation,
            &object.linear_velocity,
            &object.angular_velocity,
        ]
        .concat();
        assert!(
            numbers.iter().all(|x| x.is_finite()),
            "object {n}: {object:?}"
        );
        let energies = [object.mass, object.kinetic_energy, object.elastic_energy];
        assert!(
            energies.iter().all(|x| x.is_finite()),
            "object {n}: {object:?}"
        );
    }
}
