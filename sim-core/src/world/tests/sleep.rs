//! Stories of sleep: what lies still costs nothing, and is there when it is needed.

use crate::{
    Isa, World,
    command::{Action, Command},
    materials::Law,
    report::Level,
    scene::{ContactMethod, Fidelity, Scene, Solver, Surface},
    test_scenes::{add_box, add_plane, elastic, empty},
};

/// Frame length [s].
const FRAME: f64 = 1.0 / 60.0;

/// All ways to simulate what sleeps.
const SOLVERS: [Solver; 2] = [Solver::Spatial, Solver::Lagrangian];

/// Two soft boxes above a floor, so far apart that neither feels the other.
fn two_boxes(height: f64, solver: Solver) -> Scene {
    let mut scene = empty(0.05);
    scene.gravity = [0.0, -9.81, 0.0];
    scene.contact.method = ContactMethod::MultiField;
    if solver == Solver::Lagrangian {
        // No transfer takes what vibrates: something else must.
        scene.conditions.damping = 4.0;
    }
    let floor = [0.0, 0.02, 0.0];
    add_plane(&mut scene, floor, [0.0, 1.0, 0.0], Surface::Separate, 0.5);
    for x in [0.0, 2.0] {
        let material = elastic(Law::NeoHookean, 3e4, 0.3);
        let id = add_box(&mut scene, material, [x, height, 0.0], 0.025, [8; 3]);
        scene.objects[id].fidelity = Fidelity::Auto;
        scene.objects[id].solver = solver;
    }
    scene
}

/// Steps until both sleep; the watchdog is ten times what it takes.
fn fall_asleep(world: &mut World) -> u32 {
    for frame in 0..1200 {
        let report = world.step(FRAME, &[]);
        if report.objects.iter().all(|o| o.level == Level::Asleep) {
            return frame;
        }
    }
    panic!("awake after 20 s: {:?}", world.report().objects);
}

fn push(object: usize, impulse: [f64; 3]) -> Command {
    Command {
        apply_at_step: 0,
        client: 1,
        sequence: 1,
        action: Action::Impulse { object, impulse },
    }
}

#[test]
fn what_lies_still_sleeps_and_costs_no_update() {
    for solver in SOLVERS {
        let mut world = World::new(two_boxes(0.05, solver)).expect("valid");
        let frames = fall_asleep(&mut world);
        assert!(
            frames > 15,
            "a quarter of a second takes 15 frames, not {frames}"
        );
        let before = world.positions().to_vec();
        let report = world.step(FRAME, &[]);
        assert_eq!((report.particle_updates, report.substeps), (0, 0));
        assert!(report.particle_updates_full > 1024);
        assert_eq!(world.positions(), before);
        assert_eq!(report.kinetic_energy, 0.0);
        for object in &report.objects {
            // The floor carries it.
            let weight = object.mass * 9.81 * FRAME;
            assert!((object.contact_impulse[1] - weight).abs() < 1e-9 * weight);
            assert!(
                object.elastic_energy > 0.0,
                "what gravity presses together stays pressed"
            );
        }
    }
}

#[test]
fn sleep_moves_nothing_by_more_than_the_tolerance() {
    for solver in SOLVERS {
        let mut automatic = World::new(two_boxes(0.08, solver)).expect("valid");
        let mut scene = two_boxes(0.08, solver);
        for object in &mut scene.objects {
            object.fidelity = Fidelity::Mpm;
        }
        let mut full = World::new(scene).expect("valid");
        let frames = fall_asleep(&mut automatic) + 60;
        for _ in 0..60 {
            automatic.step(FRAME, &[]);
        }
        for _ in 0..=frames {
            full.step(FRAME, &[]);
        }
        assert_eq!(automatic.report().step, full.report().step);
        // Both were still for a while before one slept; the full model may go on to come to rest.
        let limit = (automatic.scene().tolerance * automatic.report().objects[0].radius) as f32;
        for (a, b) in automatic.positions().iter().zip(full.positions()) {
            let way: f32 = (0..3).map(|n| (a[n] - b[n]).powi(2)).sum();
            assert!(way.sqrt() < limit, "{a:?} {b:?}");
        }
    }
}

#[test]
fn a_push_wakes_its_object_and_no_other() {
    for solver in SOLVERS {
        let mut world = World::new(two_boxes(0.05, solver)).expect("valid");
        fall_asleep(&mut world);
        let mass = world.report().objects[0].mass;
        let report = world.step(FRAME, &[push(0, [0.0, 2.0 * mass, 0.0])]);
        let levels = [0, 1].map(|id| report.objects[id].level);
        assert_eq!(levels, [Level::Mpm, Level::Asleep]);
        // 2 m/s upwards, less gravity, less what the floor gives back of the pressed-together energy.
        let speed = report.objects[0].linear_velocity[1];
        assert!((speed - 2.0).abs() < 0.3, "{speed}");
    }
}

#[test]
fn what_comes_near_wakes_the_sleeper_before_it_arrives() {
    for solver in SOLVERS {
        let mut world = World::new(two_boxes(0.05, solver)).expect("valid");
        fall_asleep(&mut world);
        let mass = world.report().objects[0].mass;
        // Damping of 4 per second leaves a quarter of a metre of every metre per second.
        let speed = match solver {
            Solver::Spatial => 4.0,
            Solver::Lagrangian => 12.0,
        };
        world.step(FRAME, &[push(0, [speed * mass, 1.0 * mass, 0.0])]);
        let mut woke = false;
        for _ in 0..60 {
            let report = world.step(FRAME, &[]);
            let [one, other] = [0, 1].map(|id| report.objects[id]);
            let gap = other.com[0] - one.com[0] - 0.2;
            if other.level == Level::Mpm {
                assert!(gap > 3.0 * world.scene().dx, "woken at a gap of {gap} m");
                woke = true;
                break;
            }
            assert!(gap > 0.0, "it arrived while the other slept");
        }
        assert!(woke, "nobody woke");
    }
}

/// And so is waking.
#[test]
fn sleep_is_the_same_on_every_machine_and_after_a_restart() {
    for solver in SOLVERS {
        let run = |isa: Isa, restart: bool| {
            let mut world = World::with_isa(two_boxes(0.05, solver), isa).expect("valid");
            let mut hashes = vec![u64::from(fall_asleep(&mut world))];
            let mass = world.report().objects[0].mass;
            for frame in 0..60 {
                let commands: &[Command] = match frame {
                    5 => &[push(0, [mass, mass, 0.0])],
                    _ => &[],
                };
                hashes.push(world.step(FRAME, commands).state_hash);
                // While both sleep, and while one of them does.
                if restart && matches!(frame, 3 | 9) {
                    assert_eq!(world.report().objects[1].level, Level::Asleep);
                    let bytes = world.checkpoint();
                    world = World::with_isa(two_boxes(0.05, solver), isa).expect("valid");
                    world.restore(&bytes).expect("own checkpoint");
                }
            }
            hashes
        };
        let expected = run(Isa::Portable, false);
        assert_eq!(run(Isa::detect(), false), expected);
        assert_eq!(run(Isa::detect(), true), expected);
    }
}

#[test]
fn gravity_wakes_all_and_a_moving_collider_what_it_comes_near() {
    for solver in SOLVERS {
        let mut scene = two_boxes(0.05, solver);
        let mut wall = scene.colliders[0].clone();
        wall.name = "wall".into();
        wall.shape = crate::scene::ColliderShape::Sphere { radius: 0.1 };
        wall.pose = crate::scene::Pose::at([-1.0, 0.1, 0.1]);
        scene.colliders.push(wall);
        let mut world = World::new(scene).expect("valid");
        fall_asleep(&mut world);
        let to = crate::scene::Pose::at([-0.2, 0.1, 0.1]);
        let action = Action::MoveCollider {
            collider: 1,
            pose: to,
        };
        let report = world.step(
            FRAME,
            &[Command {
                action,
                ..push(0, [0.0; 3])
            }],
        );
        let levels = [0, 1].map(|id| report.objects[id].level);
        assert_eq!(levels, [Level::Mpm, Level::Asleep]);
        let action = Action::SetGravity {
            gravity: [0.0, -1.0, 0.0],
        };
        let report = world.step(
            FRAME,
            &[Command {
                action,
                ..push(0, [0.0; 3])
            }],
        );
        let levels = [0, 1].map(|id| report.objects[id].level);
        assert_eq!(levels, [Level::Mpm; 2]);
    }
}

/// One that models everything in full.
#[test]
fn sleepers_of_a_checkpoint_are_awake_in_a_full_scene() {
    for solver in SOLVERS {
        let mut world = World::new(two_boxes(0.05, solver)).expect("valid");
        fall_asleep(&mut world);
        let mut scene = two_boxes(0.05, solver);
        for object in &mut scene.objects {
            object.fidelity = Fidelity::Mpm;
        }
        let mut full = World::new(scene).expect("valid");
        full.restore(&world.checkpoint()).expect("the same matter");
        let report = full.step(FRAME, &[]);
        assert!(report.objects.iter().all(|o| o.level == Level::Mpm));
        let particles = full.positions().len() as u64;
        assert_eq!(
            report.particle_updates,
            particles * u64::from(report.substeps)
        );
    }
}
