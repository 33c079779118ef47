//! Solids of ragged matter, as captured objects are: twigs a piece thick, holes, and no plane anywhere.

use super::*;
use crate::scene::{ContactSurface, Object, Solver};

/// Adds a bush: pieces of half a cell along walks that begin at its middle, as many as `twigs`.
fn add_bush(scene: &mut Scene, middle: [f64; 3], velocity: [f64; 3], twigs: u64) {
    let h = 0.5 * scene.dx;
    let first = scene.particles.position.len();
    let mut pieces = std::collections::BTreeSet::new();
    let mut seed = 0x9e37_79b9_7f4a_7c15 ^ twigs;
    let mut random = || {
        // Xorshift (Marsaglia 2003).
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed
    };
    for _ in 0..twigs {
        let mut at = [0_i64; 3];
        let towards: [i64; 3] = std::array::from_fn(|_| (random() % 2) as i64 * 2 - 1);
        for _ in 0..24 {
            pieces.insert(at);
            let axis = (random() % 3) as usize;
            at[axis] += towards[axis];
        }
    }
    for piece in pieces {
        let x = std::array::from_fn(|a| middle[a] + h * piece[a] as f64);
        scene.particles.position.push(x);
        scene.particles.volume.push(h * h * h);
    }
    let material = elastic(Law::FixedCorotated, 1e5, 0.3);
    scene.objects.push(Object {
        solver: Solver::Lagrangian,
        linear_velocity: velocity,
        surface: ContactSurface {
            friction: Some(0.4),
            restitution: None,
        },
        ..Object::new("bush", material, first..scene.particles.position.len())
    });
}

/// With friction, as matter has it. Without, these gain up to two fifths of their energy: decision 0017 tells of it.
#[test]
fn ragged_solids_gain_no_energy_as_they_collide() {
    let mut scene = empty(0.05);
    scene.cfl = 0.8;
    add_bush(&mut scene, [-0.4, 0.02, 0.0], [1.0, 0.0, 0.0], 60);
    add_bush(&mut scene, [0.4, -0.03, 0.04], [-1.0, 0.0, 0.0], 61);
    let mut world = World::new(scene).expect("valid scene");
    let first = world.report().kinetic_energy;
    let (mut highest, mut pressed) = (0.0_f64, 0.0);
    for _ in 0..90 {
        let report = world.step(1.0 / 60.0, &[]);
        assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
        let energy = (report.kinetic_energy + report.elastic_energy) / first;
        highest = highest.max(energy);
        pressed += norm(report.objects[0].contact_impulse);
    }
    let last = world.report();
    let energy = (last.kinetic_energy + last.elastic_energy) / first;
    println!("highest {highest}, last {energy}, impulse {pressed}");
    assert!(highest < 1.001 && energy > 0.3, "{highest} {energy}");
    assert!(pressed > 0.5 * last.objects[0].mass, "they met");
}
