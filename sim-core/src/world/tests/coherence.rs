//! The coherence constraint holds objects together and costs neither momentum nor energy.

use crate::{
    World,
    materials::Law,
    scene::{Coherence, CoherentMode, Scene, Solver},
    test_scenes::{add_box, elastic, empty, one_of_each, spin},
};

/// A spinning block that also shears and stretches, made of `law`.
fn block(law: Law, coherence: Option<Coherence>) -> Scene {
    let mut scene = empty(0.1);
    let all = one_of_each();
    let material = all.iter().find(|m| m.law.id() == law.id());
    let material = material.cloned().unwrap_or_else(|| elastic(law, 3e5, 0.3));
    let id = add_box(&mut scene, material, [-0.2, -0.3, -0.1], 0.05, [8, 12, 6]);
    let mut gradient = spin([1.0, -2.0, 3.0]);
    gradient[0][1] += 2.0;
    gradient[2][2] -= 1.5;
    scene.objects[id].velocity_gradient = gradient;
    scene.objects[id].linear_velocity = [1.0, 0.5, -0.3];
    scene.objects[id].coherence = coherence;
    scene
}

fn with(rate: f64, mode: CoherentMode) -> Option<Coherence> {
    Some(Coherence { rate, mode })
}

#[test]
fn momentum_stays_and_energy_never_grows() {
    for mode in [CoherentMode::Rigid, CoherentMode::Affine] {
        let mut world = World::new(block(Law::NeoHookean, with(60.0, mode))).expect("valid");
        let start = world.report().clone();
        let mut energy = start.kinetic_energy + start.elastic_energy;
        let first = energy;
        for _ in 0..30 {
            let report = world.step(1.0 / 60.0, &[]);
            assert!(report.work.constrained_particles > 0);
            let now = report.kinetic_energy + report.elastic_energy;
            // The solver alone may gain half a per cent; the constraint only takes.
            assert!(now < energy * 1.005, "{now} after {energy}");
            energy = now;
            for a in 0..3 {
                let p = report.linear_momentum[a] - start.linear_momentum[a];
                // Single precision, of 72 kg at 1 m/s and 7 kg m^2/s: the bar of the solver's own conservation.
                assert!(p.abs() < 1e-3, "{p}");
                let l = report.angular_momentum[a] - start.angular_momentum[a];
                assert!(l.abs() < 1e-3, "{l}");
            }
        }
        assert!(energy < first);
    }
}

#[test]
fn a_strong_rigid_goal_leaves_translation_and_spin() {
    let mut world =
        World::new(block(Law::FixedCorotated, with(1e4, CoherentMode::Rigid))).expect("valid");
    for _ in 0..10 {
        world.step(1.0 / 60.0, &[]);
    }
    for c in world.affine() {
        let [a, b, d] = [
            c[0].abs() + c[4].abs() + c[8].abs(),
            c[1] + c[3],
            c[5] + c[7],
        ];
        // Against shear of 2 and stretch of 1.5 per second at the start.
        assert!(a + b.abs() + d.abs() < 0.05, "{c:?}");
    }
}

#[test]
fn what_flows_or_has_yielded_is_left_alone() {
    let sand = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 0.0,
    };
    let fluid = Law::Fluid {
        bulk_modulus: 1e5,
        viscosity: 1.0,
    };
    for law in [sand, fluid, Law::Rigid] {
        let run = |coherence| {
            let mut world = World::new(block(law, coherence)).expect("valid");
            for _ in 0..5 {
                world.step(1.0 / 60.0, &[]);
            }
            assert_eq!(world.report().work.constrained_particles, 0);
            world.positions().to_vec()
        };
        assert_eq!(run(None), run(with(100.0, CoherentMode::Affine)), "{law:?}");
    }
    // A metal that is stretched beyond its limit at once: only what has not yielded is held.
    let metal = Law::VonMises {
        yield_stress: 3e3,
        hardening: 1e4,
    };
    let scene = block(metal, with(1.0, CoherentMode::Affine));
    let all = scene.particles.position.len() as u64;
    let mut world = World::new(scene).expect("valid");
    let held = world.step(1.0 / 60.0, &[]).work.constrained_particles;
    assert!(held > 0 && held < all / 2, "{held} of {all}");
}

#[test]
fn a_bar_that_is_torn_apart_is_pulled_together() {
    // Its halves leave each other at 12 m/s: matter without coherence stretches until the grid tears it.
    let torn = |coherence: Option<Coherence>| {
        let mut scene = empty(0.1);
        let soft = elastic(Law::NeoHookean, 2e4, 0.3);
        let id = add_box(&mut scene, soft, [-0.4, -0.1, -0.1], 0.05, [16, 4, 4]);
        scene.objects[id].velocity_gradient[0][0] = 30.0;
        scene.objects[id].velocity_gradient[0][1] = 3.0;
        scene.objects[id].coherence = coherence;
        let mut world = World::new(scene).expect("valid");
        let start = world.report().clone();
        let (mut energy, mut longest) = (f64::INFINITY, 0.0_f64);
        for _ in 0..24 {
            // One substep each: velocities are those of half a substep before, so that their energy and the elastic one
            // only belong together, but for a constant, where all are equally long.
            let report = world.step(1.0 / 480.0, &[]);
            assert_eq!(report.substeps, 1);
            let now = report.kinetic_energy + report.elastic_energy;
            // What the solver may gain by itself.
            assert!(now < energy * 1.005, "{now} after {energy}");
            energy = now;
            let [p, l] = [
                report.linear_momentum[0] - start.linear_momentum[0],
                report.angular_momentum[2] - start.angular_momentum[2],
            ];
            // 1e-5 of the 190 kg m/s that either half carries, and of their lever.
            assert!(p.abs() < 4e-3 && l.abs() < 2e-3, "{p} {l}");
            let x = world.positions().iter().map(|x| x[0]);
            longest = longest.max(f64::from(x.clone().fold(f32::MIN, f32::max)));
        }
        longest
    };
    let (free, held) = (torn(None), torn(with(200.0, CoherentMode::Rigid)));
    assert!(held < 0.8 * free, "{held} {free}");
}

/// With the inertia of its particles a bar of four cells was said to spin at 3.04, one of two cells at 3.11.
#[test]
fn a_solid_is_said_to_spin_as_fast_as_it_does() {
    for across in [2, 4] {
        let mut scene = empty(0.0125);
        let cells = [64, 2 * across, 2 * across];
        let material = elastic(Law::NeoHookean, 1e6, 0.0);
        let id = add_box(&mut scene, material, [-0.2, -0.025, -0.025], 0.00625, cells);
        scene.objects[id].solver = Solver::Lagrangian;
        scene.objects[id].velocity_gradient = spin([3.0, 0.0, 0.0]);
        let mut world = World::new(scene).expect("valid");
        for _ in 0..5 {
            let said = world.step(1.0 / 400.0, &[]).objects[0].angular_velocity;
            assert!((said[0] - 3.0).abs() < 0.002 * 3.0, "{across}: {said:?}");
        }
    }
}
