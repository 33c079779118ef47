//! Stories of bodies that stand in for matter.

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
/// Height that the box is thrown from [m].
const HEIGHT: f64 = 1.0;

/// All ways to simulate what flies.
const SOLVERS: [Solver; 2] = [Solver::Spatial, Solver::Lagrangian];

/// A rubber box thrown over a floor, turning.
fn thrown(fidelity: Fidelity, law: Law, solver: Solver) -> Scene {
    let mut scene = empty(0.05);
    scene.gravity = [0.0, -9.81, 0.0];
    scene.contact.method = ContactMethod::MultiField;
    let floor = [0.0; 3];
    add_plane(&mut scene, floor, [0.0, 1.0, 0.0], Surface::Separate, 0.5);
    let id = add_box(
        &mut scene,
        elastic(law, 2e5, 0.3),
        [0.0, HEIGHT, 0.0],
        0.025,
        [8; 3],
    );
    scene.objects[id].fidelity = fidelity;
    scene.objects[id].solver = solver;
    scene.objects[id].linear_velocity = [1.0, 3.0, 0.0];
    scene.objects[id].velocity_gradient = crate::test_scenes::spin([0.5, 0.2, -1.0]);
    scene
}

fn auto(solver: Solver) -> Scene {
    thrown(Fidelity::Auto, Law::NeoHookean, solver)
}

#[test]
fn a_flying_object_is_one_body_and_lands_as_matter() {
    for solver in SOLVERS {
        let mut world = World::new(auto(solver)).expect("valid");
        let mut full = World::new(thrown(Fidelity::Mpm, Law::NeoHookean, solver)).expect("valid");
        let start = world.report().clone();
        let (mut flown, mut landed) = (0, false);
        for _ in 0..120 {
            let report = world.step(FRAME, &[]);
            let exact = full.step(FRAME, &[]);
            let [one, other] = [&report, &exact].map(|r| r.objects[0]);
            if one.level == Level::Rigid && !landed {
                flown += 1;
                assert_eq!(report.particle_updates, 0);
                // Nothing is exchanged in flight, and the way there is the same: a parabola, but for what single precision
                // rounds in a second of some metres.
                let spin = |o: &crate::ObjectState| o.angular_momentum;
                for a in 0..3 {
                    let before = start.objects[0].angular_momentum[a];
                    assert!(
                        (spin(&one)[a] - before).abs()
                            < 1e-3 * start.angular_momentum[0].abs().max(1e-3)
                    );
                    assert!(
                        (one.com[a] - other.com[a]).abs() < 1e-5,
                        "{one:?} {other:?}"
                    );
                }
                assert!(one.com[1] > 0.12, "a body where there should be matter");
            }
            landed |= one.level == Level::Mpm && one.com[1] < 0.2;
            // Penalty gives way more than nodes at a wall: a solid that lands on an edge is pressed flatter.
            let lowest = match solver {
                Solver::Spatial => 0.05,
                Solver::Lagrangian => 0.0,
            };
            let moved = report.objects[0].com[1] < lowest;
            assert!(!moved, "fell through the floor");
        }
        assert!(
            flown > 20 && landed,
            "{flown} frames in flight, landed: {landed}"
        );
    }
}

#[test]
fn the_way_with_proxies_is_that_of_full_modelling() {
    for solver in SOLVERS {
        // Until it lands for the second time: how a tumbling box bounces depends on the last digit of its attitude.
        let [mut automatic, mut full] = [Fidelity::Auto, Fidelity::Mpm].map(|fidelity| {
            let mut scene = thrown(fidelity, Law::NeoHookean, solver);
            scene.objects[0].velocity_gradient = [[0.0; 3]; 3];
            World::new(scene).expect("valid")
        });
        let (mut worst, mut way, mut last) = (0.0_f64, 0.0, full.report().objects[0].com);
        let (mut done, mut all) = (0, 0);
        for _ in 0..84 {
            let report = automatic.step(FRAME, &[]);
            done += report.particle_updates;
            all += full.step(FRAME, &[]).particle_updates;
            let [a, b] = [&automatic, &full].map(|w| w.report().objects[0].com);
            let apart = |a: [f64; 3], b: [f64; 3]| {
                (0..3).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>().sqrt()
            };
            worst = worst.max(apart(a, b));
            way += apart(b, last);
            last = b;
        }
        // What the scene's tolerance promises for its path.
        assert!(
            worst < automatic.scene().tolerance * way,
            "{worst} m on {way} m"
        );
        assert!(3 * done < 2 * all, "{done} of {all} updates");
    }
}

#[test]
fn what_matter_stores_comes_back_with_it() {
    for solver in SOLVERS {
        let mut scene = auto(solver);
        scene.gravity = [0.0; 3];
        // Set in vibration; some of it is left when its shape is steady.
        scene.objects[0].velocity_gradient = [[2.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
        scene.tolerance = 0.05;
        let mut world = World::new(scene).expect("valid");
        let mut before = world.report().clone();
        let mut booked = 0.0;
        for _ in 0..600 {
            let report = world.step(FRAME, &[]);
            booked += report.fidelity_loss;
            if report.objects[0].level == Level::Rigid {
                break;
            }
            before = report;
        }
        let flying = world.step(FRAME, &[]);
        assert_eq!(flying.objects[0].level, Level::Rigid);
        assert!(booked > 0.0 && before.elastic_energy > 0.0);
        assert_eq!(flying.elastic_energy, before.elastic_energy);
        let lost = before.kinetic_energy - flying.kinetic_energy;
        // Kinetic energies are sums over single-precision velocities.
        assert!(
            (lost - booked).abs() < 1e-4 * before.kinetic_energy,
            "{lost} J, booked {booked} J"
        );
        // A push brings the matter back, with what it stored.
        let push = Command {
            apply_at_step: 0,
            client: 1,
            sequence: 1,
            action: Action::Impulse {
                object: 0,
                impulse: [1e-3, 0.0, 0.0],
            },
        };
        let back = world.step(1e-6, &[push]);
        assert_eq!(back.objects[0].level, Level::Mpm);
        let difference = back.elastic_energy / before.elastic_energy - 1.0;
        assert!(difference.abs() < 1e-3, "{difference}");
    }
}

/// For any threads and instruction sets.
#[test]
fn rigid_proxies_are_the_same_everywhere_and_after_a_restart() {
    for solver in SOLVERS {
        let run = |isa: Isa, restart: bool| {
            let mut world = World::with_isa(auto(solver), isa).expect("valid");
            let mut hashes = Vec::new();
            for frame in 0..90 {
                hashes.push(world.step(FRAME, &[]).state_hash);
                if restart && frame == 20 {
                    assert_eq!(world.report().objects[0].level, Level::Rigid);
                    let bytes = world.checkpoint();
                    world = World::with_isa(auto(solver), isa).expect("valid");
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
fn fidelity_rigid_moves_like_a_rigid_material() {
    let mut stated =
        World::new(thrown(Fidelity::Rigid, Law::NeoHookean, Solver::Spatial)).expect("valid");
    let mut material =
        World::new(thrown(Fidelity::Mpm, Law::Rigid, Solver::Spatial)).expect("valid");
    for _ in 0..90 {
        let report = stated.step(FRAME, &[]);
        material.step(FRAME, &[]);
        assert_eq!(report.objects[0].level, Level::Rigid);
        assert_eq!(report.particle_updates, 0);
    }
    assert_eq!(stated.positions(), material.positions());
}

/// One that asks for matter in full.
#[test]
fn a_checkpoint_of_a_rigid_proxy_goes_on_in_a_full_scene() {
    for solver in SOLVERS {
        let mut world = World::new(auto(solver)).expect("valid");
        let levels: Vec<Level> = (0..12)
            .map(|_| world.step(FRAME, &[]).objects[0].level)
            .collect();
        assert_eq!(levels[11], Level::Rigid);
        let mut full = World::new(thrown(Fidelity::Mpm, Law::NeoHookean, solver)).expect("valid");
        full.restore(&world.checkpoint()).expect("the same matter");
        let before = world.report().clone();
        let report = full.step(FRAME, &[]);
        assert_eq!(report.objects[0].level, Level::Mpm);
        assert!(report.particle_updates > 0);
        let spin = |report: &crate::StepReport| report.objects[0].angular_momentum;
        for a in 0..3 {
            let lost = spin(&report)[a] - spin(&before)[a];
            assert!(lost.abs() < 1e-5 * spin(&before)[2].abs(), "{a}: {lost}");
        }
    }
}
