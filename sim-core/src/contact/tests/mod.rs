//! Laws of contact between deformable objects.

mod bits;
mod closed;
mod frames;
mod held;
mod pairs;
mod separation;
mod stacks;

use crate::{
    World,
    materials::Law,
    scene::{ContactMethod, Scene},
    test_scenes::{add_box, elastic, empty, spin},
};

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Two blocks that hit each other off centre, with spin and friction, after 0.1 s.
fn glancing() -> Scene {
    let mut scene = empty(0.1);
    scene.contact.method = ContactMethod::MultiField;
    for (x, v, w, cells) in [
        ([-0.52, -0.2, -0.15], 1.0, [1.0, -0.5, 2.0], [8, 7, 6]),
        ([0.05, -0.05, -0.22], -0.6, [-0.5, 1.0, 0.4], [6, 8, 7]),
    ] {
        let material = elastic(Law::NeoHookean, 1e5, 0.3);
        let id = add_box(&mut scene, material, x, 0.05, cells);
        scene.objects[id].linear_velocity = [v, 0.1, -0.05];
        scene.objects[id].velocity_gradient = spin(w);
    }
    scene
}
