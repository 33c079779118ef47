//! Contacts of a frame: who touched whom, where, and with which impulse.

use super::*;
use crate::report::{Contact, ContactPartner};

const FRAME: f64 = 1.0 / 60.0;
const FLOOR: ContactPartner = ContactPartner::Collider(0);

/// Impulses of a pair, summed over so many frames, and its last contact.
fn impulses(
    world: &mut World,
    frames: usize,
    pair: (usize, ContactPartner),
) -> ([f64; 3], Option<Contact>) {
    let (mut sum, mut last) = ([0.0; 3], None);
    for _ in 0..frames {
        world.step(FRAME, &[]);
        for contact in world.contacts() {
            if (contact.object, contact.other) == pair {
                for a in 0..3 {
                    sum[a] += contact.impulse[a];
                }
                last = Some(contact);
            }
        }
    }
    (sum, last)
}

/// A block of so many particles that falls onto a floor from just above it.
fn block(law: Law, corner: [f64; 3], cells: [usize; 3]) -> Scene {
    let mut scene = empty(0.1);
    scene.frame_rate = 60.0;
    scene.gravity = [0.0, 0.0, -9.81];
    let modulus = if law.is_rigid() { 0.0 } else { 1e5 };
    add_box(&mut scene, elastic(law, modulus, 0.0), corner, 0.05, cells);
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.3,
    );
    scene
}

#[test]
fn a_floor_gives_the_momentum_that_gravity_takes() {
    for law in [Law::FixedCorotated, Law::Rigid] {
        let mut world = World::new(block(law, [0.0, 0.0, 0.02], [6, 6, 4])).expect("valid scene");
        let (sum, last) = impulses(&mut world, 60, (0, FLOOR));
        let state = world.report().objects[0];
        let fallen = state.mass * (9.81 * 60.0 * FRAME + state.linear_velocity[2]);
        // Velocities are half a substep, of some four milliseconds, behind the second that has passed.
        assert!(
            (sum[2] - fallen).abs() < 4e-3 * fallen,
            "{law:?}: {sum:?}, {fallen}"
        );
        let last = last.expect("it lies there");
        assert!(distance(last.normal, [0.0, 0.0, 1.0]) < 1e-9, "{last:?}");
        let below = [state.com[0], state.com[1], 0.0];
        // Half a cell: where the surface of matter is.
        assert!(distance(last.point, below) < 0.05, "{law:?}: {last:?}");
    }
}

#[test]
fn what_flies_touches_nothing() {
    let mut world = World::new(block(Law::NeoHookean, [0.0, 0.0, 2.0], [4, 4, 4])).expect("valid");
    for _ in 0..10 {
        world.step(FRAME, &[]);
        assert_eq!(world.contacts(), []);
    }
}

#[test]
fn a_pair_exchanges_what_its_momenta_change_by() {
    let soft = Law::FixedCorotated;
    for (first, second) in [(soft, soft), (Law::Rigid, soft), (Law::Rigid, Law::Rigid)] {
        let mut scene = empty(0.1);
        scene.frame_rate = 60.0;
        let modulus = |law: Law| if law.is_rigid() { 0.0 } else { 1e5 };
        add_box(
            &mut scene,
            elastic(first, modulus(first), 0.0),
            [0.0; 3],
            0.05,
            [6, 6, 6],
        );
        add_box(
            &mut scene,
            elastic(second, modulus(second), 0.0),
            [0.45, 0.0, 0.0],
            0.05,
            [6, 6, 6],
        );
        scene.objects[0].linear_velocity = [1.0, 0.0, 0.0];
        let mut world = World::new(scene).expect("valid scene");
        let start = world.report().objects[0];
        let before = start.mass * start.linear_velocity[0];
        let (sum, last) = impulses(&mut world, 40, (0, ContactPartner::Object(1)));
        let end = world.report().objects[0];
        let change = end.mass * end.linear_velocity[0] - before;
        assert!(change < -0.2 * before, "{first:?}: they met, {change}");
        // Nodes keep single precision.
        assert!(
            (sum[0] - change).abs() < 1e-3 * before,
            "{first:?}, {second:?}: {sum:?}, {change}"
        );
        let last = last.expect("they met");
        assert!(last.normal[0] < -0.99, "{last:?}");
        // Where the face of the second one stood, to a cell.
        assert!((last.point[0] - 0.45).abs() < 0.1, "{last:?}");
    }
}

#[test]
fn a_corner_shares_the_impulse_by_its_normals() {
    let mut scene = block(Law::NeoHookean, [0.0, 0.0, 0.0], [5, 5, 5]);
    add_plane(
        &mut scene,
        [-0.02, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        Surface::Separate,
        0.0,
    );
    scene.gravity = [-6.0, 0.0, -9.81];
    let mut world = World::new(scene).expect("valid scene");
    let (floor, _) = impulses(&mut world, 60, (0, FLOOR));
    world = World::new(world.scene().clone()).expect("valid scene");
    let (wall, _) = impulses(&mut world, 60, (0, ContactPartner::Collider(1)));
    let state = world.report().objects[0];
    let all: f64 = state.mass;
    let expected = [
        all * (6.0 + state.linear_velocity[0]),
        all * (9.81 + state.linear_velocity[2]),
    ];
    // Friction on the floor carries part of what presses on the wall.
    let sum = [floor[0] + wall[0], floor[2] + wall[2]];
    for a in 0..2 {
        assert!(
            (sum[a] - expected[a]).abs() < 1e-2 * expected[a],
            "{floor:?} {wall:?} {expected:?}"
        );
    }
    assert!(
        wall[0] > 0.4 * expected[0] && floor[2] > 0.8 * expected[1],
        "{floor:?} {wall:?}"
    );
}
