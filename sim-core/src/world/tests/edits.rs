//! Edits while the world runs: objects put elsewhere, recast, removed and brought in, and all of it undone.

use super::*;
use crate::{
    command::{Action, CommandError, Obstacle, Place},
    report::Level,
    scene::{Fidelity, Pose, Solver},
};

const FRAME: f64 = 1.0 / 60.0;

fn order(action: Action) -> Command {
    Command {
        client: 1,
        sequence: 1,
        apply_at_step: 0,
        action,
    }
}

fn at(x: f64, y: f64, z: f64) -> Place {
    Place {
        position: Some([x, y, z]),
        rotation: None,
    }
}

fn com(world: &World, object: usize) -> [f64; 3] {
    world.report().objects[object].com
}

fn put(object: usize, place: Place) -> Command {
    order(Action::SetPose { object, place })
}

/// How the first object of a scene is modelled.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Matter,
    Body,
    Solid,
    Asleep,
}

const KINDS: [Kind; 4] = [Kind::Matter, Kind::Body, Kind::Solid, Kind::Asleep];

/// A block on a floor, and another one beside it.
fn two_blocks(kind: Kind) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    let material = || elastic(Law::NeoHookean, 1e6, 0.3);
    let first = match kind {
        Kind::Body => elastic(Law::Rigid, 0.0, 0.0),
        _ => material(),
    };
    add_box(&mut scene, first, [0.0, 0.0, 0.0], 0.05, [8, 8, 8]);
    add_box(&mut scene, material(), [2.0, 0.0, 0.0], 0.05, [8, 8, 8]);
    if kind == Kind::Solid {
        scene.objects[0].solver = Solver::Lagrangian;
    }
    if kind == Kind::Asleep {
        scene.objects[0].fidelity = Fidelity::Auto;
        scene.conditions.settle = 0.5;
    }
    add_plane(&mut scene, [0.0; 3], [0.0, 0.0, 1.0], Surface::Slip, 0.0);
    scene
}

fn started(kind: Kind) -> World {
    let mut world = World::new(two_blocks(kind)).expect("valid scene");
    for _ in 0..40 {
        world.step(FRAME, &[]);
    }
    let level = world.report().objects[0].level;
    let expected = match kind {
        Kind::Asleep => Level::Asleep,
        Kind::Body => Level::Rigid,
        _ => Level::Mpm,
    };
    assert_eq!(level, expected, "{kind:?}");
    world
}

#[test]
fn a_pose_is_where_the_object_is_next() {
    for kind in KINDS {
        let mut world = started(kind);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let place = Place {
            position: Some([-1.0, 0.4, 1.5]),
            rotation: Some([0.0, 0.0, half, half]),
        };
        let (before, substep) = (world.report().objects[0], world.report().dt);
        let report = world.step(0.0, &[put(0, place)]);
        let after = report.objects[0];
        let off = distance(after.com, [-1.0, 0.4, 1.5]);
        assert!(off < 1e-6, "{kind:?}: {:?}", after.com);
        let turned = after.rotation[2] * after.rotation[3];
        assert!((turned.abs() - 0.5).abs() < 1e-5, "{kind:?}: {after:?}");
        // Velocities of matter are those of half a substep before.
        let lag = 9.81 * substep;
        assert!(norm(after.linear_velocity) <= lag, "{kind:?}: {after:?}");
        // What it stores goes with it, and the ledger says what lifting it took.
        let stored = (after.elastic_energy - before.elastic_energy).abs();
        let lifted = before.mass * 9.81 * (after.com[2] - before.com[2]);
        assert!(stored < 1e-4 * lifted, "{kind:?}: {stored} J");
        let booked = report.edit_energy + before.kinetic_energy;
        assert!(
            (booked / lifted - 1.0).abs() < 1e-4,
            "{kind:?}: {booked} {lifted}"
        );
        assert!(report.edit_mass.abs() < 1e-9 * before.mass, "{kind:?}");
        // Then it falls, and nothing but its weight acts on it.
        let report = world.step(FRAME, &[]);
        let fallen = 1.5 - report.objects[0].com[2];
        let exact = 0.5 * 9.81 * FRAME * FRAME;
        assert!(
            (fallen / exact - 1.0).abs() < 0.05,
            "{kind:?}: {fallen} {exact}"
        );
        let touched = norm(report.objects[0].contact_impulse);
        assert!(touched < 1e-4 * before.mass, "{kind:?}: {touched} N s");
    }
}

#[test]
fn a_pose_without_room_is_refused_with_what_and_how_far() {
    for kind in KINDS {
        let world = started(kind);
        let judge = |place| world.check(&Action::SetPose { object: 0, place });
        // Half of a block deep in the other one, and a tenth of a metre deep in the floor.
        let other = com(&world, 1);
        let Err(CommandError::Overlap {
            object: 0,
            with: Obstacle::Object(1),
            way_out,
        }) = judge(at(other[0] - 0.2, other[1], other[2]))
        else {
            panic!("{kind:?}: it would overlap");
        };
        assert!((norm(way_out) - 0.2).abs() < 0.03, "{kind:?}: {way_out:?}");
        let free = at(
            other[0] - 0.2 + way_out[0],
            other[1] + way_out[1],
            other[2] + way_out[2],
        );
        assert_eq!(judge(free), Ok(()), "{kind:?}: {way_out:?}");
        let Err(CommandError::Overlap {
            with: Obstacle::Collider(0),
            way_out,
            ..
        }) = judge(at(-2.0, 0.0, 0.1))
        else {
            panic!("{kind:?}: it would be in the floor");
        };
        assert!((way_out[2] - 0.1).abs() < 0.02, "{kind:?}: {way_out:?}");
        let outside = judge(at(0.0, 1e3, 5.0)).expect_err("not in the domain");
        assert!(
            matches!(outside, CommandError::Outside { axis: 'y', .. }),
            "{outside}"
        );
        // Where it stands there is room for it.
        assert_eq!(judge(Place::default()), Ok(()), "{kind:?}");
        let turned = Place {
            rotation: Some([0.0; 4]),
            ..Place::default()
        };
        assert!(matches!(
            judge(turned),
            Err(CommandError::OutOfRange { .. })
        ));
    }
}

#[test]
fn what_is_removed_comes_back_as_it_was() {
    for kind in KINDS {
        let mut world = started(kind);
        let before = world.report().clone();
        // A solid comes back without its contacts: the next substep finds them.
        let in_contact = world.state.solids[0].as_ref().map_or(0.0, |solid| {
            solid.springs.iter().map(|grip| grip.energy).sum::<f64>()
        });
        let seen = world.visible(0).version;
        let report = world.step(FRAME, &[order(Action::Remove { object: 0 })]);
        assert_eq!(report.objects[0].level, Level::Removed, "{kind:?}");
        assert_eq!(report.objects[0].mass, 0.0, "{kind:?}");
        assert!(world.visible(0).version > seen, "{kind:?}");
        let mass = before.objects[0].mass;
        assert!((report.edit_mass / mass + 1.0).abs() < 1e-9, "{kind:?}");
        let push = Action::Impulse {
            object: 0,
            impulse: [1.0, 0.0, 0.0],
        };
        assert_eq!(world.check(&push), Err(CommandError::Removed { object: 0 }));
        // The place is free for others.
        let there = before.objects[0].com;
        let place = at(there[0], there[1], there[2] + 0.02);
        assert_eq!(world.check(&put(1, place).action), Ok(()), "{kind:?}");
        for _ in 0..10 {
            world.step(FRAME, &[]);
        }
        let back = Action::BringIn {
            object: 0,
            place: Place::default(),
        };
        let report = world.step(0.0, &[order(back.clone())]);
        let after = report.objects[0];
        assert!(
            distance(after.com, there) < 1e-6,
            "{kind:?}: {:?}",
            after.com
        );
        assert!((after.mass / mass - 1.0).abs() < 1e-9, "{kind:?}");
        let stored = before.objects[0].elastic_energy - in_contact;
        assert!(
            (after.elastic_energy - stored).abs() <= 1e-4 * stored,
            "{kind:?}"
        );
        assert!((report.edit_mass / mass - 1.0).abs() < 1e-9, "{kind:?}");
        assert_eq!(world.check(&back), Err(CommandError::Present { object: 0 }));
        for _ in 0..60 {
            let report = world.step(FRAME, &[]);
            assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
        }
        let off = distance(com(&world, 0), there);
        assert!(off < 5e-3, "{kind:?}: it rests where it was: {off} m");
    }
}

#[test]
fn who_is_put_onto_a_sleeper_falls_and_rests_on_it() {
    let mut scene = two_blocks(Kind::Asleep);
    for object in &mut scene.objects {
        object.fidelity = Fidelity::Auto;
        object.solver = Solver::Lagrangian;
        object.material.loss = 0.2;
    }
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..20 {
        world.step(FRAME, &[]);
    }
    world.step(FRAME, &[put(1, at(0.2, 0.2, 0.65))]);
    for _ in 0..90 {
        world.step(FRAME, &[]);
    }
    let height = com(&world, 1)[2];
    assert!((height - 0.6).abs() < 0.03, "on the other: {height}");
    // Taken away from below, the upper one falls.
    world.step(FRAME, &[order(Action::Remove { object: 0 })]);
    for _ in 0..90 {
        world.step(FRAME, &[]);
    }
    let height = com(&world, 1)[2];
    assert!((height - 0.2).abs() < 0.05, "on the floor: {height}");
}

#[test]
fn absent_objects_are_brought_in_where_wanted() {
    for kind in [Kind::Matter, Kind::Body, Kind::Solid] {
        let mut scene = two_blocks(kind);
        // A copy at the very place of the other: there is room for one.
        for p in scene.objects[0].particles.clone() {
            scene.particles.position[p][0] += 2.0;
        }
        scene.objects[0].present = false;
        let mut world = World::new(scene).expect("valid scene");
        assert_eq!(world.report().objects[0].level, Level::Removed);
        let hash = world.report().state_hash;
        for _ in 0..20 {
            world.step(FRAME, &[]);
        }
        let here = Place::default();
        let refused = world.check(&Action::BringIn {
            object: 0,
            place: here,
        });
        assert!(
            matches!(refused, Err(CommandError::Overlap { .. })),
            "{kind:?}"
        );
        let place = at(-1.0, 0.0, 0.25);
        let report = world.step(FRAME, &[order(Action::BringIn { object: 0, place })]);
        assert!(report.objects[0].mass > 0.0, "{kind:?}");
        assert!(
            distance(report.objects[0].com, [-1.0, 0.0, 0.25]) < 2e-3,
            "{kind:?}"
        );
        // A reset takes it away again.
        let report = world.step(0.0, &[order(Action::Reset)]);
        assert_eq!(report.objects[0].level, Level::Removed, "{kind:?}");
        assert_eq!(report.state_hash, hash, "{kind:?}");
    }
}

#[test]
fn fidelity_follows_commands_and_momentum_is_kept() {
    for kind in [Kind::Matter, Kind::Solid] {
        let mut scene = two_blocks(kind);
        scene.gravity = [0.0; 3];
        scene.colliders.clear();
        scene.objects[0].linear_velocity = [0.0, 0.3, 0.0];
        scene.objects[0].velocity_gradient = spin([0.0, 0.0, 2.0]);
        let mut world = World::new(scene).expect("valid scene");
        for _ in 0..10 {
            world.step(FRAME, &[]);
        }
        let recast = |fidelity| {
            order(Action::SetFidelity {
                object: 0,
                fidelity,
            })
        };
        let before = world.report().objects[0];
        let report = world.step(FRAME, &[recast(Fidelity::Rigid)]);
        let body = report.objects[0];
        assert_eq!(body.level, Level::Rigid, "{kind:?}");
        let momentum = |row: &crate::ObjectState| row.linear_velocity.map(|v| v * row.mass);
        let scale = norm(momentum(&before));
        assert!(
            distance(momentum(&body), momentum(&before)) < 1e-4 * scale,
            "{kind:?}"
        );
        let turning = norm(before.angular_momentum);
        let lost = distance(body.angular_momentum, before.angular_momentum);
        assert!(lost < 1e-3 * turning, "{kind:?}: {lost} of {turning}");
        // A push leaves it a body, and matter comes back only when it is told to.
        let push = Action::Impulse {
            object: 0,
            impulse: [0.0, 0.0, 1.0],
        };
        let report = world.step(FRAME, &[order(push)]);
        assert_eq!(report.objects[0].level, Level::Rigid, "{kind:?}");
        let report = world.step(FRAME, &[recast(Fidelity::Mpm)]);
        assert_eq!(report.objects[0].level, Level::Mpm, "{kind:?}");
        let lost = distance(report.objects[0].angular_momentum, before.angular_momentum);
        assert!(lost < 1e-3 * turning, "{kind:?}: {lost} of {turning}");
        // Frozen it stands, whatever pushes it.
        world.step(FRAME, &[recast(Fidelity::Static)]);
        let there = com(&world, 0);
        let push = Action::Impulse {
            object: 0,
            impulse: [5.0, 0.0, 0.0],
        };
        world.step(FRAME, &[order(push)]);
        for _ in 0..10 {
            world.step(FRAME, &[]);
        }
        assert_eq!(world.report().objects[0].level, Level::Static, "{kind:?}");
        assert_eq!(com(&world, 0), there, "{kind:?}");
        let report = world.step(FRAME, &[recast(Fidelity::Auto)]);
        assert!(report.objects[0].level == Level::Mpm, "{kind:?}");
        for _ in 0..10 {
            let report = world.step(FRAME, &[]);
            assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
        }
    }
}

#[test]
fn a_frozen_object_is_an_obstacle() {
    for kind in [Kind::Matter, Kind::Solid, Kind::Body] {
        let mut scene = two_blocks(kind);
        scene.colliders.clear();
        let mut world = World::new(scene).expect("valid scene");
        let fidelity = Fidelity::Static;
        world.step(
            FRAME,
            &[
                order(Action::SetFidelity {
                    object: 0,
                    fidelity,
                }),
                put(1, at(0.2, 0.2, 0.62)),
            ],
        );
        let there = com(&world, 0);
        for _ in 0..60 {
            world.step(FRAME, &[]);
        }
        assert_eq!(com(&world, 0), there, "{kind:?}");
        let height = com(&world, 1)[2];
        assert!((height - there[2] - 0.4).abs() < 0.05, "{kind:?}: {height}");
    }
}

#[test]
fn laws_say_how_an_object_can_be_modelled() {
    let mut scene = two_blocks(Kind::Body);
    scene.objects[1].material = elastic(
        Law::Fluid {
            bulk_modulus: 1e5,
            viscosity: 0.0,
        },
        0.0,
        0.0,
    );
    let world = World::new(scene).expect("valid scene");
    let judge = |object, fidelity| world.check(&Action::SetFidelity { object, fidelity });
    for fidelity in [Fidelity::Rigid, Fidelity::Static] {
        let refused = judge(1, fidelity).expect_err("water is no body");
        assert!(refused.to_string().contains("keeps no shape"), "{refused}");
        assert_eq!(judge(0, fidelity), Ok(()));
    }
    let refused = judge(0, Fidelity::Mpm).expect_err("rigid matter does not deform");
    assert!(
        refused.to_string().contains("give it a material"),
        "{refused}"
    );
    assert_eq!(judge(1, Fidelity::Auto), Ok(()));
}

#[test]
fn undo_is_the_state_before_and_redo_the_one_left() {
    let mut world = started(Kind::Matter);
    let undo = [order(Action::Undo)];
    assert_eq!(world.check(&Action::Undo), Err(CommandError::NothingToUndo));
    let hash = world.report().state_hash;
    let time = world.report().sim_time;
    let steps = world.report().step;
    world.step(FRAME, &[put(0, at(-1.0, 0.0, 1.0))]);
    world.step(FRAME, &[order(Action::Remove { object: 1 })]);
    let report = world.step(FRAME, &[]);
    let (later, left) = (report.sim_time, report.state_hash);
    // A touch is no edit.
    let push = Action::Impulse {
        object: 0,
        impulse: [0.0, 0.1, 0.0],
    };
    assert_eq!(world.undoable(), [2, 0]);
    let report = world.step(0.0, &undo);
    assert_eq!(
        report.objects[1].level,
        Level::Mpm,
        "the second edit is undone"
    );
    let report = world.step(0.0, &undo);
    assert_eq!((report.sim_time, report.state_hash), (time, hash));
    assert_eq!(report.step, steps + 5, "the count goes on");
    assert_eq!(world.check(&Action::Undo), Err(CommandError::NothingToUndo));
    assert_eq!(world.undoable(), [0, 2]);
    let redo = [order(Action::Redo)];
    world.step(0.0, &redo);
    let report = world.step(0.0, &redo);
    assert_eq!((report.sim_time, report.state_hash), (later, left));
    assert_eq!(world.check(&Action::Redo), Err(CommandError::NothingToRedo));
    // Another edit is another way.
    world.step(FRAME, &undo);
    world.step(FRAME, &[order(push)]);
    assert_eq!(world.undoable(), [1, 1]);
    let gravity = Action::SetGravity { gravity: [0.0; 3] };
    world.step(FRAME, &[order(gravity)]);
    assert_eq!(world.undoable(), [2, 0]);
}

#[test]
fn a_checkpoint_holds_no_states_before_edits() {
    let mut world = started(Kind::Matter);
    world.step(FRAME, &[order(Action::Remove { object: 1 })]);
    let bytes = world.checkpoint();
    let mut other = started(Kind::Matter);
    other.restore(&bytes).expect("its own state");
    assert_eq!(other.report().state_hash, world.report().state_hash);
    assert_eq!(other.check(&Action::Undo), Err(CommandError::NothingToUndo));
    assert_eq!(world.check(&Action::Undo), Ok(()));
}

/// The same edits lead to the same bits on any thread count, and from a checkpoint in the middle of them.
#[test]
fn edits_keep_the_bits() {
    let run = |kind: Kind, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a small pool").install(|| {
            let mut world = World::new(two_blocks(kind)).expect("valid scene");
            let (mut hashes, mut middle) = (vec![], vec![]);
            let recast = |fidelity| {
                order(Action::SetFidelity {
                    object: 0,
                    fidelity,
                })
            };
            let deforms = kind != Kind::Body;
            for n in 0..60 {
                let orders = match n {
                    5 => vec![put(0, at(0.1, 0.0, 0.9))],
                    12 => vec![recast(Fidelity::Rigid)],
                    20 if deforms => vec![recast(Fidelity::Mpm)],
                    24 => vec![recast(Fidelity::Static)],
                    28 => vec![order(Action::Remove { object: 0 })],
                    36 => vec![order(Action::BringIn {
                        object: 0,
                        place: at(-0.5, 0.2, 0.7),
                    })],
                    45 if deforms => vec![recast(Fidelity::Mpm)],
                    50 => vec![order(Action::Undo)],
                    55 => vec![order(Action::Redo)],
                    _ => vec![],
                };
                for order in &orders {
                    assert_eq!(world.check(&order.action), Ok(()), "{kind:?} {n}");
                }
                hashes.push(world.step(FRAME, &orders).state_hash);
                if [12, 24, 30, 40].contains(&n) {
                    middle.push((n, world.checkpoint()));
                }
            }
            (hashes, middle)
        })
    };
    for kind in KINDS {
        let (expected, middle) = run(kind, 1);
        for threads in [2, 3] {
            assert!(
                run(kind, threads).0 == expected,
                "{kind:?} on {threads} threads"
            );
        }
        let mut world = World::new(two_blocks(kind)).expect("valid scene");
        for (n, bytes) in middle {
            world.restore(&bytes).expect("its own checkpoint");
            assert_eq!(world.report().state_hash, expected[n], "{kind:?} {n}");
            let next = world.step(FRAME, &[]).state_hash;
            assert_eq!(next, expected[n + 1], "{kind:?} after {n}");
        }
    }
}

#[test]
fn what_is_only_shown_is_moved_hidden_and_seen_again() {
    let mut scene = two_blocks(Kind::Matter);
    let mut object = scene.objects[1].clone();
    (object.fidelity, object.particles) = (Fidelity::Static, 0..0);
    scene.objects.push(object);
    let mut world = World::new(scene).expect("valid scene");
    assert!(world.visible(2).placed.is_none());
    world.step(FRAME, &[put(2, at(1.0, 2.0, 3.0))]);
    let placed = world.visible(2).placed.expect("moved");
    assert_eq!(placed.position, [1.0, 2.0, 3.0]);
    let bytes = world.checkpoint();
    world.step(FRAME, &[order(Action::Remove { object: 2 })]);
    assert!(world.is_removed(2) && world.visible(2).placed.is_none());
    let place = Place {
        rotation: Some(Pose::turned([0.0; 3], [0.0, 0.0, 1.0]).rotation),
        ..Place::default()
    };
    world.step(FRAME, &[order(Action::BringIn { object: 2, place })]);
    let turned = world.visible(2).placed.expect("there again");
    assert_eq!(turned.position, placed.position);
    assert!(turned.rotation[2] > 0.4, "{turned:?}");
    world.restore(&bytes).expect("its own checkpoint");
    assert_eq!(
        world.visible(2).placed.expect("moved").rotation,
        placed.rotation
    );
    let recast = Action::SetFidelity {
        object: 2,
        fidelity: Fidelity::Mpm,
    };
    assert_eq!(
        world.check(&recast),
        Err(CommandError::StaticObject { object: 2 })
    );
}
