//! Laws and stories of objects that take substeps of their own.

use crate::{
    Isa, StepReport, World,
    command::{Action, Command},
    materials::Law,
    scene::{Fidelity, Scene, Surface},
    test_scenes::{add_box, add_plane, elastic, empty},
};

/// Frame length [s].
const FRAME: f64 = 1.0 / 60.0;
/// Cell size [m].
const DX: f64 = 0.05;
/// Edge of the blocks [m].
const EDGE: f64 = 0.3;

/// Adds a block with its centre somewhere; waves are five times as fast in a stiff one, which is modelled in full.
fn add(scene: &mut Scene, stiff: bool, fidelity: Fidelity, centre: [f64; 3]) -> usize {
    let modulus = if stiff { 5.1e6 } else { 2e5 };
    let matter = elastic(Law::NeoHookean, modulus, 0.3);
    let corner = centre.map(|x| x - 0.5 * EDGE);
    let id = add_box(scene, matter, corner, 0.5 * DX, [12; 3]);
    scene.objects[id].fidelity = if stiff { Fidelity::Mpm } else { fidelity };
    scene.objects[id].surface.friction = Some(0.3);
    id
}

/// A stiff block hits a soft one off its centre, in nothing.
fn collision(fidelity: Fidelity) -> Scene {
    let mut scene = empty(DX);
    let stiff = add(&mut scene, true, fidelity, [-0.2, 0.05, 0.0]);
    scene.objects[stiff].linear_velocity = [1.0, 0.0, 0.0];
    add(&mut scene, false, fidelity, [0.2, -0.05, 0.03]);
    scene
}

/// Soft and stiff blocks by turns, one on the other, on a floor.
fn stack(fidelity: Fidelity, stiff: &[bool]) -> Scene {
    let mut scene = empty(DX);
    scene.gravity = [0.0, -9.81, 0.0];
    // Nothing sleeps.
    scene.tolerance = 1e-6;
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 1.0, 0.0],
        Surface::Separate,
        0.5,
    );
    for (n, &stiff) in stiff.iter().enumerate() {
        add(
            &mut scene,
            stiff,
            fidelity,
            [0.0, EDGE * (n as f64 + 0.5), 0.0],
        );
    }
    scene
}

/// Elastic, kinetic and potential energy [J].
fn energy(report: &StepReport) -> f64 {
    report.elastic_energy + report.kinetic_energy + report.potential_energy
}

/// Steps of particles in a run, over those that all together would take in the same substeps.
fn share(reports: &[StepReport], particles: usize) -> f64 {
    let steps: u64 = reports.iter().map(|r| r.particle_updates).sum();
    let substeps: u64 = reports.iter().map(|r| u64::from(r.substeps)).sum();
    steps as f64 / (substeps * particles as u64) as f64
}

fn run(world: &mut World, frames: usize) -> Vec<StepReport> {
    (0..frames).map(|_| world.step(FRAME, &[])).collect()
}

#[test]
fn a_soft_object_takes_fewer_substeps_and_momentum_is_conserved() {
    let scene = collision(Fidelity::Auto);
    let particles = scene.particles.position.len();
    let mut world = World::new(scene).expect("valid");
    let before = world.report().clone();
    let reports = run(&mut world, 24);
    let after = &reports[23];
    let p = before.linear_momentum[0];
    for a in 0..3 {
        let lost = after.linear_momentum[a] - before.linear_momentum[a];
        assert!(lost.abs() < 1e-5 * p, "{a}: {lost}");
        // About the origin, from which the first one's way is 5 cm.
        let lost = after.angular_momentum[a] - before.angular_momentum[a];
        assert!(lost.abs() < 1e-5 * p * EDGE, "{a}: {lost}");
    }
    let most = reports.iter().map(energy).fold(0.0, f64::max);
    assert!(most <= 1.0005 * energy(&before), "{most}");
    // One of the two takes a fifth of the substeps.
    let share = share(&reports, particles);
    assert!(share < 0.65, "{share}");
    let hit = after.objects[1].linear_velocity[0];
    assert!(hit > 0.5, "{hit}");
}

#[test]
fn a_collision_hardly_depends_on_whose_substeps_are_longer() {
    let ends = |fidelity| {
        let mut world = World::new(collision(fidelity)).expect("valid");
        run(&mut world, 18);
        world
            .report()
            .objects
            .iter()
            .map(|o| o.com)
            .collect::<Vec<_>>()
    };
    let (own, common) = (ends(Fidelity::Auto), ends(Fidelity::Mpm));
    // The way of the first one is 0.17 m, of which it loses a part to the transfers of the other: fewer of those take less.
    for (own, common) in own.iter().zip(&common) {
        for a in 0..3 {
            assert!((own[a] - common[a]).abs() < 0.004, "{own:?} {common:?}");
        }
    }
}

#[test]
fn soft_and_stiff_blocks_rest_on_each_other() {
    let stiff = [false, true, false];
    let scene = stack(Fidelity::Auto, &stiff);
    let particles = scene.particles.position.len();
    let mut world = World::new(scene).expect("valid");
    let mut reports = run(&mut world, 90);
    let settled: Vec<_> = world.report().objects.iter().map(|o| o.com).collect();
    reports.extend(run(&mut world, 60));
    let share = share(&reports, particles);
    assert!(share < 0.7, "{share}");
    for (object, settled) in world.report().objects.iter().zip(&settled) {
        // Stacks drift by less than a tenth of a cell.
        for a in 0..3 {
            let drift = object.com[a] - settled[a];
            assert!(drift.abs() < 0.1 * DX, "{settled:?} {:?}", object.com);
        }
    }
    let energies: Vec<f64> = reports.iter().map(energy).collect();
    let most = energies.iter().copied().fold(0.0, f64::max);
    assert!(most <= 1.0005 * energies[0], "{energies:?}");
    // And where they rest is where they rest in full.
    let mut full = World::new(stack(Fidelity::Mpm, &stiff)).expect("valid");
    run(&mut full, 150);
    for (own, full) in world.report().objects.iter().zip(&full.report().objects) {
        assert!(
            (own.com[1] - full.com[1]).abs() < 0.05 * DX,
            "{:?} {:?}",
            own.com,
            full.com
        );
    }
}

#[test]
fn what_is_apart_from_the_stiff_one_takes_whole_substeps() {
    // A soft block on the floor, a stiff one on the floor a metre beside it: each does what it does alone.
    let mut scene = stack(Fidelity::Auto, &[false]);
    add(&mut scene, true, Fidelity::Mpm, [1.0, 0.5 * EDGE, 0.0]);
    let particles = scene.particles.position.len();
    let mut world = World::new(scene).expect("valid");
    let reports = run(&mut world, 30);
    let share = share(&reports, particles);
    // One, and a fifth, of two.
    assert!(share < 0.61, "{share}");
    let mut alone = World::new(stack(Fidelity::Auto, &[false])).expect("valid");
    run(&mut alone, 30);
    let (own, alone) = (&world.report().objects[0], &alone.report().objects[0]);
    // Five substeps of the stiff one are a per cent shorter than one of its own.
    for (a, b) in [
        (own.com[1], alone.com[1]),
        (own.elastic_energy, alone.elastic_energy),
    ] {
        assert!((a - b).abs() < 0.02 * b, "{a} {b}");
    }
}

/// A block of something soft, a stiff one that is far from it, and a stone which comes to the soft one, in nothing.
fn visit(law: Law) -> Scene {
    let mut scene = empty(DX);
    add(&mut scene, true, Fidelity::Mpm, [-1.5, 0.0, 0.0]);
    let corner = [-0.5 * EDGE; 3];
    let pile = add_box(
        &mut scene,
        elastic(law, 2e5, 0.3),
        corner,
        0.5 * DX,
        [12; 3],
    );
    scene.objects[pile].fidelity = Fidelity::Auto;
    let matter = elastic(Law::Rigid, 1e6, 0.3);
    let stone = add_box(&mut scene, matter, [1.4, -0.1, -0.1], 0.5 * DX, [8; 3]);
    scene.objects[stone].linear_velocity = [-4.0, 0.0, 0.0];
    scene
}

#[test]
fn a_rigid_body_holds_up_what_it_may_come_to_and_nothing_else() {
    let sand = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 0.0,
    };
    let mut world = World::new(visit(sand)).expect("valid");
    let momentum = world.report().linear_momentum[0];
    // Of the stone nothing is a particle that takes substeps.
    let matter = 2 * 12_usize.pow(3);
    let far = share(&run(&mut world, 12), matter);
    assert!(far < 0.65, "{far}");
    // The stone is there, and sand takes common substeps where something else is near.
    run(&mut world, 6);
    let near = share(&run(&mut world, 6), matter);
    assert_eq!(near, 1.0);
    let after = world.report();
    let pushed = after.objects[1].linear_velocity[0];
    assert!(pushed < -0.5, "{pushed}");
    let lost = after.linear_momentum[0] - momentum;
    assert!(lost.abs() < 1e-5 * momentum.abs(), "{lost}");
}

#[test]
fn a_rigid_body_and_a_slow_object_hit_each_other_as_any_would() {
    let scene = visit(Law::NeoHookean);
    let before = World::new(scene.clone()).expect("valid").report().clone();
    let mut ends = vec![];
    for fidelity in [Fidelity::Auto, Fidelity::Mpm] {
        let mut scene = scene.clone();
        scene.objects[1].fidelity = fidelity;
        let mut world = World::new(scene).expect("valid");
        let reports = run(&mut world, 30);
        let share = share(&reports, 2 * 12_usize.pow(3));
        // The soft one, half of all, takes a fifth of the substeps all the time.
        assert_eq!(share < 0.65, fidelity == Fidelity::Auto, "{share}");
        let most = reports.iter().map(energy).fold(0.0, f64::max);
        assert!(most <= 1.0005 * energy(&before), "{most}");
        let (after, p) = (&reports[29], before.linear_momentum[0].abs());
        for a in 0..3 {
            let lost = after.linear_momentum[a] - before.linear_momentum[a];
            assert!(lost.abs() < 1e-5 * p, "{a}: {lost}");
            let lost = after.angular_momentum[a] - before.angular_momentum[a];
            assert!(lost.abs() < 1e-5 * p * EDGE, "{a}: {lost}");
        }
        ends.push([1, 2].map(|object: usize| after.objects[object].linear_velocity[0]));
    }
    // The stone came with 4 m/s; what transfers take differs.
    for (own, common) in ends[0].iter().zip(&ends[1]) {
        assert!((own - common).abs() < 0.05, "{ends:?}");
    }
}

/// A stiff block as heavy as water falls into a tank of it.
fn tank(fidelity: Fidelity) -> Scene {
    let mut scene = empty(DX);
    scene.gravity = [0.0, -9.81, 0.0];
    scene.tolerance = 1e-6;
    let mut wall = |point, normal| add_plane(&mut scene, point, normal, Surface::Slip, 0.0);
    wall([0.0; 3], [0.0, 1.0, 0.0]);
    for (a, sign) in [(0, 1.0), (0, -1.0), (2, 1.0), (2, -1.0)] {
        let (mut point, mut normal) = ([0.0; 3], [0.0; 3]);
        (point[a], normal[a]) = (-EDGE * sign, sign);
        wall(point, normal);
    }
    let water = Law::Fluid {
        bulk_modulus: 2e5,
        viscosity: 1.0,
    };
    let corner = [-EDGE, 0.0, -EDGE];
    let water = elastic(water, 0.0, 0.0);
    let pool = add_box(&mut scene, water, corner, 0.5 * DX, [24, 12, 24]);
    scene.objects[pool].fidelity = fidelity;
    add(&mut scene, true, fidelity, [0.0, EDGE + 0.25, 0.0]);
    scene
}

/// And lets it in.
#[test]
fn water_takes_its_own_substeps_around_a_stiff_block() {
    let ends = |fidelity| {
        let scene = tank(fidelity);
        let particles = scene.particles.position.len();
        let mut world = World::new(scene).expect("valid");
        let start = energy(world.report());
        let reports = run(&mut world, 60);
        let most = reports.iter().map(energy).fold(0.0, f64::max);
        assert!(most <= 1.0005 * start, "{most} {start}");
        let height = world.report().objects[1].com[1];
        (share(&reports, particles), height)
    };
    let [(share, own), (_, common)] = [Fidelity::Auto, Fidelity::Mpm].map(ends);
    // The water, four fifths of all, takes a fifth of the substeps.
    assert!(share < 0.45, "{share}");
    // It is less viscous where it takes fewer: the block, which floats at any depth under water, comes nearer to it.
    assert!(own < common - 0.02, "{own} {common}");
}

#[test]
fn same_bits_for_any_threads_isa_and_from_a_checkpoint() {
    let last = |threads: usize, isa: Isa, restored: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| {
            let scene = || stack(Fidelity::Auto, &[true, false]);
            let mut world = World::with_isa(scene(), isa).expect("valid");
            run(&mut world, 6);
            if restored {
                let bytes = world.checkpoint();
                world = World::with_isa(scene(), isa).expect("valid");
                world.restore(&bytes).expect("its own");
            }
            run(&mut world, 6)[5].state_hash
        })
    };
    let expected = last(1, Isa::Portable, false);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        assert_eq!(last(2, isa, false), expected, "{isa}");
    }
    assert_eq!(last(3, Isa::Portable, true), expected);
}

#[test]
fn pushes_act_on_slow_objects_as_on_any() {
    let mut scene = empty(DX);
    add(&mut scene, true, Fidelity::Mpm, [-0.5, 0.0, 0.0]);
    let soft = add(&mut scene, false, Fidelity::Auto, [0.5, 0.0, 0.0]);
    scene.gravity = [0.0, -9.81, 0.0];
    let mut world = World::new(scene).expect("valid");
    run(&mut world, 2);
    let mass = world.report().objects[soft].mass;
    let push = Command {
        apply_at_step: 0,
        client: 1,
        sequence: 1,
        action: Action::Impulse {
            object: soft,
            impulse: [0.0, 0.0, mass],
        },
    };
    world.step(FRAME, &[push]);
    run(&mut world, 2);
    let objects = &world.report().objects;
    let time = 5.0 * FRAME;
    assert!((objects[soft].linear_velocity[2] - 1.0).abs() < 1e-5);
    for object in objects {
        // Both fall as one would: velocities are those of half a substep before, of their own.
        let fallen = object.com[1] + 0.5 * 9.81 * time * time;
        assert!(fallen.abs() < 2e-6, "{fallen}");
        assert!(object.contact_impulse.iter().all(|p| p.abs() < 1e-4 * mass));
    }
}
