//! Solids that flow, in the world: dents, materials, checkpoints, and going over to the spatial grid.

use super::*;
use crate::{
    command::Action,
    mat3::{cross, length},
    scene::Solver,
};

const PLASTICINE: Law = Law::Plasticine {
    yield_stress: 3e3,
    softening: 1e2,
};
const METAL: Law = Law::VonMises {
    yield_stress: 2e4,
    hardening: 2e4,
};

/// A box of eight particles per cell that hits a floor without friction at a speed [m/s].
fn thrown(law: Law, solver: Solver, cells: [usize; 3], speed: f64) -> Scene {
    let dx = 0.1;
    let mut scene = empty(dx);
    scene.cfl = 0.8;
    let material = elastic(law, 1e6, 0.3);
    let corner = [-0.05 * cells[0] as f64, -0.05 * cells[1] as f64, 0.02];
    let id = add_box(&mut scene, material, corner, 0.5 * dx, cells.map(|n| 2 * n));
    scene.objects[id].solver = solver;
    scene.objects[id].linear_velocity = [0.0, 0.0, -speed];
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.0,
    );
    scene
}

/// Extent along z of all particles [m].
fn height(world: &World) -> f64 {
    let all = || world.positions().iter().map(|x| f64::from(x[2]));
    all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
}

fn run(world: &mut World, frames: usize) {
    for _ in 0..frames {
        world.step(1.0 / 100.0, &[]);
    }
}

/// Mean stretch along z at rest and mean volume ratio of all particles: a turn changes neither.
fn shape(world: &World) -> [f64; 2] {
    let (mut stretch, mut volume) = (0.0, 0.0);
    for f in world.deformations() {
        let f = crate::mat3::Mat3(std::array::from_fn(|a| {
            std::array::from_fn(|b| f64::from(f[3 * a + b]))
        }));
        stretch += length(f.column(2));
        volume += f.det();
    }
    [stretch, volume].map(|sum| sum / world.deformations().len() as f64)
}

#[test]
fn plasticine_that_is_dropped_keeps_its_dent() {
    let scene = thrown(PLASTICINE, Solver::Lagrangian, [6, 6, 6], 1.5);
    let mut world = World::new(scene).expect("valid");
    run(&mut world, 60);
    let [dented, volume] = shape(&world);
    assert!(dented < 0.9, "{dented}");
    // Flow keeps the volume, and elastic strain is a few thousandths.
    assert!((volume - 1.0).abs() < 0.01, "{volume}");
    // It bounces with a fifteenth of its speed.
    let speed = world.report().objects[0].linear_velocity[2];
    assert!((0.0..0.3).contains(&speed), "{speed}");
    run(&mut world, 40);
    let [later, _] = shape(&world);
    assert!((later / dented - 1.0).abs() < 0.01, "{later} {dented}");
    assert_eq!(world.report().rollbacks, 0);
}

/// Both solvers shorten a bar that hits a floor, as Taylor's does.
#[test]
fn both_solvers_flatten_a_bar_alike() {
    let shortened = |solver| {
        let mut world = World::new(thrown(METAL, solver, [4, 4, 12], 8.0)).expect("valid");
        let start = height(&world);
        run(&mut world, 40);
        assert!(world.report().gone_over.is_empty());
        1.0 - height(&world) / start
    };
    let (spatial, lagrangian) = (shortened(Solver::Spatial), shortened(Solver::Lagrangian));
    assert!(lagrangian > 0.05, "{lagrangian}");
    // Of the shortening; the spatial solver's own changes by as much from four to six cells across.
    assert!(
        (lagrangian / spatial - 1.0).abs() < 0.15,
        "{lagrangian} {spatial}"
    );
}

#[test]
fn flow_has_the_same_bits_on_isas_and_from_checkpoints() {
    let scene = || thrown(METAL, Solver::Lagrangian, [4, 4, 6], 6.0);
    let mut world = World::new(scene()).expect("valid");
    run(&mut world, 5);
    let saved = world.checkpoint();
    run(&mut world, 5);
    let hash = world.report().state_hash;
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let mut other = World::with_isa(scene(), isa).expect("valid");
        run(&mut other, 10);
        assert_eq!(other.report().state_hash, hash, "{isa}");
        other.restore(&saved).expect("of this scene");
        run(&mut other, 5);
        assert_eq!(other.report().state_hash, hash, "{isa}");
    }
}

#[test]
fn elastic_matter_that_has_flowed_keeps_its_shape() {
    let mut world = World::new(thrown(METAL, Solver::Lagrangian, [4, 4, 6], 6.0)).expect("valid");
    run(&mut world, 20);
    let dented = height(&world);
    for law in [Law::NeoHookean, Law::Hencky, Law::FixedCorotated, METAL] {
        let action = Action::SetMaterial {
            object: 0,
            region: None,
            patch: None,
            material: elastic(law, 1e6, 0.3),
        };
        world.check(&action).expect("a law for solids");
        let command = Command {
            client: 1,
            sequence: 0,
            apply_at_step: 0,
            action,
        };
        world.step(1.0 / 100.0, &[command]);
        run(&mut world, 10);
        // What is elastic of it vibrates: a few hundredths.
        assert!((height(&world) / dented - 1.0).abs() < 0.05, "{law:?}");
    }
}

/// Momenta about the origin and energy of the only object.
fn balance(world: &World) -> ([f64; 3], [f64; 3], f64) {
    let report = world.report();
    let object = &report.objects[0];
    let momentum = object.linear_velocity.map(|v| v * object.mass);
    let orbit = cross(object.com, momentum);
    let angular = std::array::from_fn(|a| object.angular_momentum[a] + orbit[a]);
    (
        momentum,
        angular,
        report.kinetic_energy + report.elastic_energy,
    )
}

#[test]
fn what_flows_too_far_goes_over_once_with_its_momentum() {
    let mut scene = thrown(METAL, Solver::Lagrangian, [4, 4, 8], 0.0);
    scene.colliders.clear();
    // Inwards along z, with a spin and a drift.
    scene.objects[0].velocity_gradient = [[0.0, 2.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, -90.0]];
    scene.objects[0].linear_velocity = [1.0, 0.0, 0.5];
    let mut world = World::new(scene.clone()).expect("valid");
    let mut gone = vec![];
    let mut before = balance(&world);
    for _ in 0..200 {
        let saved = world.checkpoint();
        let report = world.step(1.0 / 1000.0, &[]);
        let after = balance(&world);
        if let [one] = report.gone_over.as_slice() {
            assert!(one.plastic_strain > 2.0 && one.object == 0);
            // Single precision of velocities.
            for a in 0..3 {
                assert!((after.0[a] - before.0[a]).abs() < 1e-5 * length(before.0));
            }
            // What is booked is what is missing, but for what the frame's own substeps change.
            let turned = (0..3).map(|a| (after.1[a] - before.1[a] - one.angular_momentum[a]).abs());
            assert!(turned.fold(0.0, f64::max) < 0.02 * length(before.1));
            let lost = (before.2 + one.energy - after.2) / before.2;
            assert!((-0.01..0.2).contains(&lost), "{lost}");
            // Particles on the spatial grid resist turning and stretching by a quarter of a squared cell more than matter does: 0.17 of it.
            assert!(one.energy.abs() < 0.25 * before.2, "{one:?}");
            gone.push(saved);
        }
        before = after;
    }
    assert_eq!(gone.len(), 1);
    let hash = world.report().state_hash;
    assert!(world.report().quarantined.is_empty());
    // Back to when it was a solid, and over again with the same bits.
    let mut other = World::new(scene).expect("valid");
    other
        .restore(&world.checkpoint())
        .expect("after it went over");
    other.restore(&gone[0]).expect("before it went over");
    assert!(other.report().objects[0].mass > 0.0);
    while other.report().sim_time < world.report().sim_time - 1e-6 {
        other.step(1.0 / 1000.0, &[]);
    }
    assert_eq!(other.report().state_hash, hash);
}
