//! What stands where it is placed is at rest at time 0.

use crate::{
    World, WorldError,
    command::{Action, Command},
    materials::Law,
    report::Level,
    scene::{ColliderMotion, Fidelity, Scene, Solver, Surface, TimeSpan},
    test_scenes::{add_box, add_plane, elastic, empty},
};

/// Frame length [s].
const FRAME: f64 = 1.0 / 60.0;
/// Height of the column [m].
const HEIGHT: f64 = 0.4;
/// Its Young's modulus [Pa].
const MODULUS: f64 = 1e5;

/// A column of 1000 kg/m^3 that just touches the floor: its lowest particles are half a spacing above it.
fn column(settle: f64) -> Scene {
    let mut scene = empty(0.05);
    scene.gravity = [0.0, -9.81, 0.0];
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 1.0, 0.0],
        Surface::Separate,
        0.5,
    );
    let material = elastic(Law::NeoHookean, MODULUS, 0.0);
    add_box(&mut scene, material, [0.0; 3], 0.025, [8, 16, 8]);
    scene.conditions.settle = settle;
    scene
}

/// Smallest and largest height of its centre of mass within half a second [m].
fn range(world: &mut World) -> [f64; 2] {
    let mut range = [world.report().objects[0].com[1]; 2];
    for _ in 0..30 {
        let height = world.step(FRAME, &[]).objects[0].com[1];
        range = [range[0].min(height), range[1].max(height)];
    }
    range
}

#[test]
fn a_column_stands_loaded_by_its_weight_and_does_not_ring() {
    for solver in [Solver::Spatial, Solver::Lagrangian] {
        stands_loaded(solver);
    }
}

fn stands_loaded(solver: Solver) {
    let of = |settle: f64| {
        let mut scene = column(settle);
        scene.objects[0].solver = solver;
        World::new(scene).expect("valid")
    };
    let (mut loose, mut settled) = (of(0.0), of(0.5));
    let report = settled.report().clone();
    assert_eq!((report.step, report.sim_time), (0, 0.0));
    assert_eq!(report.kinetic_energy, 0.0);
    // Its motion begins anew: no substep came before.
    assert_eq!(settled.state.motion.velocity_offset, 0.0);
    // A bar under its own weight is pressed together by rho g x (2 H - x) / (2 E) up to the height x: the mean.
    let sag = 1000.0 * 9.81 * HEIGHT * HEIGHT / (3.0 * MODULUS);
    let sunk = loose.report().objects[0].com[1] - report.objects[0].com[1];
    match solver {
        // Eight cells high: a tenth for their size and that of the layer that meets the floor.
        Solver::Spatial => assert!((sunk / sag - 1.0).abs() < 0.1, "{sunk} m of {sag} m"),
        // Pressure over stiffness of the contact: 0.126 of a cell deep in the floor was measured.
        Solver::Lagrangian => {
            assert!(
                (0.0..0.13 * 0.05).contains(&(sunk - sag)),
                "{sunk} m of {sag} m"
            );
        }
    }
    let [low, high] = range(&mut loose);
    assert!(
        high - low > 1.5 * sag,
        "loaded at once it swings to both sides"
    );
    let [low, high] = range(&mut settled);
    // What is left of vibration after e^-10, and of creep.
    assert!(high - low < 0.01 * sag, "{} m", high - low);
}

/// What has a velocity begins with it.
#[test]
fn what_came_to_rest_sleeps_at_once() {
    let mut scene = column(0.5);
    scene.objects[0].fidelity = Fidelity::Auto;
    scene.contact.method = crate::scene::ContactMethod::MultiField;
    let mut still = World::new(scene.clone()).expect("valid");
    let start = still.deformations().to_vec();
    let report = still.step(FRAME, &[]);
    assert_eq!(report.objects[0].level, Level::Asleep);
    assert_eq!(report.particle_updates, 0);
    let reset = Command {
        apply_at_step: 0,
        client: 0,
        sequence: 0,
        action: Action::Reset,
    };
    still.step(0.0, &[reset]);
    assert_eq!(still.deformations(), start, "and begins anew the same way");
    scene.objects[0].linear_velocity = [0.3, 0.0, 0.0];
    let mut pushed = World::new(scene).expect("valid");
    let v = pushed.report().objects[0].linear_velocity;
    // Single precision.
    assert!((v[0] - 0.3).abs() < 1e-6 && v[1] == 0.0, "{v:?}");
    let report = pushed.step(FRAME, &[]);
    assert_eq!(report.objects[0].level, Level::Mpm);
}

#[test]
fn nothing_comes_to_rest_among_what_moves() {
    let mut scene = column(0.5);
    scene.colliders[0].motion = ColliderMotion::Velocity {
        linear: [0.1, 0.0, 0.0],
        angular: [0.0; 3],
        span: TimeSpan::ALWAYS,
    };
    let error = World::new(scene).expect_err("the floor moves");
    assert_eq!(error, WorldError::Unsettled);
}
