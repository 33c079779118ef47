//! Matter near particles that are held: those weigh more on the grid than they do, and nobody else may feel that.

use super::*;
use crate::{
    scene::{Aabb, PrescribedMotion, Region, Selection, Surface, TimeSpan},
    test_scenes::add_plane,
};

/// Cell size [m].
const DX: f64 = 0.1;

/// Holds what an object has between two heights [m], or moves it up or down [m/s].
fn hold(scene: &mut Scene, object: usize, [low, high]: [f64; 2], speed: f64) {
    scene.conditions.prescribed.push(PrescribedMotion {
        selection: Selection {
            object: Some(object),
            region: Some(Region::Box(
                Aabb {
                    min: [-1.0, -1.0, low],
                    max: [1.0, 1.0, high],
                }
                .into(),
            )),
        },
        linear: [0.0, 0.0, speed],
        angular: [0.0; 3],
        center: [0.0; 3],
        span: TimeSpan::ALWAYS,
    });
}

/// Height of the lowest of some particles [m].
fn lowest(positions: &[[f32; 3]]) -> f64 {
    let heights = positions.iter().map(|x| f64::from(x[2]));
    heights.fold(f64::INFINITY, f64::min)
}

/// Height of the lowest particle of a block of some matter above the top of a rail three cells thick, of which all below a
/// height is held, half a second after it was laid down 0.1 cells above it [cells].
fn lies(law: Law, held: f64) -> f64 {
    let mut scene = empty(DX);
    scene.contact.method = ContactMethod::MultiField;
    scene.gravity = [0.0, 0.0, -9.81];
    scene.conditions.damping = 4.0;
    let stiff = elastic(Law::NeoHookean, 1e6, 0.3);
    add_box(&mut scene, stiff, [-0.4, -0.3, 0.0], 0.05, [16, 12, 6]);
    hold(&mut scene, 0, [-1.0, held], 0.0);
    let block = elastic(law, 1e6, 0.3);
    add_box(&mut scene, block, [-0.2, -0.2, 0.31], 0.05, [8; 3]);
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..30 {
        world.step(1.0 / 60.0, &[]);
    }
    (lowest(&world.positions()[16 * 12 * 6..]) - 0.3) / DX
}

#[test]
fn a_block_lies_on_a_rail_however_much_of_it_is_held() {
    // Masses as heavy as on the grid lean normals: it sank in by 0.2 to 1.9 cells.
    let all = [0.05, 0.15, 0.25].map(|held| lies(Law::NeoHookean, held));
    let [low, high] = [f64::min, f64::max].map(|of| all.into_iter().reduce(of).expect("three"));
    assert!(high - low < 0.1 && low > 0.22, "{all:?}");
}

#[test]
fn a_pad_is_pressed_on_the_floor_by_what_holds_it() {
    for held in [0.05, 0.15] {
        let mut scene = empty(DX);
        let soft = elastic(Law::NeoHookean, 1e5, 0.3);
        add_box(&mut scene, soft, [-0.2, -0.2, 0.01], 0.05, [8, 8, 6]);
        hold(&mut scene, 0, [held, 1.0], -0.1);
        let up = [0.0, 0.0, 1.0];
        add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.0);
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..24 {
            world.step(1.0 / 60.0, &[]);
        }
        // Pressed together by 0.3 cells, the lowest layer less than what is above it: 0.185. It went on by itself, to -0.05.
        let lowest = lowest(world.positions()) / DX;
        let right = (0.15..0.25).contains(&lowest);
        assert!(right, "held from {held} m on: {lowest} cells above");
    }
}
