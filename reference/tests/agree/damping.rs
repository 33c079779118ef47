//! Damping: velocities decay at the stated rate, whatever the substep.

use cosplat_reference::ReferenceWorld;
use cosplat_sim_core::{
    Scene, StepReport, World,
    materials::Law,
    scene::{Conditions, Transfer},
    test_scenes::{add_box, elastic, empty, falling_block, spin},
};

use crate::{distance, norm};

/// A box in free flight.
fn flight(damping: f64, gravity: f64, cfl: f64) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -gravity];
    scene.cfl = cfl;
    scene.conditions.damping = damping;
    let soft = elastic(Law::FixedCorotated, 1e5, 0.3);
    add_box(&mut scene, soft, [-0.2, -0.17, 0.06], 0.05, [8, 7, 6]);
    scene.objects[0].linear_velocity = [3.0, 0.0, 1.0];
    scene
}

#[test]
fn velocity_decays_exponentially_for_any_substep() {
    for cfl in [0.1, 0.5] {
        let mut world = World::new(flight(2.0, 0.0, cfl)).expect("valid scene");
        for _ in 0..30 {
            world.step(1.0 / 60.0, &[]);
        }
        let v = world.report().objects[0].linear_velocity;
        // Velocities are those of half a substep before.
        let left = (-2.0 * (0.5 - 0.5 * world.report().dt)).exp();
        // The product of the substeps' factors is exact but for single precision: an error of 6e-8 in each of some
        // hundred substeps.
        let error = distance(v, [3.0 * left, 0.0, left]);
        assert!(error < 3.0 * 1e-5, "{v:?} at cfl {cfl}");
    }
}

#[test]
fn a_damped_fall_ends_at_gravity_over_rate() {
    let mut world = World::new(flight(5.0, 9.81, 0.5)).expect("valid scene");
    let mut dt: f64 = 0.0;
    for _ in 0..240 {
        dt = dt.max(world.step(1.0 / 60.0, &[]).dt);
    }
    let v = world.report().objects[0].linear_velocity;
    // Symplectic Euler, v <- (v + g dt) exp(-rate dt), has its fixed point at g dt / (exp(rate dt) - 1): g / rate less
    // about g dt / 2. The start has decayed by exp(-20).
    let fixed_point = -9.81 * dt / ((5.0 * dt).exp() - 1.0);
    assert!(
        (v[2] - fixed_point).abs() < 1e-4,
        "{v:?} against {fixed_point}"
    );
    assert!(v[0].abs() < 1e-4, "{v:?}");
}

#[test]
fn both_solvers_damp_alike() {
    let mut scene = flight(4.0, 9.81, 0.5);
    scene.objects[0].velocity_gradient = spin([2.0, -3.0, 1.0]);
    let mut world = World::new(scene.clone()).expect("valid scene");
    let mut reference = ReferenceWorld::new(&scene);
    for _ in 0..12 {
        let (fast, exact) = (world.step(1.0 / 60.0, &[]), reference.step(1.0 / 60.0, &[]));
        assert_eq!(fast.substeps, exact.substeps);
        let (fast, exact) = (&fast.objects[0], &exact.objects[0]);
        // Positions and velocities are near 1 and 10: what single precision leaves after a hundred substeps.
        assert!(distance(fast.com, exact.com) < 1e-5, "{fast:?} {exact:?}");
        assert!(
            distance(fast.linear_velocity, exact.linear_velocity) < 1e-4,
            "{fast:?} {exact:?}"
        );
        assert!(
            distance(fast.angular_momentum, exact.angular_momentum)
                < 1e-3 * norm(exact.angular_momentum)
        );
    }
}

/// What transfers drop in the runs of a table.
fn dropping(transfer: Transfer, rpic_damping: f64) -> Conditions {
    Conditions {
        transfer,
        rpic_damping,
        ..Conditions::default()
    }
}

/// A single particle whose affine velocity is `gradient`, after one short substep of both solvers.
fn affine_after(conditions: Conditions, gradient: [[f64; 3]; 3]) -> [[[f64; 3]; 3]; 2] {
    let mut scene = empty(0.1);
    scene.conditions = conditions;
    let soft = elastic(Law::FixedCorotated, 1e3, 0.3);
    add_box(&mut scene, soft, [0.013, 0.024, 0.035], 0.05, [1; 3]);
    scene.objects[0].velocity_gradient = gradient;
    let mut reference = ReferenceWorld::new(&scene);
    let mut world = World::new(scene).expect("valid scene");
    world.step(1e-4, &[]);
    reference.step_with(world.substeps(), &[]);
    let c = world.affine()[0].map(f64::from);
    [
        std::array::from_fn(|i| std::array::from_fn(|j| c[3 * i + j])),
        reference.particles.affine[0],
    ]
}

#[test]
fn rpic_damping_drops_strain_rate_and_keeps_rotation() {
    let g: [[f64; 3]; 3] = [[0.3, -1.2, 0.4], [2.0, -0.5, 0.9], [-0.7, 0.1, 0.6]];
    // A lone particle without stress gets back from the grid what it gave.
    for (transfer, damping, a, b) in [
        (Transfer::Apic, 0.0, 1.0, 0.0),
        (Transfer::Apic, 0.3, 0.85, -0.15),
        (Transfer::Apic, 1.0, 0.5, -0.5),
        (Transfer::Pic, 0.0, 0.0, 0.0),
    ] {
        for c in affine_after(dropping(transfer, damping), g) {
            for (i, row) in c.iter().enumerate() {
                for (j, c) in row.iter().enumerate() {
                    let expected = a * g[i][j] + b * g[j][i];
                    // Some roundings to single precision of numbers up to 2.
                    assert!(
                        (c - expected).abs() < 3e-6,
                        "{transfer:?} {damping}: {c} {expected}"
                    );
                }
            }
        }
    }
}

/// Share of the energy that is left of a free cube's motion after some frames.
fn energy_left(conditions: Conditions, gradient: [[f64; 3]; 3], frames: u32) -> f64 {
    let mut scene = flight(0.0, 0.0, 0.5);
    scene.objects[0].linear_velocity = [0.0; 3];
    scene.objects[0].velocity_gradient = gradient;
    scene.conditions = conditions;
    let mut world = World::new(scene).expect("valid scene");
    let energy = |report: &StepReport| report.kinetic_energy + report.elastic_energy;
    let start = energy(world.report());
    for _ in 0..frames {
        world.step(1.0 / 60.0, &[]);
    }
    energy(world.report()) / start
}

/// Which PIC takes, too.
#[test]
fn rpic_damping_takes_vibrations_and_leaves_spin() {
    let spun = spin([1.0, -2.0, 1.0]);
    let sheared = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]];
    let [apic, rpic, pic] = [
        dropping(Transfer::Apic, 0.0),
        dropping(Transfer::Apic, 1.0),
        dropping(Transfer::Pic, 0.0),
    ];
    let spin_kept = energy_left(rpic.clone(), spun, 30);
    assert!(spin_kept > 0.98, "{spin_kept}");
    assert!(energy_left(pic, spun, 30) < spin_kept - 0.01);
    let [kept, dropped] = [apic, rpic].map(|c| energy_left(c, sheared, 6));
    assert!(dropped < 0.8 * kept, "{dropped} {kept}");
}

/// And not beyond.
#[test]
fn a_lone_particle_is_stable_up_to_its_transfers_limit() {
    for conditions in [
        dropping(Transfer::Apic, 0.0),
        dropping(Transfer::Apic, 0.5),
        dropping(Transfer::Apic, 1.0),
        dropping(Transfer::Pic, 0.0),
    ] {
        let mut scene = empty(0.1);
        scene.cfl = 1.0;
        scene.conditions = conditions;
        let soft = elastic(Law::FixedCorotated, 1e5, 0.3);
        add_box(&mut scene, soft, [0.013, 0.024, 0.035], 0.05, [1; 3]);
        let largest = |factor: f64| {
            let mut world = ReferenceWorld::new(&scene);
            let dt = factor * world.time_step().dt;
            world.particles.elastic[0] = [
                [1.0 + 1e-6, 0.0, 0.0],
                [0.0, 1.0 + 1e-6, 0.0],
                [0.0, 0.0, 1.0 + 1e-6],
            ];
            let mut largest = 0.0_f64;
            for _ in 0..1000 {
                world.step_with(&[dt], &[]);
                largest = largest.max((world.particles.elastic[0][0][0] - 1.0).abs());
                if largest > 0.01 {
                    break;
                }
            }
            largest
        };
        // Below it the orbit of APIC overshoots by 1 / sqrt(1 - 0.95^2) = 3.2 and all others decay; 5 % above, the fastest
        // root of z^2 - (1 + k - (omega dt)^2) z + k = 0 is -1.2 or less (k = 0), so 1e-6 is 0.01 within 60 substeps.
        let (below, above) = (largest(0.95), largest(1.05));
        assert!(below < 5e-6, "{:?}: {below:e}", scene.conditions);
        assert!(above > 0.01, "{:?}: {above:e}", scene.conditions);
    }
}

#[test]
fn rpic_damping_of_nothing_changes_no_bit() {
    let hash = |rpic_damping: f64| {
        let mut scene = falling_block(Law::NeoHookean);
        scene.conditions.rpic_damping = rpic_damping;
        let mut world = World::new(scene).expect("valid scene");
        (0..20)
            .map(|_| world.step(1.0 / 60.0, &[]).state_hash)
            .last()
    };
    // The second goes through the blending, with factors that round to those of none.
    assert_eq!(hash(0.0), hash(1e-30));
    assert_ne!(hash(0.0), hash(1e-3));
}
