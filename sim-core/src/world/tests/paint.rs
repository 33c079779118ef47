//! The brush: a patch of an object gets a material of its own while it runs.

use super::*;
use crate::{
    command::{Action, CommandError, Patch},
    materials::Material,
    report::OverReason,
    scene::{Fidelity, MaterialRegion, Solver},
    world::paint::MAX_PAINTED,
};

const FRAME: f64 = 1.0 / 60.0;

/// A soft block that falls onto a floor from nearby: 512 particles, the last 256 of them its half with the larger x.
fn block() -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    add_box(&mut scene, soft(), [-0.2, -0.2, 0.05], 0.05, [8; 3]);
    add_plane(&mut scene, [0.0; 3], [0.0, 0.0, 1.0], Surface::Slip, 0.0);
    scene
}

fn soft() -> Material {
    elastic(Law::NeoHookean, 1e5, 0.3)
}

fn order(patch: Option<Patch>, material: Material) -> [Command; 1] {
    [Command {
        client: 1,
        sequence: 1,
        apply_at_step: 0,
        action: Action::SetMaterial {
            object: 0,
            region: None,
            patch,
            material,
        },
    }]
}

/// The half with the larger x, as it is at rest.
const HALF: Patch = Patch::Box {
    centre: [0.5, 0.0, 0.0],
    half: [0.5, 9.0, 9.0],
};

fn ball(point: [f64; 3], radius: f64) -> Option<Patch> {
    Some(Patch::Ball { point, radius })
}

fn snow() -> Material {
    let law = Law::Snow {
        critical_compression: 0.025,
        critical_stretch: 0.0075,
        hardening: 10.0,
    };
    elastic(law, 1.4e5, 0.2)
}

fn water() -> Material {
    let law = Law::Fluid {
        bulk_modulus: 1e5,
        viscosity: 0.1,
    };
    elastic(law, 0.0, 0.0)
}

#[test]
fn a_painted_patch_moves_as_a_region_of_the_scene() {
    let stiff = elastic(Law::NeoHookean, 4e6, 0.4);
    let mut scene = block();
    let plain = scene.clone();
    let all = scene.objects[0].particles.clone();
    let beyond = |p: &usize| scene.particles.position[*p][0] > 0.0;
    assert_eq!(
        all.clone().filter(beyond).min(),
        Some(256),
        "x runs slowest"
    );
    scene.objects[0].regions.push(MaterialRegion {
        particles: 256..all.end,
        material: stiff.clone(),
    });
    let mut region = World::new(scene).expect("valid scene");
    let mut painted = World::new(plain).expect("valid scene");
    for frame in 0..40 {
        let commands = order(Some(HALF), stiff.clone());
        let due = if frame == 0 { &commands[..] } else { &[] };
        let (a, b) = (region.step(FRAME, &[]), painted.step(FRAME, due));
        // The same particles in the same order: not a bit differs, energies included.
        assert_eq!(region.positions(), painted.positions(), "{frame}");
        assert_eq!(a.objects[0].elastic_energy, b.objects[0].elastic_energy);
        assert_eq!(a.dt_min, b.dt_min);
    }
    assert!(painted.report().objects[0].elastic_energy > 0.0);
}

#[test]
fn what_is_painted_survives_checkpoints_and_undo() {
    let mut world = World::new(block()).expect("valid scene");
    let run = |world: &mut World, frames: usize| -> Vec<u64> {
        let hashes = (0..frames).map(|_| world.step(FRAME, &[]).state_hash);
        hashes.collect()
    };
    run(&mut world, 12);
    let before = world.checkpoint();
    world.step(FRAME, &order(ball([0.1, 0.0, 0.2], 0.12), snow()));
    world.step(FRAME, &order(ball([-0.1, 0.1, 0.1], 0.1), water()));
    let after = world.checkpoint();
    let expected = run(&mut world, 10);
    // A world that never was painted takes it up, and goes back again.
    let mut other = World::new(block()).expect("valid scene");
    other.restore(&after).expect("a checkpoint of this scene");
    assert_eq!(run(&mut other, 10), expected);
    other.restore(&before).expect("a checkpoint of this scene");
    assert_eq!(other.checkpoint(), before);
    assert_eq!(other.model.parts.len(), 1);
    let undo = |sequence| Command {
        client: 1,
        sequence,
        apply_at_step: 0,
        action: Action::Undo,
    };
    world.step(0.0, &[undo(5)]);
    assert_eq!(world.model.parts.len(), 2, "one stroke is left");
    world.step(0.0, &[undo(6)]);
    assert_eq!(world.model.parts.len(), 1);
    // The step count went on: all else is as it was.
    let steps = world.state.progress.steps;
    let mut fresh = World::new(block()).expect("valid scene");
    fresh.restore(&before).expect("a checkpoint of this scene");
    fresh.state.progress.steps = steps;
    assert_eq!(run(&mut world, 10), run(&mut fresh, 10));
}

#[test]
fn painting_keeps_mass_and_momentum_under_every_law() {
    let mut world = World::new(block()).expect("valid scene");
    for _ in 0..16 {
        world.step(FRAME, &[]);
    }
    let laws = [
        snow(),
        elastic(Law::Rigid, 0.0, 0.0),
        elastic(
            Law::VonMises {
                yield_stress: 1e3,
                hardening: 0.0,
            },
            2e5,
            0.3,
        ),
        water(),
        soft(),
        elastic(Law::Rigid, 0.0, 0.0),
        water(),
        soft(),
    ];
    for (n, material) in laws.into_iter().enumerate() {
        let com = world.report().objects[0].com;
        let before = world.report().clone();
        let x = com[0] + 0.1 * (n as f64 - 4.0) / 4.0;
        // No time passes: what is left is the stroke itself.
        let after = world.step(0.0, &order(ball([x, com[1], com[2]], 0.15), material));
        let (a, b) = (&before.objects[0], &after.objects[0]);
        assert!((a.mass / b.mass - 1.0).abs() < 1e-12, "{n}");
        // Velocities of matter are of half a substep before, those of bodies of now: weight in between is what is not known.
        let slip = distance(before.linear_momentum, after.linear_momentum);
        let weight = 9.81 * world.state.motion.velocity_offset;
        assert!(slip <= (weight + 1e-6) * a.mass, "{n}: {slip:e}");
        for _ in 0..6 {
            let report = world.step(FRAME, &[]);
            assert!(report.quarantined.is_empty() && report.left_domain.is_empty());
            assert!(report.objects[0].kinetic_energy.is_finite());
        }
    }
    // One material for all takes every stroke back.
    world.step(FRAME, &order(None, soft()));
    assert_eq!(world.model.portions.len(), 1);
    assert!(world.state.bodies.of[0].is_none());
}

#[test]
fn strokes_of_one_material_are_one_part() {
    let mut world = World::new(block()).expect("valid scene");
    let stiff = elastic(Law::NeoHookean, 4e6, 0.4);
    for n in 0..100 {
        let x = -0.2 + 0.004 * f64::from(n);
        world.step(0.0, &order(ball([x, 0.0, 0.25], 0.06), stiff.clone()));
    }
    assert_eq!(world.model.parts.len(), 2);
    let count = world.model.particle_counts[1];
    // Along its middle: four of each layer across it.
    assert_eq!(count, 32);
    // Over it and beyond: still one, and nothing of the first material is left in it.
    world.step(0.0, &order(Some(HALF), snow()));
    world.step(0.0, &order(ball([0.0, 0.0, 0.25], 9.0), stiff.clone()));
    assert!(
        world.model.parts.len() <= 4,
        "{:?}",
        world.model.particle_counts
    );
    let materials = &world.state.commanded.materials;
    assert!(materials.iter().all(|m| *m == stiff), "{materials:?}");
}

#[test]
fn bad_strokes_are_refused_and_change_no_bit() {
    let mut world = World::new(block()).expect("valid scene");
    world.step(FRAME, &[]);
    let before = world.checkpoint();
    let patch_of = |patch: Option<Patch>| order(patch, snow())[0].action.clone();
    let away = Patch::Box {
        centre: [3.0; 3],
        half: [0.1; 3],
    };
    let flat = Patch::Box {
        centre: [0.0; 3],
        half: [0.1, -0.1, 0.1],
    };
    for (patch, field) in [
        (ball([f64::NAN; 3], 0.1), "point is NaN"),
        (ball([1e300; 3], 0.1), "point is"),
        (ball([0.0; 3], -1.0), "radius is -1"),
        (ball([0.0; 3], f64::NAN), "radius is NaN"),
        (Some(away), "nothing of object 0 is in the box"),
        (Some(flat), "half edge is -0.1"),
    ] {
        let error = world.check(&patch_of(patch)).expect_err("must be refused");
        assert!(error.to_string().contains(field), "{error}");
        world.step(0.0, &order(patch, snow()));
    }
    let mut again = World::new(block()).expect("valid scene");
    again.restore(&before).expect("a checkpoint of this scene");
    assert_eq!(world.step(FRAME, &[]).dt_min, again.step(FRAME, &[]).dt_min);
    assert_eq!(world.positions(), again.positions());
}

#[test]
fn only_so_many_materials_are_painted() {
    let mut world = World::new(block()).expect("valid scene");
    let tint = |n: usize| elastic(Law::NeoHookean, 1e5 + n as f64, 0.3);
    let spot = |n: usize| {
        let n = n as f64;
        ball(
            [
                -0.175 + 0.05 * (n % 8.0),
                0.025,
                0.075 + 0.05 * (n / 8.0).floor(),
            ],
            0.01,
        )
    };
    for n in 0..MAX_PAINTED {
        let stroke = order(spot(n), tint(n + 1));
        assert_eq!(world.check(&stroke[0].action), Ok(()), "{n}");
        world.step(0.0, &stroke);
    }
    assert_eq!(world.state.commanded.painted.len(), MAX_PAINTED);
    let more = order(ball([0.0, 0.1, 0.2], 0.05), tint(MAX_PAINTED + 1));
    let refused = CommandError::TooManyPainted {
        found: MAX_PAINTED + 1,
        max: MAX_PAINTED,
    };
    assert_eq!(world.check(&more[0].action), Err(refused));
    // A material that is there already may go anywhere.
    let known = order(ball([0.0, 0.1, 0.2], 0.05), tint(3));
    assert_eq!(world.check(&known[0].action), Ok(()));
}

#[test]
fn forged_strokes_in_checkpoints_are_refused() {
    let mut world = World::new(block()).expect("valid scene");
    world.step(FRAME, &order(Some(HALF), snow()));
    let sound = world.checkpoint();
    type Forgery = fn(&mut World);
    let forgeries: [Forgery; 5] = [
        |w| w.state.commanded.painted[0].part = 7,
        |w| w.state.commanded.painted[0].particles.reverse(),
        |w| w.state.commanded.painted[0].particles.push(99_999),
        |w| w.state.commanded.painted[0].particles.truncate(5),
        |w| {
            let twice = w.state.commanded.painted[0].clone();
            w.state.commanded.painted.push(twice);
        },
    ];
    for (n, forge) in forgeries.iter().enumerate() {
        let mut forged = World::new(block()).expect("valid scene");
        forged.restore(&sound).expect("a checkpoint of this scene");
        forge(&mut forged);
        let error = world.restore(&forged.checkpoint());
        assert!(error.is_err(), "{n}");
        assert_eq!(world.checkpoint(), sound, "{n}");
    }
}

/// The block on a grid of its own.
fn solid() -> Scene {
    let mut scene = block();
    scene.objects[0].solver = Solver::Lagrangian;
    scene
}

fn act(action: Action) -> [Command; 1] {
    [Command {
        client: 1,
        sequence: 9,
        apply_at_step: 0,
        action,
    }]
}

#[test]
fn a_solid_goes_over_for_what_only_spatial_matter_can_be() {
    let stiff = elastic(Law::NeoHookean, 4e6, 0.4);
    let sand = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 0.0,
    };
    let rigid = elastic(Law::Rigid, 0.0, 0.0);
    for (patch, material, reason) in [
        (Some(HALF), stiff, OverReason::Patch),
        (Some(HALF), snow(), OverReason::Law),
        (None, elastic(sand, 1e5, 0.3), OverReason::Law),
        (None, water(), OverReason::Law),
        (None, rigid, OverReason::Law),
    ] {
        let mut world = World::new(solid()).expect("valid scene");
        for _ in 0..8 {
            world.step(FRAME, &[]);
        }
        let before = world.report().clone();
        let stroke = order(patch, material);
        assert_eq!(world.check(&stroke[0].action), Ok(()));
        // No time passes: what is left is the change itself.
        let after = world.step(0.0, &stroke);
        let [gone] = after.gone_over.as_slice() else {
            panic!("{:?}", after.gone_over);
        };
        assert_eq!((gone.object, gone.reason), (0, reason));
        assert_eq!(gone.plastic_strain, 0.0, "it never flowed");
        assert!(world.model.lagrangian[0].is_none());
        let (a, b) = (&before.objects[0], &after.objects[0]);
        assert!((a.mass / b.mass - 1.0).abs() < 1e-12);
        // Single precision of velocities.
        let slip = distance(before.linear_momentum, after.linear_momentum);
        assert!(slip < 1e-6 * norm(before.linear_momentum), "{slip:e}");
        for _ in 0..20 {
            let report = world.step(FRAME, &[]);
            assert!(report.gone_over.is_empty(), "once");
            assert!(report.quarantined.is_empty() && report.left_domain.is_empty());
            assert!(report.objects[0].kinetic_energy.is_finite());
        }
    }
}

#[test]
fn what_a_change_of_grids_takes_is_booked() {
    let mut scene = solid();
    scene.objects[0].velocity_gradient = [[0.0, 4.0, 0.0], [-4.0, 0.0, 0.0], [0.0; 3]];
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..8 {
        world.step(FRAME, &[]);
    }
    let before = world.report().clone();
    // As stiff as it was, in one half: what energy changes by is the change of grids.
    let twin = Material {
        density: 1.0,
        ..soft()
    };
    let after = world.step(0.0, &order(Some(HALF), twin));
    let gone = after.gone_over[0];
    let energy = |r: &StepReport| r.kinetic_energy + r.elastic_energy;
    let missing = energy(&after) - energy(&before) - gone.energy;
    // Velocities, deformations and places in single precision.
    assert!(missing.abs() < 1e-5 * energy(&before), "{missing:e}");
    // Particles on the spatial grid resist turning by a quarter of a squared cell more than matter does: 0.055 of it.
    assert!(gone.energy.abs() < 0.08 * energy(&before), "{gone:?}");
    let turned: [f64; 3] = std::array::from_fn(|a| {
        after.angular_momentum[a] - before.angular_momentum[a] - gone.angular_momentum[a]
    });
    assert!(norm(turned) < 1e-5 * norm(before.angular_momentum));
}

#[test]
fn strokes_over_whole_parts_leave_a_solid_what_it_is() {
    let mut world = World::new(solid()).expect("valid scene");
    world.step(FRAME, &[]);
    let stiff = elastic(Law::NeoHookean, 4e6, 0.4);
    for material in [stiff, soft()] {
        let report = world.step(FRAME, &order(ball([0.0; 3], 9.0), material.clone()));
        assert!(report.gone_over.is_empty());
        assert_eq!(*world.material(0), material);
    }
    // A stroke of the material that is there already is none.
    let report = world.step(FRAME, &order(Some(HALF), soft()));
    assert!(report.gone_over.is_empty() && world.model.lagrangian[0].is_some());
}

#[test]
fn solids_asleep_and_solids_as_bodies_go_over_too() {
    let stiff = elastic(Law::NeoHookean, 4e6, 0.4);
    for fidelity in [Fidelity::Rigid, Fidelity::Static, Fidelity::Auto] {
        let mut scene = solid();
        scene.conditions.damping = 20.0;
        let mut world = World::new(scene).expect("valid scene");
        world.step(
            FRAME,
            &act(Action::SetFidelity {
                object: 0,
                fidelity,
            }),
        );
        for _ in 0..120 {
            world.step(FRAME, &[]);
        }
        if fidelity == Fidelity::Auto {
            assert!(world.state.sleeps(0));
        }
        let before = world.report().objects[0];
        let report = world.step(FRAME, &order(Some(HALF), stiff.clone()));
        assert_eq!(report.gone_over.len(), 1, "{fidelity:?}");
        let after = report.objects[0];
        assert!(
            (after.mass / before.mass - 1.0).abs() < 1e-6,
            "{fidelity:?}"
        );
        assert!(distance(after.com, before.com) < 0.01, "{fidelity:?}");
        let is_body = fidelity != Fidelity::Auto;
        assert_eq!(world.is_one_body(0), is_body, "{fidelity:?}");
        let saved = world.checkpoint();
        let hash = world.step(FRAME, &[]).state_hash;
        world.restore(&saved).expect("a checkpoint of this scene");
        assert_eq!(world.step(FRAME, &[]).state_hash, hash, "{fidelity:?}");
    }
}

#[test]
fn undo_makes_a_solid_of_it_again_and_redo_does_not() {
    let run = |world: &mut World| -> Vec<u64> {
        let hashes = (0..8).map(|_| world.step(FRAME, &[]).state_hash);
        hashes.collect()
    };
    let mut world = World::new(solid()).expect("valid scene");
    run(&mut world);
    let before = world.checkpoint();
    world.step(0.0, &order(Some(HALF), snow()));
    let painted = world.checkpoint();
    let expected = run(&mut world);
    // The same commands on the same scene are the same bits: what a replay does.
    let mut again = World::new(solid()).expect("valid scene");
    run(&mut again);
    again.step(0.0, &order(Some(HALF), snow()));
    assert_eq!(run(&mut again), expected);
    let mut other = World::new(solid()).expect("valid scene");
    other.restore(&painted).expect("a checkpoint of this scene");
    assert_eq!(run(&mut other), expected);

    let steps = |world: &mut World, steps| world.state.progress.steps = steps;
    world.step(0.0, &act(Action::Undo));
    assert!(world.model.lagrangian[0].is_some() && world.state.solids[0].is_some());
    other.restore(&before).expect("a checkpoint of this scene");
    steps(&mut other, world.state.progress.steps);
    assert_eq!(run(&mut world), run(&mut other));
    // Undoing it in the step that does it: nothing is reported.
    let [stroke] = order(Some(HALF), snow());
    let [undo] = act(Action::Undo);
    let report = world.step(0.0, &[stroke, undo]);
    assert!(report.gone_over.is_empty());
    let report = world.step(0.0, &act(Action::Redo));
    assert!(world.model.lagrangian[0].is_none() && report.gone_over.is_empty());
    assert_eq!(world.model.parts.len(), 2);
    world.step(0.0, &act(Action::Reset));
    assert!(world.model.lagrangian[0].is_some());
}

#[test]
fn what_holds_a_solid_holds_it_after_it_went_over() {
    let mut world = World::new(solid()).expect("valid scene");
    let pin = Action::Pin {
        object: 0,
        point: [0.0; 3],
        radius: f64::INFINITY,
    };
    world.step(FRAME, &act(pin));
    let held = world.positions().to_vec();
    world.step(FRAME, &order(Some(HALF), snow()));
    for _ in 0..10 {
        world.step(FRAME, &[]);
    }
    for (a, b) in held.iter().zip(world.positions()) {
        // Places in single precision.
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-6), "{a:?} {b:?}");
    }
    // Let go, it falls.
    world.step(FRAME, &act(Action::Release { object: 0 }));
    for _ in 0..5 {
        world.step(FRAME, &[]);
    }
    assert!(world.report().objects[0].linear_velocity[2] < -0.5);
}
