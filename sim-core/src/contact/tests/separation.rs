//! Blocks that part, against the gap between them.

use super::*;

/// Two blocks of 10 x 10 x 3 cells of 0.05 m, one above the other at a distance of `gap` cells, whose relative velocity
/// is `velocity` [m/s]; returns what is left of it after one second, as a part.
fn kept(gap: f64, velocity: [f64; 3]) -> f64 {
    let dx = 0.05;
    let mut scene = empty(dx);
    scene.contact.method = ContactMethod::MultiField;
    for (side, sign) in [(0.0, -1.0), (1.0, 1.0)] {
        let id = add_box(
            &mut scene,
            elastic(Law::NeoHookean, 1e4, 0.3),
            [0.0, 0.0, side * (0.15 + gap * dx)],
            0.5 * dx,
            [20, 20, 6],
        );
        scene.objects[id].surface.friction = Some(0.0);
        scene.objects[id].linear_velocity = velocity.map(|v| 0.5 * sign * v);
    }
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..30 {
        world.step(1.0 / 30.0, &[]);
    }
    let [a, b] = [0, 1].map(|n| world.report().objects[n].linear_velocity);
    let left: f64 = (0..3).map(|n| (b[n] - a[n]) * velocity[n]).sum();
    left / velocity.iter().map(|v| v * v).sum::<f64>()
}

#[test]
fn blocks_that_part_keep_their_speed_at_every_gap() {
    for gap in [0.0, 0.5, 1.0, 1.5, 2.0, 2.5] {
        let kept = kept(gap, [0.0, 0.0, 0.1]);
        assert!((0.99..1.001).contains(&kept), "at {gap}: {kept}");
    }
}
