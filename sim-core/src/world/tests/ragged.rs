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

/// Largest and last energy over that at first, and the impulse of contact [N s].
struct Collided {
    highest: f64,
    last: f64,
    pressed: f64,
}

fn collide(mut scene: Scene, friction: f64, frames: usize) -> (World, Collided) {
    for object in &mut scene.objects {
        object.surface.friction = Some(friction);
    }
    let mut world = World::new(scene).expect("valid scene");
    let first = world.report().kinetic_energy;
    let (mut highest, mut pressed) = (0.0_f64, 0.0);
    for _ in 0..frames {
        let report = world.step(1.0 / 60.0, &[]);
        assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
        highest = highest.max((report.kinetic_energy + report.elastic_energy) / first);
        pressed += norm(report.objects[0].contact_impulse);
    }
    let report = world.report();
    let last = (report.kinetic_energy + report.elastic_energy) / first;
    println!("friction {friction}: highest {highest}, last {last}, impulse {pressed}");
    let collided = Collided {
        highest,
        last,
        pressed,
    };
    (world, collided)
}

#[test]
fn ragged_solids_gain_no_energy_as_they_collide() {
    for (speed, friction, frames) in [(1.0, 0.4, 90), (1.0, 0.0, 90), (0.2, 0.0, 200)] {
        let mut scene = empty(0.05);
        scene.cfl = 0.8;
        add_bush(&mut scene, [-0.4, 0.02, 0.0], [speed, 0.0, 0.0], 60);
        add_bush(&mut scene, [0.4, -0.03, 0.04], [-speed, 0.0, 0.0], 61);
        let (world, met) = collide(scene, friction, frames);
        let mass = world.report().objects[0].mass;
        assert!(met.highest < 1.001 && met.last > 0.3, "{friction}");
        assert!(met.pressed > 0.5 * mass * speed, "they met");
    }
}

/// Adds a plate so many pieces along each axis, of half a cell, about a middle.
fn add_plate(scene: &mut Scene, pieces: [u32; 3], middle: [f64; 3]) -> usize {
    let h = 0.5 * scene.dx;
    let first = scene.particles.position.len();
    let along =
        |a: usize, n: u32| middle[a] + h * (f64::from(n) + 0.5 - 0.5 * f64::from(pieces[a]));
    for x in 0..pieces[0] {
        for y in 0..pieces[1] {
            for z in 0..pieces[2] {
                let at = [along(0, x), along(1, y), along(2, z)];
                scene.particles.position.push(at);
                scene.particles.volume.push(h * h * h);
            }
        }
    }
    first
}

fn add_soft(scene: &mut Scene, first: usize, velocity: [f64; 3]) {
    let material = elastic(Law::FixedCorotated, 1e5, 0.3);
    scene.objects.push(Object {
        solver: Solver::Lagrangian,
        linear_velocity: velocity,
        ..Object::new("soft", material, first..scene.particles.position.len())
    });
}

/// Sheets one cell thick that meet by their rims, off centre: points of either are nearest to its faces, not to the rim that they came in by.
#[test]
fn thin_sheets_gain_no_energy_as_they_collide() {
    for (speed, off) in [(1.0, 0.02), (4.0, 0.02), (8.0, 0.0)] {
        let mut scene = empty(0.05);
        scene.cfl = 0.8;
        for (side, z) in [(-1.0, 0.0), (1.0, off)] {
            let first = add_plate(&mut scene, [20, 20, 2], [side * 0.35, 0.0, z]);
            add_soft(&mut scene, first, [-side * speed, 0.0, 0.0]);
        }
        let (_, met) = collide(scene, 0.0, 60);
        // At 8 m/s crushed rims lose 0.28 of it.
        assert!(met.highest < 1.002 && met.last > 0.65, "{speed} {off}");
        assert!(met.pressed > 0.0, "they met");
    }
}

/// Blocks with fins two cells thick that meet by their rims: fins are stopped by what they face, though their blocks are thick.
#[test]
fn fins_of_thick_solids_do_not_pass_through_each_other() {
    let mut scene = empty(0.05);
    scene.cfl = 0.8;
    for side in [-1.0, 1.0] {
        let first = add_plate(&mut scene, [20, 16, 4], [side * 0.3, 0.0, 0.0]);
        add_plate(&mut scene, [16, 16, 16], [side * 0.75, 0.0, 0.0]);
        add_soft(&mut scene, first, [-side * 2.0, 0.0, 0.0]);
    }
    let left = scene.objects[0].particles.clone();
    let mut world = World::new(scene).expect("valid scene");
    let mut deepest = 0.0_f32;
    for _ in 0..40 {
        world.step(1.0 / 60.0, &[]);
        let tip = |of: &[[f32; 3]]| of.iter().map(|x| x[0]).fold(f32::MIN, f32::max);
        let (mine, others) = world.positions().split_at(left.end);
        let other = others.iter().map(|x| x[0]).fold(f32::MAX, f32::min);
        deepest = deepest.max(tip(mine) - other);
    }
    println!("deepest {deepest}");
    assert!(deepest < 0.05, "{deepest}");
}
