//! What matter loses: energy is booked, and `auto` is `mpm`.

use super::*;
use crate::scene::{Aabb, Fidelity, Object, PinnedRegion, Solver};

const FRAME: f64 = 1.0 / 60.0;

/// A box of so many cells of 0.025 m as a solid of some loss factor.
fn lossy_box(loss: f64, corner: [f64; 3], cells: [usize; 3]) -> Scene {
    let mut scene = empty(0.025);
    let mut material = elastic(Law::NeoHookean, 3e5, 0.3);
    material.loss = loss;
    let id = add_box(&mut scene, material, corner, 0.0125, cells.map(|n| 2 * n));
    scene.objects[id].solver = Solver::Lagrangian;
    scene
}

/// A ball of a radius of 0.1 m, 0.2 m above a floor.
fn dropped_ball(loss: f64, fidelity: Fidelity) -> World {
    let dx = 0.025;
    let mut scene = empty(dx);
    scene.gravity = [0.0, -9.81, 0.0];
    for (position, volume) in ball(dx, [0.0, 0.3, 0.0], 0.1) {
        scene.particles.position.push(position);
        scene.particles.volume.push(volume);
    }
    let mut material = elastic(Law::NeoHookean, 3e5, 0.3);
    material.loss = loss;
    scene.objects.push(Object {
        solver: Solver::Lagrangian,
        fidelity,
        ..Object::new("ball", material, 0..scene.particles.position.len())
    });
    let up = [0.0, 1.0, 0.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.5);
    World::new(scene).expect("valid")
}

#[test]
fn energy_that_a_ringing_bar_loses_is_booked() {
    for held in [false, true] {
        let mut scene = lossy_box(0.1, [0.0; 3], [16, 4, 4]);
        scene.objects[0].velocity_gradient[1][0] = 1.0;
        scene.objects[0].velocity_gradient[0][1] = 1.0;
        if held {
            scene.gravity = [0.0, -9.81, 0.0];
            scene.pinned_regions.push(PinnedRegion::fixed(Aabb {
                min: [-1.0; 3],
                max: [0.051, 1.0, 1.0],
            }));
        }
        let mut world = World::new(scene).expect("valid");
        let energy = |world: &World| {
            let r = world.report();
            r.kinetic_energy + r.elastic_energy + r.potential_energy
        };
        // The first frame stops what is held.
        world.step(FRAME, &[]);
        let (start, mut lost) = (energy(&world), 0.0);
        for _ in 0..180 {
            lost += world.step(FRAME, &[]).lost_in_matter;
        }
        let gap = start - energy(&world) - lost;
        // Velocities decay half a substep before positions are where they are: of the highest modes a hundredth more is booked.
        assert!(
            lost > 0.0 && gap.abs() < 0.01 * lost,
            "{held}: {gap} of {lost}"
        );
    }
}

#[test]
fn auto_is_the_same_physics_until_it_sleeps() {
    for loss in [0.0, 0.1] {
        let [mut auto, mut full] = [Fidelity::Auto, Fidelity::Mpm].map(|f| dropped_ball(loss, f));
        let mut off = 0.0_f64;
        for _ in 0..90 {
            let [a, b] = [&mut auto, &mut full].map(|w| w.step(FRAME, &[]).objects[0].com);
            off = off.max(distance(a, b));
        }
        // A hundredth of the radius is the tolerance.
        assert!(off < 1e-3, "{loss}: {off}");
    }
}

#[test]
fn losses_are_the_same_on_any_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().expect("threads").install(|| {
            let mut world = dropped_ball(0.1, Fidelity::Mpm);
            (0..30).for_each(|_| drop(world.step(FRAME, &[])));
            world.report().state_hash
        })
    };
    assert_eq!(run(1), run(3));
}
