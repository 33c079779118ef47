//! Shape matching by itself: what one pull keeps, and when it is taken back.

use super::*;
use crate::scene::{Coherence, CoherentMode};

/// Lattice spacing of particles [m]; half a cell.
const H: f64 = 0.05;

fn with(mode: CoherentMode) -> Coherence {
    Coherence { rate: 200.0, mode }
}

/// Reports the particles as they are, without a step: moments and energies by the code that reports use, not by that
/// of shape matching.
fn measured(world: &mut World) -> StepReport {
    let State {
        particles, carrier, ..
    } = &world.state;
    world.published.update(particles, *carrier, world.scene.dx);
    world.measure(&Frame::new(0.0))
}

/// A bar whose halves leave each other while it spins, stretched to where the grid is about to tear it.
fn torn() -> World {
    let mut scene = empty(2.0 * H);
    let soft = elastic(Law::NeoHookean, 2e4, 0.3);
    add_box(&mut scene, soft, [-0.4, -0.1, -0.1], H, [16, 4, 4]);
    let mut gradient = spin([1.0, -2.0, 3.0]);
    gradient[0][0] = 30.0;
    scene.objects[0].velocity_gradient = gradient;
    scene.objects[0].linear_velocity = [1.0, -0.5, 0.3];
    let mut world = World::new(scene).expect("valid");
    for _ in 0..12 {
        world.step(1.0 / 240.0, &[]);
    }
    world
}

#[test]
fn a_pull_keeps_momentum_and_never_raises_the_energy() {
    for mode in [CoherentMode::Rigid, CoherentMode::Affine] {
        let mut world = torn();
        let first = measured(&mut world);
        let length = |world: &World| {
            let x = world.positions().iter().map(|x| x[0]);
            x.clone().fold(f32::MIN, f32::max) - x.fold(f32::MAX, f32::min)
        };
        let before = length(&world);
        let mut energy = first.kinetic_energy + first.elastic_energy;
        for _ in 0..10 {
            world.match_shape(0, &with(mode), 1e-3);
            let now = measured(&mut world);
            let [one, other] = [&first, &now].map(|r| r.objects[0]);
            for a in 0..3 {
                // Single precision: 1e-5 of 32 kg at 6 m/s, the mean speed of the halves, and of their arm of 0.3 m.
                let p = now.linear_momentum[a] - first.linear_momentum[a];
                let l = now.angular_momentum[a] - first.angular_momentum[a];
                assert!(p.abs() < 2e-3 && l.abs() < 6e-4, "{mode:?}: {p:e} {l:e}");
                let way = other.com[a] - one.com[a];
                assert!(way.abs() < 1e-6, "{mode:?}: moved by {way:e} m");
            }
            let after = now.kinetic_energy + now.elastic_energy;
            // Sums of single-precision terms.
            assert!(after < energy * (1.0 + 1e-6), "{mode:?}: {after} {energy}");
            energy = after;
        }
        // The nearest affine image of a stretched bar is about as long as it is.
        if mode == CoherentMode::Rigid {
            let after = length(&world);
            assert!(after < 0.9 * before, "{after} m, was {before} m");
        }
    }
}

/// A block with `F = 1`, its particles twice as far apart as at rest, and called stretched.
fn spread(turning: [f64; 3]) -> World {
    let mut scene = empty(2.0 * H);
    let soft = elastic(Law::NeoHookean, 2e4, 0.3);
    add_box(&mut scene, soft, [-0.2; 3], H, [8; 3]);
    scene.objects[0].velocity_gradient = spin(turning);
    let mut world = World::new(scene).expect("valid");
    world.step(1e-6, &[]);
    for x in &mut world.scene.particles.position {
        *x = x.map(|x| 0.5 * x);
    }
    world.state.extremes[0].stretch_squared = 9.0;
    world
}

#[test]
fn a_pull_that_would_raise_the_energy_is_taken_back_to_the_last_bit() {
    // Toward the affine image `F` would become twice the identity, and store what nothing paid for; and what spins
    // turns faster as it shrinks.
    for (mode, turning) in [
        (CoherentMode::Affine, [0.0; 3]),
        (CoherentMode::Rigid, [1.0, 2.0, -0.5]),
    ] {
        let mut world = spread(turning);
        let before = measured(&mut world).state_hash;
        world.match_shape(0, &with(mode), 1e-3);
        assert_eq!(measured(&mut world).state_hash, before, "{mode:?}");
    }
}

#[test]
fn a_pull_moves_no_particle_by_more_than_half_a_cell() {
    let mut world = spread([0.0; 3]);
    let before = world.positions().to_vec();
    let strong = Coherence {
        rate: 1e9,
        ..with(CoherentMode::Rigid)
    };
    world.match_shape(0, &strong, 1e-3);
    measured(&mut world);
    let ways = world.positions().iter().zip(&before);
    let ways = ways.flat_map(|(x, y)| (0..3).map(|a| f64::from(x[a] - y[a]).abs()));
    let farthest = ways.fold(0.0, f64::max);
    // Half a cell is H; rounded positions.
    assert!((farthest / H - 1.0).abs() < 1e-4, "{farthest}");
}

#[test]
fn what_has_its_safe_spacing_or_another_law_is_left_alone() {
    let mut world = torn();
    world.state.extremes[0].stretch_squared = 3.9;
    let before = measured(&mut world).state_hash;
    world.match_shape(0, &with(CoherentMode::Rigid), 1e-3);
    assert_eq!(measured(&mut world).state_hash, before);
    let mut world = spread([0.0; 3]);
    world.state.materials[0].law = Law::VonMises {
        yield_stress: 1e3,
        hardening: 0.0,
    };
    let before = measured(&mut world).state_hash;
    world.match_shape(0, &with(CoherentMode::Rigid), 1e-3);
    assert_eq!(measured(&mut world).state_hash, before);
}
