//! Blocks at rest on each other, and friction between them.

use super::*;
use crate::{scene::Surface, test_scenes::add_plane};

/// Three blocks of 3 cells each that fall on each other from distances of `gap` cells, with damping until they lie
/// still. Returns the distances between neighbours [cells] and how far they move in another second [cells].
fn stack(method: ContactMethod, gap: f64) -> ([f64; 2], f64) {
    let dx = 0.1;
    let mut scene = empty(dx);
    scene.contact.method = method;
    scene.gravity = [0.0, 0.0, -9.81];
    scene.conditions.damping = 4.0;
    for level in 0..3 {
        let z = (3.0 + gap) * dx * f64::from(level);
        let material = elastic(Law::NeoHookean, 1e6, 0.3);
        add_box(&mut scene, material, [-0.2, -0.2, z], 0.05, [8, 8, 6]);
    }
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.5,
    );
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..150 {
        world.step(1.0 / 60.0, &[]);
    }
    let heights = |world: &World| [0, 1, 2].map(|id| world.report().objects[id].com[2]);
    let settled = heights(&world);
    let mut moved = 0.0_f64;
    for _ in 0..60 {
        world.step(1.0 / 60.0, &[]);
        moved = moved.max(norm(difference(heights(&world), settled)) / dx);
    }
    // The blocks give way by rho g h^2 / E under their own weight and what they carry: a hundredth of a cell.
    let apart = [1, 2].map(|n| (settled[n] - settled[n - 1]) / dx - 3.0);
    (apart, moved)
}

#[test]
fn blocks_rest_on_each_other_without_gap_or_jitter() {
    for gap in [0.0, 1.0] {
        let (apart, moved) = stack(ContactMethod::TwoScale, gap);
        // Their compression is measured along: 0.02 cells. Gradients without a gap test leave 0.9 cells.
        let close = apart.iter().all(|apart| (-0.05..0.02).contains(apart));
        assert!(close, "from {gap}: {apart:?}");
        assert!(moved < 2e-3, "from {gap}: moved {moved}");
    }
}

#[test]
fn a_block_slides_on_a_held_block_as_coulomb_says() {
    let (dx, mu, g) = (0.1, 0.3, 9.81);
    let mut scene = empty(dx);
    scene.contact.method = ContactMethod::TwoScale;
    scene.gravity = [0.0, 0.0, -g];
    let stiff = || elastic(Law::NeoHookean, 1e7, 0.3);
    add_box(&mut scene, stiff(), [-0.3, -0.3, 0.0], 0.05, [28, 12, 6]);
    let slider = add_box(&mut scene, stiff(), [-0.2, -0.2, 0.3], 0.05, [8, 8, 4]);
    for object in &mut scene.objects {
        object.surface.friction = mu;
    }
    scene.objects[slider].linear_velocity = [1.0, 0.0, 0.0];
    add_plane(
        &mut scene,
        [0.0, 0.0, 0.15],
        [0.0, 0.0, 1.0],
        Surface::Sticky,
        0.0,
    );
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().objects[slider].com[0];
    let mut run = |frames: usize| {
        for _ in 0..frames {
            world.step(1.0 / 60.0, &[]);
        }
        let object = &world.report().objects[slider];
        (object.linear_velocity[0], object.com[0] - start)
    };
    // It also drops and bounces at first, because its weight comes suddenly: measured 3 % off.
    let (v, _) = run(12);
    let expected = 1.0 - mu * g * 0.2;
    assert!((v - expected).abs() < 0.03, "{v} m/s, expected {expected}");
    let (v, way) = run(28);
    let expected = 0.5 / (mu * g);
    assert!(v.abs() < 1e-3, "still at {v} m/s");
    assert!(
        (way / expected - 1.0).abs() < 0.05,
        "{way} m, expected {expected}"
    );
}
