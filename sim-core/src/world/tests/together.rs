//! Solids on grids of their own with rigid bodies in one scene.

use super::*;
use crate::{
    report::ContactPartner,
    scene::{Object, Solver},
};

/// Adds a ball of a radius of 0.5 m; returns its number.
fn add_ball(scene: &mut Scene, center: [f64; 3], material: Material, solver: Solver) -> usize {
    let first = scene.particles.position.len();
    for (position, volume) in ball(scene.dx, center, 0.5) {
        scene.particles.position.push(position);
        scene.particles.volume.push(volume);
    }
    let id = scene.objects.len();
    scene.objects.push(Object {
        solver,
        ..Object::new(
            format!("ball{id}"),
            material,
            first..scene.particles.position.len(),
        )
    });
    id
}

/// A soft ball and a rigid one of a density over that of the soft one, which meet off their line without gravity.
fn balls_that_meet(density: f64) -> World {
    let mut scene = empty(0.125);
    scene.cfl = 0.8;
    let soft = elastic(Law::NeoHookean, 1e5, 0.3);
    let hard = Material {
        density: density * soft.density,
        ..elastic(Law::Rigid, 0.0, 0.0)
    };
    let one = add_ball(&mut scene, [-0.53, 0.1, 0.0], soft, Solver::Lagrangian);
    let other = add_ball(&mut scene, [0.53, -0.1, 0.02], hard, Solver::Spatial);
    scene.objects[one].linear_velocity = [1.0, 0.0, 0.0];
    scene.objects[other].linear_velocity = [-1.0, 0.0, 0.1];
    World::new(scene).expect("valid")
}

#[test]
fn soft_and_rigid_balls_keep_momentum_and_energy() {
    for density in [0.05, 1.0, 20.0] {
        let mut world = balls_that_meet(density);
        let start = world.report().clone();
        let energy = |r: &StepReport| r.kinetic_energy + r.elastic_energy;
        let scale: f64 = start.objects.iter().map(|o| o.mass).sum();
        let mut touched = 0;
        for _ in 0..40 {
            let report = world.step(0.01, &[]);
            touched += usize::from(!world.contacts().is_empty());
            let off = distance(report.linear_momentum, start.linear_momentum);
            // Round-off of single precision.
            assert!(off < 2e-6 * scale, "{density}: {off} of {scale}");
            let off = distance(report.angular_momentum, start.angular_momentum);
            assert!(off < 5e-6 * scale, "{density}: {off} of {scale}");
        }
        assert!(touched > 0);
        let end = world.report();
        let [one, other] = [0, 1].map(|n| end.objects[n].linear_velocity[0]);
        assert!(other - one > 1.0, "they part: {one} {other}");
        // Friction takes some.
        let kept = energy(end) / energy(&start);
        assert!((0.85..1.002).contains(&kept), "{density}: {kept}");
    }
}

#[test]
fn stack_of_soft_and_rigid_boxes_bears_its_weight() {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -10.0];
    scene.cfl = 0.8;
    scene.conditions.damping = 10.0;
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.5);
    for (n, soft) in [false, true, false].into_iter().enumerate() {
        let material = match soft {
            true => elastic(Law::FixedCorotated, 2e5, 0.3),
            false => elastic(Law::Rigid, 0.0, 0.0),
        };
        let corner = [0.0, 0.0, 0.4 * n as f64];
        let id = add_box(&mut scene, material, corner, 0.05, [8, 8, 8]);
        if soft {
            scene.objects[id].solver = Solver::Lagrangian;
        }
    }
    let mut world = World::new(scene).expect("valid");
    for _ in 0..120 {
        world.step(1.0 / 60.0, &[]);
    }
    let report = world.report();
    let weight = report.objects[0].mass * 10.0 / 60.0;
    let contacts = world.contacts();
    assert_eq!(contacts.len(), 3);
    for contact in &contacts {
        let expected = match (contact.object, contact.other) {
            (_, ContactPartner::Collider(_)) => 3.0,
            (0, _) => 2.0,
            _ => 1.0,
        };
        let borne = contact.impulse[2].abs() / weight;
        assert!((borne / expected - 1.0).abs() < 0.01, "{contact:?}");
    }
    for object in &report.objects {
        assert!(norm(object.linear_velocity) < 1e-3, "{object:?}");
        assert!((object.com[0] - 0.2).abs() < 5e-3, "{object:?}");
    }
}

/// A soft ball on a grid of its own, and a block of the spatial grid of some law, which meet off their line without gravity.
fn ball_and_matter(law: Law) -> World {
    let mut scene = empty(0.125);
    let soft = elastic(Law::NeoHookean, 1e5, 0.3);
    let matter = match law {
        Law::Fluid { .. } => elastic(law, 0.0, 0.0),
        law => elastic(law, 1e5, 0.3),
    };
    let one = add_ball(&mut scene, [-0.53, 0.0, 0.0], soft, Solver::Lagrangian);
    let corner = [0.1, -0.3, -0.2];
    let other = add_box(&mut scene, matter, corner, 0.0625, [6, 8, 8]);
    scene.objects[one].linear_velocity = [0.5, 0.0, 0.0];
    scene.objects[other].linear_velocity = [-0.5, 0.0, 0.0];
    World::new(scene).expect("valid")
}

#[test]
fn solid_and_matter_on_the_grid_keep_momentum() {
    let sand = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 0.0,
    };
    let fluid = Law::Fluid {
        bulk_modulus: 2e4,
        viscosity: 0.0,
    };
    for law in [sand, fluid] {
        let mut world = ball_and_matter(law);
        let start = world.report().clone();
        let energy = |r: &StepReport| r.kinetic_energy + r.elastic_energy;
        let scale: f64 = start.objects.iter().map(|o| o.mass).sum();
        let mut touched = 0;
        for _ in 0..30 {
            let report = world.step(0.01, &[]);
            touched += usize::from(!world.contacts().is_empty());
            // Round-off of single precision.
            let off = distance(report.linear_momentum, start.linear_momentum);
            assert!(off < 3e-6 * scale, "{law:?}: {off} of {scale}");
            let off = distance(report.angular_momentum, start.angular_momentum);
            // Positions in single precision too: 1.2e-5 was measured.
            assert!(off < 3e-5 * scale, "{law:?}: {off} of {scale}");
        }
        let end = world.report();
        let speeds = [0, 1].map(|n| end.objects[n].linear_velocity[0]);
        assert!(touched > 0 && speeds[0] < 0.45, "{law:?}: {speeds:?}");
        let kept = energy(end) / energy(&start);
        println!("{law:?}: {speeds:?} {kept}");
        assert!(kept < 1.02, "{law:?}: {kept}");
        assert!(end.rollbacks == 0 && end.quarantined.is_empty());
    }
}

/// A slab on a grid of its own bears a block of the spatial grid, and the floor bears both.
#[test]
fn solid_bears_matter_on_the_grid() {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -10.0];
    scene.conditions.damping = 10.0;
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.5);
    let slab = elastic(Law::FixedCorotated, 2e5, 0.3);
    let slab = add_box(&mut scene, slab, [0.0; 3], 0.05, [12, 12, 6]);
    scene.objects[slab].solver = Solver::Lagrangian;
    let block = elastic(Law::FixedCorotated, 2e5, 0.3);
    add_box(&mut scene, block, [0.12, 0.13, 0.3], 0.05, [8, 8, 8]);
    let mut world = World::new(scene).expect("valid");
    let mut borne = 0.0;
    for frame in 0..120 {
        world.step(1.0 / 60.0, &[]);
        let contacts = world.contacts();
        let pair = contacts
            .iter()
            .find(|c| c.other == ContactPartner::Object(1));
        if frame >= 60 {
            borne -= pair.map_or(0.0, |c| c.impulse[2]);
        }
    }
    let report = world.report();
    let weight = report.objects[1].mass * 10.0;
    // Damping takes 2 % of what gravity gives in a substep.
    assert!((borne / weight - 1.0).abs() < 0.025, "{}", borne / weight);
    // Strain of the slab and of the block: 0.011 m.
    let height = report.objects[1].com[2];
    assert!((height - 0.489).abs() < 0.01, "{height}");
    assert!(norm(report.objects[1].linear_velocity) < 5e-3);
}

/// On one and three threads, and after a checkpoint in the middle of a contact.
#[test]
fn solids_and_bodies_give_the_same_bits() {
    let run = |threads: usize, restored: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| {
            let mut world = balls_that_meet(1.0);
            let mut hashes = vec![];
            for n in 0..16 {
                if restored && n == 8 {
                    let bytes = world.checkpoint();
                    world = balls_that_meet(1.0);
                    world.restore(&bytes).expect("its own");
                }
                hashes.push(world.step(0.01, &[]).state_hash);
            }
            hashes
        })
    };
    assert_eq!(run(1, false), run(3, true));
}
