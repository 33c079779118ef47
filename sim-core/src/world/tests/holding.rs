//! Forces held during a frame, colliders sent off at a velocity, and states that are kept.

use super::*;
use crate::{
    command::{Action, CommandError},
    mat3::cross,
};

const FRAME: f64 = 1.0 / 60.0;

/// A block of 216 kg in empty space, at rest.
fn floating(law: Law) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0; 3];
    let material = match law {
        Law::Rigid => elastic(law, 0.0, 0.0),
        law => elastic(law, 1e6, 0.3),
    };
    add_box(&mut scene, material, [0.0; 3], 0.1, [6, 6, 6]);
    scene
}

fn order(action: Action) -> [Command; 1] {
    [Command {
        client: 1,
        sequence: 1,
        apply_at_step: 0,
        action,
    }]
}

fn push(force: [f64; 3], torque: [f64; 3]) -> Action {
    Action::Force {
        object: 0,
        force,
        torque,
    }
}

#[test]
fn momentum_gained_is_force_times_time() {
    for law in [Law::FixedCorotated, Law::NeoHookean, Law::Rigid] {
        let mut world = World::new(floating(law)).expect("valid scene");
        let force = [30.0, -12.0, 7.0];
        let mut gained = [0.0; 3];
        for _ in 0..10 {
            let report = world.step(FRAME, &order(push(force, [0.0; 3])));
            for a in 0..3 {
                gained[a] += FRAME * force[a];
                // Sums of 216 velocities in single precision.
                let error = report.linear_momentum[a] - gained[a];
                assert!(error.abs() < 1e-5 * norm(gained), "{law:?}: {error}");
                let contact = report.objects[0].contact_impulse[a];
                assert!(contact.abs() < 1e-5 * norm(gained), "{law:?}: {contact}");
            }
        }
        // Who orders no force gets none.
        let report = world.step(FRAME, &[]);
        let drift = distance(report.linear_momentum, gained);
        assert!(drift < 1e-5 * norm(gained), "{law:?}: {drift}");
    }
}

#[test]
fn a_force_acts_throughout_the_frame_and_not_at_its_start() {
    let mut world = World::new(floating(Law::NeoHookean)).expect("valid scene");
    let (start, mass) = (
        world.report().objects[0].com,
        world.report().objects[0].mass,
    );
    let report = world.step(FRAME, &order(push([mass, 0.0, 0.0], [0.0; 3])));
    let substeps = f64::from(report.substeps);
    assert!(substeps >= 4.0, "{substeps}");
    // Velocities are given at the start of each of n substeps: the way is (1 + 1/n) times that of a steady force,
    // against twice that for an impulse at the start.
    let way = (report.objects[0].com[0] - start[0]) / (0.5 * FRAME * FRAME);
    assert!(way > 0.99 && way < 1.01 + 1.0 / substeps, "{way}");
}

#[test]
fn spin_gained_is_torque_times_time() {
    for law in [Law::NeoHookean, Law::Rigid] {
        let mut world = World::new(floating(law)).expect("valid scene");
        let torque = [0.5, -1.0, 0.75];
        let mut report = world.step(FRAME, &order(push([0.0; 3], torque)));
        for _ in 0..4 {
            report = world.step(FRAME, &order(push([0.0; 3], torque)));
        }
        let gained = torque.map(|t| 5.0 * FRAME * t);
        let state = &report.objects[0];
        // The block turns by less than 1e-3 rad meanwhile, and the arms with it.
        let error = distance(state.angular_momentum, gained);
        assert!(error < 1e-3 * norm(gained), "{law:?}: {error}");
        assert!(
            norm(report.linear_momentum) < 1e-5 * norm(gained),
            "{law:?}"
        );
    }
}

#[test]
fn a_force_at_a_point_pushes_and_turns() {
    let mut world = World::new(floating(Law::NeoHookean)).expect("valid scene");
    let com = world.report().objects[0].com;
    let point = [com[0], com[1] + 0.25, com[2]];
    let force = [20.0, 0.0, 0.0];
    let at = Action::ForceAt {
        object: 0,
        force,
        point,
        radius: 0.12,
    };
    let report = world.step(FRAME, &order(at));
    let error = report.linear_momentum[0] - FRAME * force[0];
    assert!(error.abs() < 1e-5 * FRAME * force[0], "{error}");
    let arm = std::array::from_fn(|a| point[a] - com[a]);
    let turned = report.objects[0].angular_momentum[2] / (FRAME * cross(arm, force)[2]);
    // The touched particles are up to 0.12 m from the point: their mean arm differs by up to a fifth.
    assert!((turned - 1.0).abs() < 0.2, "{turned}");
}

#[test]
fn bad_forces_are_refused_with_the_range() {
    let world = World::new(floating(Law::NeoHookean)).expect("valid scene");
    let refused = |action: Action| world.check(&action).expect_err("refused").to_string();
    assert!(refused(push([f64::NAN, 0.0, 0.0], [0.0; 3])).contains("force is NaN"));
    assert!(refused(push([0.0; 3], [f64::INFINITY, 0.0, 0.0])).contains("torque is inf"));
    assert!(refused(push([1e30, 0.0, 0.0], [0.0; 3])).contains("expected 0 to"));
    assert!(refused(push([0.0; 3], [0.0, 1e30, 0.0])).contains("angular acceleration"));
    let spin = |angular| Action::ColliderVelocity {
        collider: 0,
        linear: [0.0; 3],
        angular,
    };
    assert!(refused(spin([0.0; 3])).contains("collider 0"));
    let mut scene = floating(Law::NeoHookean);
    add_plane(
        &mut scene,
        [0.0, 0.0, -1.0],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.0,
    );
    let world = World::new(scene).expect("valid scene");
    let error = world.check(&spin([0.0, 1e3, 0.0])).expect_err("too fast");
    assert!(error.to_string().contains("angular velocity"), "{error}");
}

#[test]
fn a_collider_keeps_a_velocity_for_a_frame_and_then_stands() {
    let mut scene = floating(Law::NeoHookean);
    add_plane(
        &mut scene,
        [0.0, 0.0, -1.0],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.0,
    );
    scene.frame_rate = 60.0;
    let mut world = World::new(scene).expect("valid scene");
    let go = Action::ColliderVelocity {
        collider: 0,
        linear: [0.0, 0.0, 0.6],
        angular: [0.0, 3.0, 0.0],
    };
    world.step(FRAME, &order(go.clone()));
    world.step(FRAME, &order(go));
    let there = world.collider_pose(0);
    assert!((there.translation[2] + 0.98).abs() < 1e-12, "{there:?}");
    // Twice a twentieth of a radian.
    assert!(
        (there.rotation[1] - 0.05_f64.sin()).abs() < 1e-12,
        "{there:?}"
    );
    world.step(FRAME, &[]);
    assert_eq!(world.collider_pose(0).translation, there.translation);
}

#[test]
fn after_a_return_the_same_commands_give_the_same_hashes() {
    let mut scene = falling_block(Law::NeoHookean);
    scene.frame_rate = 60.0;
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..9 {
        world.step(FRAME, &[]);
    }
    let run = |world: &mut World, first: Action| {
        let mut hashes = vec![];
        for n in 0..12 {
            let mut orders = order(push([10.0, 0.0, 5.0 * f64::from(n)], [0.0; 3])).to_vec();
            if n == 0 {
                orders.insert(
                    0,
                    Command {
                        sequence: 0,
                        ..order(first.clone())[0].clone()
                    },
                );
            }
            let report = world.step(FRAME, &orders);
            hashes.push((report.state_hash, report.sim_time));
        }
        hashes
    };
    let first = run(&mut world, Action::Save { snapshot: 7 });
    let steps = world.report().step;
    let again = run(&mut world, Action::Restore { snapshot: 7 });
    assert_eq!(first, again);
    assert_eq!(world.report().step, steps + 12, "the count goes on");
    // A reset forgets no snapshot.
    world.step(FRAME, &order(Action::Reset));
    assert_eq!(run(&mut world, Action::Restore { snapshot: 7 }), first);
    let unknown = world.check(&Action::Restore { snapshot: 8 });
    let said = unknown.expect_err("never saved").to_string();
    assert!(said.contains('8') && said.contains("saved are 7"), "{said}");
}

#[test]
fn snapshots_are_bounded_and_can_be_replaced() {
    let mut world = World::new(floating(Law::NeoHookean)).expect("valid scene");
    for snapshot in 0..16 {
        world.step(FRAME, &order(Action::Save { snapshot }));
    }
    let one_more = world.check(&Action::Save { snapshot: 16 });
    assert!(matches!(
        one_more,
        Err(CommandError::TooManySnapshots { .. })
    ));
    assert_eq!(world.check(&Action::Save { snapshot: 3 }), Ok(()));
    assert_eq!(world.snapshots().count(), 16);
}
