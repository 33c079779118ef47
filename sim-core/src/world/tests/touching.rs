//! Contacts of a frame: who touched whom, where, and with which impulse.

use super::*;
use crate::{
    report::{Contact, ContactPartner},
    scene::{ColliderMotion, ColliderShape, Keyframe},
    test_scenes::add_collider,
};

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
    let modulus = if law.is_rigid() { 0.0 } else { 1e5 };
    block_of(elastic(law, modulus, 0.0), corner, cells)
}

/// The same of any material.
fn block_of(material: Material, corner: [f64; 3], cells: [usize; 3]) -> Scene {
    let mut scene = empty(0.1);
    scene.frame_rate = 60.0;
    scene.gravity = [0.0, 0.0, -9.81];
    add_box(&mut scene, material, corner, 0.05, cells);
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

/// A block of 0.3 m and 1e5 Pa between a floor and a plate of so many metres that comes down by 20 mm in half a second.
fn squeezed(thickness: f64, law: Law) -> Scene {
    let mut scene = block(law, [0.0; 3], [6, 6, 6]);
    let half = 0.5 * thickness;
    let half_extents = [0.5, 0.5, half];
    add_collider(
        &mut scene,
        ColliderShape::Box { half_extents },
        Surface::Separate,
    );
    let at = |time, z| {
        let translation = [0.15, 0.15, z + half];
        let pose = Pose::at(translation);
        Keyframe { time, pose }
    };
    scene.colliders[1].motion = ColliderMotion::Keyframes(vec![at(0.0, 0.3), at(0.5, 0.28)]);
    scene
}

#[test]
fn what_is_squeezed_is_pushed_back_from_both_sides() {
    // A plate that acts on nodes, and one that acts on particles; both on the spatial grid.
    for thickness in [0.6, 0.1] {
        let mut world = World::new(squeezed(thickness, Law::NeoHookean)).expect("valid scene");
        for _ in 0..60 {
            world.step(FRAME, &[]);
        }
        let (frames, plate) = (60, ContactPartner::Collider(1));
        let mut copy = World::new(squeezed(thickness, Law::NeoHookean)).expect("valid scene");
        for _ in 0..60 {
            copy.step(FRAME, &[]);
        }
        let (below, floor) = impulses(&mut world, frames, (0, FLOOR));
        let (above, top) = impulses(&mut copy, frames, (0, plate));
        let time = f64::from(frames as u32) * FRAME;
        let weight = 9.81 * world.report().objects[0].mass;
        let (below, above) = (below[2] / time, -above[2] / time);
        assert!(
            (below - above - weight).abs() < 0.01 * below,
            "{thickness}: {below} N from below, {above} from above, {weight}"
        );
        // The modulus times area and strain, nothing to the sides: Poisson's ratio is 0. Of the 20 mm the spatial grid lets
        // matter keep up to a tenth of a cell on each side.
        let expected = 1e5 * 0.3 * 0.3 * (0.02 / 0.3);
        assert!(
            (0.5 * expected..expected).contains(&above),
            "{thickness}: {above} for {expected} N"
        );
        let (floor, top) = (floor.expect("it presses"), top.expect("it presses"));
        assert!(distance(floor.point, [0.15, 0.15, 0.0]) < 0.01, "{floor:?}");
        assert!(distance(top.point, [0.15, 0.15, 0.28]) < 0.01, "{top:?}");
        assert!(distance(top.normal, [0.0, 0.0, -1.0]) < 1e-6, "{top:?}");
    }
}

#[test]
fn a_plate_that_is_drawn_over_matter_tells_its_friction() {
    let mut scene = squeezed(0.6, Law::NeoHookean);
    for collider in &mut scene.colliders {
        collider.friction = Some(0.4);
    }
    let ColliderMotion::Keyframes(path) = &mut scene.colliders[1].motion else {
        panic!("it has a path");
    };
    let mut end = path[1];
    (end.time, end.pose.translation[0]) = (1.5, 0.45);
    path.push(end);
    let plate = ContactPartner::Collider(1);
    let mut world = World::new(scene.clone()).expect("valid scene");
    impulses(&mut world, 75, (0, plate));
    let (above, _) = impulses(&mut world, 15, (0, plate));
    let mut world = World::new(scene).expect("valid scene");
    impulses(&mut world, 75, (0, FLOOR));
    let (below, _) = impulses(&mut world, 15, (0, FLOOR));
    // It slides on the block, which the floor holds: a weight presses on that as well.
    let slides = above[0] / -above[2];
    assert!((slides - 0.4).abs() < 0.02, "{above:?}");
    assert!(
        (below[0] + above[0]).abs() < 0.1 * above[0],
        "{below:?} {above:?}"
    );
}

#[test]
fn sand_and_water_press_on_what_they_lie_on() {
    let sand = Law::DruckerPrager {
        friction_angle: 35.0,
        cohesion: 0.0,
    };
    let water = Law::Fluid {
        bulk_modulus: 1e5,
        viscosity: 0.1,
    };
    for material in [elastic(sand, 1e5, 0.3), elastic(water, 0.0, 0.0)] {
        let scene = block_of(material, [0.0, 0.0, 0.02], [8, 8, 4]);
        let mut world = World::new(scene).expect("valid scene");
        let (sum, _) = impulses(&mut world, 60, (0, FLOOR));
        let state = world.report().objects[0];
        let fallen = state.mass * (9.81 * 60.0 * FRAME + state.linear_velocity[2]);
        assert!((sum[2] - fallen).abs() < 4e-3 * fallen, "{sum:?} {fallen}");
    }
}
