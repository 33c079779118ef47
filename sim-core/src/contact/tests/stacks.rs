//! Blocks at rest on each other.

use super::*;
use crate::{scene::Surface, test_scenes::add_plane};

#[test]
fn a_block_on_two_others_takes_no_energy_from_nowhere() {
    // Where its lower face crosses the slit between them, three objects share nodes. An impulse of one pair that another
    // pair makes needless used to stay: it pushed both apart, and did work in every substep.
    let (dx, spacing) = (0.03, 0.015);
    let mut scene = empty(dx);
    scene.contact.method = ContactMethod::MultiField;
    scene.gravity = [0.0, 0.0, -9.81];
    scene.conditions.damping = 2.0;
    for corner in [
        [-0.045, -0.045, 0.002],
        [0.07, -0.035, 0.002],
        [0.008, -0.055, 0.118],
    ] {
        let material = elastic(Law::NeoHookean, 1e5, 0.3);
        add_box(&mut scene, material, corner, spacing, [7; 3]);
    }
    // Off their lattice, by a fixed linear congruence: what is regular presses regularly.
    let mut seed = 1_u64;
    for x in scene.particles.position.iter_mut().flatten() {
        *x += 0.3 * spacing * crate::test_scenes::random(&mut seed);
    }
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.5,
    );
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..60 {
        world.step(1.0 / 60.0, &[]);
    }
    let stored = |world: &World| world.report().elastic_energy;
    let total = |world: &World| {
        let report = world.report();
        report.kinetic_energy + report.elastic_energy + report.potential_energy
    };
    let (settled, all) = (stored(&world), total(&world));
    for _ in 0..120 {
        world.step(1.0 / 60.0, &[]);
    }
    // Measured: at most 0.03; 0.97 and 1.04 with impulses that stay.
    let (gained, all) = (
        stored(&world) / settled - 1.0,
        (total(&world) - all) / settled,
    );
    assert!(
        gained < 0.1,
        "elastic energy grew by {gained} of what it was"
    );
    assert!(all < 0.05, "{all} of the elastic energy came from nowhere");
}
