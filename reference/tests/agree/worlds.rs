//! Stories that both solvers tell alike: round-off of single precision parts them.

use cosplat_reference::ReferenceWorld;
use cosplat_sim_core::{
    Action, Command, World,
    materials::{Law, Material},
    scene::MaterialRegion,
    test_scenes::{busy, elastic, falling_block},
};

use crate::{distance, norm};

fn command(action: Action) -> Command {
    Command {
        client: 1,
        sequence: 1,
        apply_at_step: 0,
        action,
    }
}

#[test]
fn the_fast_solver_follows_the_reference() {
    for law in [Law::FixedCorotated, Law::NeoHookean] {
        let scene = falling_block(law);
        let mut reference = ReferenceWorld::new(&scene);
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..12 {
            let report = world.step(1.0 / 60.0, &[]);
            let expected = reference.step_with(world.substeps(), &[]);
            let (a, b) = (&report.objects[0], &expected.objects[0]);
            // Single precision against double: round-off of some ten substeps, in units of the motion.
            assert!(
                distance(a.com, b.com) < 1e-6,
                "{law:?}: {:?} {:?}",
                a.com,
                b.com
            );
            let error = distance(a.linear_velocity, b.linear_velocity);
            assert!(error < 1e-5, "{law:?}: velocity differs by {error:e}");
            let error = distance(a.angular_momentum, b.angular_momentum);
            let size = norm(b.angular_momentum);
            assert!(error < 1e-4 * size, "{law:?}: {error:e} of {size}");
            let (e, energy) = (a.elastic_energy, b.elastic_energy);
            assert!(
                (e - energy).abs() < 1e-4 * b.kinetic_energy,
                "{law:?}: {e} {energy}"
            );
            let error = (a.kinetic_energy - b.kinetic_energy).abs();
            assert!(error < 1e-4 * b.kinetic_energy, "{law:?}: {error:e}");
        }
    }
}

#[test]
fn two_materials_share_an_object_and_a_region_can_be_edited() {
    let mut scene = falling_block(Law::NeoHookean);
    let object = &mut scene.objects[0];
    let all = object.particles.clone();
    let heavy = Material {
        density: 3000.0,
        ..elastic(Law::FixedCorotated, 4e5, 0.3)
    };
    object.regions.push(MaterialRegion {
        particles: all.start + 168..all.end,
        material: heavy.clone(),
    });
    let mut reference = ReferenceWorld::new(&scene);
    let mut world = World::new(scene.clone()).expect("valid scene");
    // Half at 1000, half at 3000 kg/m^3.
    let volume = 336.0 * 0.05_f64.powi(3);
    assert!((world.report().objects[0].mass / (2000.0 * volume) - 1.0).abs() < 1e-12);
    for frame in 0..10 {
        let edit = vec![Command {
            client: 1,
            sequence: 1,
            apply_at_step: 0,
            action: Action::SetMaterial {
                object: 0,
                region: Some(0),
                patch: None,
                material: elastic(Law::NeoHookean, 3e4, 0.3),
            },
        }];
        let commands = if frame == 5 { edit } else { vec![] };
        let report = world.step(1.0 / 60.0, &commands);
        let expected = reference.step_with(world.substeps(), &commands);
        let (a, b) = (&report.objects[0], &expected.objects[0]);
        // As for one material: round-off of single precision.
        assert!(distance(a.com, b.com) < 1e-6, "{:?} {:?}", a.com, b.com);
        assert!(distance(a.linear_velocity, b.linear_velocity) < 1e-5);
    }
    let missing = Action::SetMaterial {
        object: 0,
        region: Some(1),
        patch: None,
        material: heavy,
    };
    let error = world.check(&missing).expect_err("there is one region");
    assert_eq!(
        error.to_string(),
        "object 0 has no region 1: it has regions 0..1"
    );
}

#[test]
fn both_solvers_obey_the_same_boundaries() {
    let (scene, actions) = busy();
    let mut reference = ReferenceWorld::new(&scene);
    let mut world = World::new(scene).expect("valid scene");
    let mut worst = 0.0_f64;
    for n in 0..24 {
        let due = actions.iter().filter(|(at, _)| *at == n);
        let due: Vec<Command> = due.map(|(_, action)| command(action.clone())).collect();
        world.step(1.0 / 60.0, &due);
        let substeps = world.substeps().to_vec();
        reference.step_with(&substeps, &due);
        for (a, b) in world.positions().iter().zip(&reference.particles.position) {
            worst = worst.max(distance(a.map(f64::from), *b));
        }
    }
    // Measured: see the assertion. Contact decides by signs, so round-off may decide otherwise for a particle
    // that grazes; what stays is far below the size of a cell.
    assert!(worst < 1e-3, "{worst:e}");
}
