//! Rigid objects in the world: one body each, that meets colliders, other bodies and matter on the grid.

use super::*;

/// A brick of unequal edges that tumbles about no axis of symmetry.
fn tumbling_brick() -> Scene {
    let mut scene = empty(0.1);
    add_box(
        &mut scene,
        elastic(Law::Rigid, 0.0, 0.0),
        [-0.2, -0.1, 0.3],
        0.05,
        [9, 6, 3],
    );
    scene.objects[0].linear_velocity = [0.4, -0.3, 0.2];
    scene.objects[0].velocity_gradient = spin([3.0, 4.0, 2.0]);
    scene
}

fn at(world: &World, p: usize) -> [f64; 3] {
    world.positions()[p].map(f64::from)
}

#[test]
fn a_tumbling_brick_keeps_its_shape_and_its_momentum() {
    let scene = tumbling_brick();
    let pairs = [(0, 161), (3, 100), (17, 18), (60, 161)];
    let rest =
        pairs.map(|(a, b)| distance(scene.particles.position[a], scene.particles.position[b]));
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().clone();
    let mut spin_axis_moved = 0.0_f64;
    for _ in 0..300 {
        let report = world.step(1.0 / 60.0, &[]);
        let (now, before) = (report.objects[0], start.objects[0]);
        let way = distance(now.angular_velocity, before.angular_velocity);
        spin_axis_moved = spin_axis_moved.max(way);
    }
    let end = world.report().clone();
    // Torque-free motion of an asymmetric body: the spin wanders, so the test is not about a steady state.
    assert!(spin_axis_moved > 1.0, "{spin_axis_moved}");
    for ((a, b), rest) in pairs.into_iter().zip(rest) {
        let now = distance(at(&world, a), at(&world, b));
        // Published positions are single precision within some metres of the origin: 2.4e-7 m each way, and as
        // much again per hundred substeps of drift.
        assert!((now - rest).abs() < 1e-5, "{now} was {rest}");
    }
    let p = distance(end.linear_momentum, start.linear_momentum);
    assert!(p < 1e-12 * norm(start.linear_momentum), "{p:e}");
    let l = distance(end.angular_momentum, start.angular_momentum);
    assert!(l < 1e-12 * norm(start.angular_momentum), "{l:e}");
    // Nothing but round-off.
    let gain = end.kinetic_energy / start.kinetic_energy - 1.0;
    assert!(gain.abs() < 1e-12, "{gain:e}");
}

#[test]
fn a_rigid_ball_pushes_an_elastic_block_and_momentum_stays() {
    let mut scene = empty(0.1);
    let rigid = elastic(Law::Rigid, 0.0, 0.0);
    add_box(&mut scene, rigid, [0.0; 3], 0.05, [6; 3]);
    let soft = elastic(Law::NeoHookean, 1e5, 0.3);
    add_box(&mut scene, soft, [0.45, 0.07, 0.02], 0.05, [6; 3]);
    scene.objects[0].linear_velocity = [2.0, 0.0, 0.0];
    let mut world = World::new(scene).expect("valid scene");
    let start = world.report().clone();
    for _ in 0..60 {
        let report = world.step(1.0 / 60.0, &[]);
        assert!(report.quarantined.is_empty(), "{:?}", report.quarantined);
    }
    let end = world.report();
    assert!(end.objects[1].linear_velocity[0] > 0.5, "was not pushed");
    let p = distance(end.linear_momentum, start.linear_momentum);
    assert!(p < 1e-5 * norm(start.linear_momentum), "{p:e}");
    // About the origin the start has next to none: measured against what passes between the two.
    let l = distance(end.angular_momentum, start.angular_momentum);
    assert!(l < 1e-5 * norm(start.linear_momentum), "{l:e}");
    assert!(end.kinetic_energy + end.elastic_energy < 1.001 * start.kinetic_energy);
}

#[test]
fn an_object_can_be_frozen_into_a_rigid_one_and_thawed_again() {
    let scene = falling_block(Law::NeoHookean);
    let mut world = World::new(scene).expect("valid scene");
    for _ in 0..9 {
        world.step(1.0 / 60.0, &[]);
    }
    let becomes = |law| {
        vec![Command {
            client: 1,
            sequence: 1,
            apply_at_step: 0,
            action: crate::Action::SetMaterial {
                object: 0,
                region: None,
                patch: None,
                material: elastic(law, 1e5, 0.3),
            },
        }]
    };
    let squeezed = distance(at(&world, 0), at(&world, 335));
    world.step(1.0 / 60.0, &becomes(Law::Rigid));
    let frozen = distance(at(&world, 0), at(&world, 335));
    for _ in 0..20 {
        world.step(1.0 / 60.0, &[]);
    }
    // It keeps the shape that it had when it froze.
    let later = distance(at(&world, 0), at(&world, 335));
    assert!((later - frozen).abs() < 1e-5, "{squeezed} {frozen} {later}");
    world.step(1.0 / 60.0, &becomes(Law::NeoHookean));
    for _ in 0..5 {
        let report = world.step(1.0 / 60.0, &[]);
        assert!(report.quarantined.is_empty());
    }
}

#[test]
fn a_rigid_cube_lands_rests_and_neither_sinks_nor_jitters() {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    let rigid = elastic(Law::Rigid, 0.0, 0.0);
    add_box(&mut scene, rigid, [0.01, 0.02, 0.2], 0.05, [6; 3]);
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0, 0.0, 0.013], up, Surface::Separate, 0.4);
    let mut world = World::new(scene).expect("valid scene");
    let heights: Vec<f64> = (0..360)
        .map(|_| world.step(1.0 / 60.0, &[]).objects[0].com[2])
        .collect();
    // Its particles stop half their spacing above the floor, where they are in the cube: 0.013 + 0.15.
    let rest = heights[120];
    assert!((rest - 0.163).abs() < 0.005, "rests at {rest}");
    let (low, high) = heights[120..]
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), &z| (l.min(z), h.max(z)));
    assert!(high - low < 1e-4, "between {low} and {high}");
    let weight = 9.81 * world.report().objects[0].mass / 60.0;
    let force = world.report().objects[0].contact_impulse[2];
    assert!((force / weight - 1.0).abs() < 0.05, "{force} of {weight}");
}

#[test]
fn a_rigid_cube_slides_bounces_and_sticks_as_its_contact_says() {
    let cube = |friction: f64, restitution: f64, velocity: [f64; 3], height: f64| {
        let mut scene = empty(0.1);
        scene.gravity = [0.0, 0.0, -9.81];
        let rigid = elastic(Law::Rigid, 0.0, 0.0);
        let bottom = 0.013 + height;
        add_box(&mut scene, rigid, [0.01, 0.02, bottom], 0.05, [6, 6, 4]);
        scene.objects[0].linear_velocity = velocity;
        let up = [0.0, 0.0, 1.0];
        add_plane(
            &mut scene,
            [0.0, 0.0, 0.013],
            up,
            Surface::Separate,
            friction,
        );
        scene.colliders[0].restitution = restitution;
        World::new(scene).expect("valid scene")
    };
    // Coulomb: v^2 / (2 mu g) until it stops.
    let mut world = cube(0.3, 0.0, [1.5, 0.0, 0.0], 0.0);
    let start = world.report().objects[0].com[0];
    for _ in 0..90 {
        world.step(1.0 / 60.0, &[]);
    }
    let way = world.report().objects[0].com[0] - start;
    let expected = 1.5 * 1.5 / (2.0 * 0.3 * 9.81);
    assert!((way / expected - 1.0).abs() < 0.01, "{way} of {expected}");
    assert!(norm(world.report().objects[0].linear_velocity) < 1e-3);
    // Dropped flat from 0.5 m it comes back to e^2 of that.
    let mut world = cube(0.0, 0.6, [0.0; 3], 0.5);
    let rest = world.report().objects[0].com[2] - 0.5;
    let (mut touched, mut highest) = (false, 0.0_f64);
    for _ in 0..240 {
        let state = world.step(1.0 / 240.0, &[]).objects[0];
        touched |= state.linear_velocity[2] > 0.5;
        if touched {
            highest = highest.max(state.com[2] - rest);
        }
    }
    assert!(touched, "never bounced");
    let expected = 0.36 * 0.5;
    assert!(
        (highest / expected - 1.0).abs() < 0.05,
        "{highest} of {expected}"
    );
}

/// Rigid boxes, cans and a bent piece that fall on each other.
fn heap() -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    let rigid = elastic(Law::Rigid, 0.0, 0.0);
    for n in 0..6 {
        let at = [0.02 * n as f64, 0.01 * n as f64, 0.01 + 0.22 * n as f64];
        add_box(&mut scene, rigid.clone(), at, 0.05, [4 + n % 2, 4, 4]);
        scene.objects[n].linear_velocity = [0.0, 0.1 * n as f64, -0.5];
    }
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.4);
    scene.colliders[0].restitution = 0.3;
    scene
}

#[test]
fn a_heap_has_the_same_bits_on_any_threads_and_from_checkpoints() {
    let run = |threads: usize, from: Option<&[u8]>, frames: u32| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a small pool").install(|| {
            let mut world = World::new(heap()).expect("valid scene");
            if let Some(bytes) = from {
                world.restore(bytes).expect("its own checkpoint");
            }
            let hashes: Vec<u64> = (0..frames)
                .map(|_| world.step(1.0 / 60.0, &[]).state_hash)
                .collect();
            (hashes, world.checkpoint())
        })
    };
    let (expected, _) = run(1, None, 60);
    for threads in [2, 3] {
        assert_eq!(run(threads, None, 60).0, expected, "{threads} threads");
    }
    // In the air, in an impact, at rest.
    for middle in [5, 12, 40] {
        let (_, saved) = run(1, None, middle);
        let left = run(2, Some(&saved), 60 - middle).0;
        assert_eq!(left, expected[middle as usize..], "from frame {middle}");
    }
}
