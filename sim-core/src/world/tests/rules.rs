//! Stories of prescribed motion, impulses, releases, pins, commanded colliders and the domain's faces.

use super::*;
use crate::{
    Action,
    scene::{
        Collider, ColliderShape, DomainPolicy, ImpulseAmount, Pose, PrescribedMotion,
        RegionImpulse, Selection, SequentialRelease, Solver, TimeSpan,
    },
    test_scenes::{busy, cube, held, upper_quarter},
};

const FRAME: f64 = 1.0 / 60.0;

fn command(action: Action) -> Command {
    Command {
        client: 1,
        sequence: 1,
        apply_at_step: 0,
        action,
    }
}

/// The cube on the spatial grid, and on one of its own.
fn cubes() -> [Scene; 2] {
    let mut own = cube();
    own.objects[0].solver = Solver::Lagrangian;
    own.cfl = 0.8;
    [cube(), own]
}

#[test]
fn what_is_held_does_not_move_until_its_time_is_over() {
    cubes().into_iter().for_each(holds_for_its_time);
}

fn holds_for_its_time(mut scene: Scene) {
    let span = TimeSpan {
        start: 0.0,
        end: 0.5,
    };
    scene.conditions.prescribed = vec![held([0.0; 3], span)];
    let ids = upper_quarter().particles(&scene);
    let mut world = World::new(scene).expect("valid scene");
    let start: Vec<[f32; 3]> = world.positions().to_vec();
    for _ in 0..30 {
        world.step(FRAME, &[]);
    }
    for &id in &ids {
        let off = distance(
            world.positions()[id as usize].map(f64::from),
            start[id as usize].map(f64::from),
        );
        match world.has_solids() {
            // Nodes with less than a tenth of held matter are not held: a hundredth of a cell.
            true => assert!(off < 1e-3, "{off}"),
            false => assert_eq!(off, 0.0),
        }
    }
    // The rest hangs on it: it sags by less than a tenth of its height.
    let sag = start[0][2] - world.positions()[0][2];
    assert!((0.0..0.04).contains(&sag), "{sag}");
    let before = world.report().objects[0].com[2];
    for _ in 0..30 {
        world.step(FRAME, &[]);
    }
    let fallen = before - world.report().objects[0].com[2];
    // Half a second of free fall, and the speed with which it swung.
    assert!((fallen - 0.5 * 9.81 * 0.25).abs() < 0.1, "{fallen}");
}

#[test]
fn prescribed_particles_translate_and_turn_exactly() {
    cubes().into_iter().for_each(translates_and_turns);
}

fn translates_and_turns(mut scene: Scene) {
    scene.gravity = [0.0; 3];
    scene.conditions.prescribed = vec![PrescribedMotion {
        angular: [0.0, 0.0, 2.0],
        ..held([0.1, 0.0, 0.3], TimeSpan::ALWAYS)
    }];
    let ids = upper_quarter().particles(&scene);
    let mut world = World::new(scene).expect("valid scene");
    let start: Vec<[f32; 3]> = world.positions().to_vec();
    for _ in 0..30 {
        world.step(FRAME, &[]);
    }
    for &id in &ids {
        let [x, y, z] = start[id as usize].map(f64::from);
        let now = world.positions()[id as usize].map(f64::from);
        // Half a second: about a fixed axis while drifting along, so the circle's centre curls by 0.1 / 2 m.
        let (s, c) = 1.0_f64.sin_cos();
        let (drift_x, drift_y) = (0.05 * s, 0.05 * (1.0 - c));
        let expected = [c * x - s * y + drift_x, s * x + c * y + drift_y, z + 0.15];
        // One Euler step of the drift per substep of a few milliseconds.
        assert!(distance(now, expected) < 1e-3, "{now:?} {expected:?}");
    }
    // The rest of the cube is dragged along.
    let state = world.report().objects[0];
    assert!(state.angular_velocity[2] > 0.5, "{state:?}");
}

#[test]
fn a_force_for_a_while_gives_its_impulse_and_is_no_contact() {
    for (mut scene, duration) in cubes()
        .into_iter()
        .flat_map(|s| [(s.clone(), 0.0), (s, 0.1)])
    {
        scene.conditions.impulses = vec![RegionImpulse {
            selection: upper_quarter(),
            amount: ImpulseAmount::Total([3.0, 0.0, 0.0]),
            start: 0.07,
            duration,
        }];
        let mut world = World::new(scene).expect("valid scene");
        let mut contact = 0.0;
        for _ in 0..20 {
            contact += norm(world.step(FRAME, &[]).objects[0].contact_impulse);
        }
        let momentum = world.report().linear_momentum[0];
        assert!((momentum - 3.0).abs() < 1e-3, "{momentum}");
        assert!(contact < 1e-2, "{contact}");
    }
}

#[test]
fn layers_fall_one_after_the_other() {
    cubes().into_iter().for_each(lets_layers_go);
}

fn lets_layers_go(mut scene: Scene) {
    scene.conditions.releases = vec![SequentialRelease {
        selection: Selection::default(),
        axis: [0.0, 0.0, 1.0],
        start_position: 0.0,
        end_position: 0.4,
        layers: 2,
        span: TimeSpan {
            start: 0.0,
            end: 0.6,
        },
    }];
    let mut world = World::new(scene).expect("valid scene");
    let start: Vec<[f32; 3]> = world.positions().to_vec();
    let mut moved = |frames: usize| -> [bool; 2] {
        for _ in 0..frames {
            world.step(FRAME, &[]);
        }
        let moved = |top: bool| {
            let layer = start.iter().zip(world.positions());
            let mut layer = layer.filter(|(x, _)| (x[2] > 0.2) == top);
            layer.any(|(a, b)| a != b)
        };
        [moved(false), moved(true)]
    };
    assert_eq!(moved(12), [false, false]);
    assert_eq!(moved(18), [true, false]);
    assert_eq!(moved(12), [true, true]);
}

#[test]
fn a_pin_holds_until_it_is_released() {
    let scene = cube();
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..6 {
        world.step(FRAME, &[]);
    }
    let before: Vec<[f32; 3]> = world.positions().to_vec();
    let pin = Action::Pin {
        object: 0,
        point: [0.0; 3],
        radius: f64::INFINITY,
    };
    world.step(FRAME, &[command(pin)]);
    for _ in 0..20 {
        world.step(FRAME, &[]);
    }
    assert_eq!(world.positions(), &before[..]);
    world.step(FRAME, &[command(Action::Release { object: 0 })]);
    for _ in 0..6 {
        world.step(FRAME, &[]);
    }
    assert!(world.positions()[0][2] < before[0][2]);
}

#[test]
fn a_command_moves_a_collider_at_even_speed_through_the_frame() {
    let mut scene = cube();
    scene.gravity = [0.0; 3];
    scene.colliders.push(Collider::fixed(
        "gripper",
        ColliderShape::Box {
            half_extents: [1.0, 1.0, 1.0],
        },
        Pose::at([0.0, 0.0, 0.2]),
        Surface::Sticky,
    ));
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().objects[0].com;
    let target = Pose::turned([0.02, 0.0, 0.22], [0.0, 0.0, 0.03]);
    let goto = command(Action::MoveCollider {
        collider: 0,
        pose: target,
    });
    let report = world.step(FRAME, &[goto]);
    // All of the cube is inside: it moves as the gripper does, at its speed, and stops with it.
    let moved: [f64; 3] = std::array::from_fn(|a| report.objects[0].com[a] - start[a]);
    assert!(distance(moved, [0.02, 0.0, 0.02]) < 1e-5, "{moved:?}");
    let v = report.objects[0].linear_velocity;
    assert!(distance(v, [1.2, 0.0, 1.2]) < 1e-3, "{v:?}");
    assert!((report.objects[0].angular_velocity[2] - 1.8).abs() < 0.01);
    assert!(distance(world.collider_pose(0).translation, target.translation) < 1e-12);
    let report = world.step(FRAME, &[]);
    assert!(norm(report.objects[0].linear_velocity) < 1e-3, "{report:?}");
    let unknown = Action::MoveCollider {
        collider: 1,
        pose: target,
    };
    let refusal = world.check(&unknown).expect_err("one collider only");
    assert!(refusal.to_string().contains("0..1"), "{refusal}");
    let far = Action::MoveCollider {
        collider: 0,
        pose: Pose::at([1e5, 0.0, 0.0]),
    };
    assert!(world.check(&far).is_err(), "no substep could follow");
    world.step(FRAME, &[command(Action::Reset)]);
    assert_eq!(world.collider_pose(0), Pose::at([0.0, 0.0, 0.2]));
}

fn thrown_at_a_face(policy: DomainPolicy) -> World {
    let mut scene = cube();
    scene.gravity = [0.0; 3];
    scene.domain.max[0] = 0.4;
    scene.objects[0].linear_velocity = [2.0, 0.0, 0.0];
    scene.conditions.domain_policy = policy;
    World::new(scene).expect("valid scene")
}

#[test]
fn the_domain_deletes_bounces_or_stops() {
    let mut world = thrown_at_a_face(DomainPolicy::Delete);
    let left: usize = (0..60)
        .map(|_| world.step(FRAME, &[]).left_domain.len())
        .sum();
    assert_eq!(left, 512);

    let mut world = thrown_at_a_face(DomainPolicy::Bounce);
    for _ in 0..30 {
        let report = world.step(FRAME, &[]);
        assert!(report.left_domain.is_empty(), "{:?}", report.left_domain);
        let farthest = world.positions().iter().map(|x| x[0]).fold(0.0, f32::max);
        assert!(farthest <= 0.4, "{farthest}");
    }
    let v = world.report().objects[0].linear_velocity[0];
    assert!((-2.0..-0.5).contains(&v), "an elastic cube comes back: {v}");

    let mut world = thrown_at_a_face(DomainPolicy::Stop);
    let mut stopped = None;
    for _ in 0..30 {
        let hash = world.report().state_hash;
        let report = world.step(FRAME, &[]);
        if report.stopped {
            assert!(!report.left_domain.is_empty());
            assert_eq!(report.state_hash, hash, "the frame was undone");
            stopped = Some(report.sim_time);
            break;
        }
    }
    // The front is 0.175 m away (the first particle sits half a spacing inside), at 2 m/s that is frame 11.
    assert!(
        stopped.is_some_and(|t| (0.08..0.14).contains(&t)),
        "{stopped:?}"
    );
    assert!(world.step(FRAME, &[]).stopped, "again");
    let back = Action::SetVelocity {
        object: 0,
        linear: [-1.0, 0.0, 0.0],
        angular: [0.0; 3],
    };
    assert!(
        !world.step(FRAME, &[command(back)]).stopped,
        "a command may free it"
    );
    assert!(world.report().sim_time > stopped.unwrap_or(f64::NAN));
}

#[test]
fn boundaries_never_show_threads_or_isa_in_the_bits() {
    let run = |isa: Isa, threads: usize| {
        let (scene, actions) = busy();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let mut world = World::with_isa(scene, isa).expect("valid scene");
            let step = |n: usize| {
                let due = actions.iter().filter(|(at, _)| *at == n);
                let due: Vec<Command> = due.map(|(_, action)| command(action.clone())).collect();
                world.step(FRAME, &due).state_hash
            };
            (0..30).map(step).collect::<Vec<u64>>()
        })
    };
    let expected = run(Isa::Portable, 1);
    for isa in [Isa::Avx2, Isa::Avx512, Isa::Portable] {
        if isa.is_available() {
            for threads in [1, 2] {
                assert_eq!(run(isa, threads), expected, "{isa} on {threads} threads");
            }
        }
    }
}

#[test]
fn a_checkpoint_remembers_moved_colliders_and_pins() {
    let (scene, actions) = busy();
    let mut world = World::new(scene.clone()).expect("valid scene");
    let step = |world: &mut World, n: usize| {
        let due = actions.iter().filter(|(at, _)| *at == n);
        let due: Vec<Command> = due.map(|(_, action)| command(action.clone())).collect();
        world.step(FRAME, &due).state_hash
    };
    for n in 0..15 {
        step(&mut world, n);
    }
    let bytes = world.checkpoint();
    let mut restored = World::new(scene).expect("valid scene");
    restored.restore(&bytes).unwrap_or_else(|e| panic!("{e}"));
    for n in 15..24 {
        let expected = step(&mut world, n);
        assert_eq!(step(&mut restored, n), expected, "frame {n}");
    }
}
