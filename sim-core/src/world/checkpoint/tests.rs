//! Checkpoints go on with the same bits; whatever else they hold, they are refused or can be stepped.

use super::*;
use crate::{
    Isa, Scene,
    materials::Law,
    particles::{Extremes, Group, Particles},
    scene::{Aabb, Surface},
    state::rigid::RigidBody,
    test_scenes::{add_box, add_plane, elastic, empty, spin},
};

/// Two materials in one object and a rigid one, with contact, sorting and particles that leave.
fn scene() -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    scene.domain = Aabb {
        min: [-1.0, -1.0, -1.0],
        max: [0.45, 1.0, 1.0],
    };
    let soft = elastic(Law::NeoHookean, 1e5, 0.3);
    add_box(&mut scene, soft, [-0.2, -0.1, 0.05], 0.05, [9, 6, 3]);
    let all = scene.objects[0].particles.clone();
    scene.objects[0].regions.push(crate::scene::MaterialRegion {
        particles: all.start + 90..all.end,
        material: elastic(Law::FixedCorotated, 2e5, 0.2),
    });
    let rigid = elastic(Law::Rigid, 0.0, 0.0);
    add_box(&mut scene, rigid, [-0.1, -0.1, 0.3], 0.05, [4; 3]);
    scene.objects[0].linear_velocity = [2.0, 0.0, 0.0];
    scene.objects[1].velocity_gradient = spin([1.0, 2.0, 3.0]);
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.3);
    scene
}

fn run(world: &mut World, frames: usize) -> Vec<u64> {
    let steps = (0..frames).map(|_| world.step(1.0 / 60.0, &[]).state_hash);
    steps.collect()
}

#[test]
fn a_restored_world_goes_on_with_the_same_bits() {
    let mut world = World::new(scene()).expect("valid scene");
    run(&mut world, 23);
    assert!(
        !world.state.matter.removed.is_empty(),
        "nothing left the domain"
    );
    let bytes = world.checkpoint();
    let report = world.report().clone();
    let expected = run(&mut world, 20);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let mut other = World::with_isa(scene(), isa).expect("valid scene");
        // Whatever it did before does not matter.
        run(&mut other, 5);
        other.restore(&bytes).expect("a checkpoint of this scene");
        assert_eq!(other.report().state_hash, report.state_hash);
        assert_eq!(other.report().step, report.step);
        assert_eq!(other.positions(), {
            let mut again = World::new(scene()).expect("valid scene");
            again.restore(&bytes).expect("again");
            again.positions().to_vec()
        });
        assert_eq!(run(&mut other, 20), expected, "{isa}");
    }
}

/// With the same bits.
#[test]
fn a_restored_world_goes_on_where_the_substep_changes() {
    let mut world = World::new(scene()).expect("valid scene");
    let long = world.step(1.0 / 60.0, &[]);
    let bytes = world.checkpoint();
    // Frames of less than a substep: the first kick is the mean of two.
    let lengths = [0.3 * long.dt, 0.4 * long.dt, 1.0 / 60.0];
    let go_on = |world: &mut World| lengths.map(|length| world.step(length, &[]).state_hash);
    assert!((world.state.motion.velocity_offset - 0.5 * long.dt).abs() < 1e-12);
    let expected = go_on(&mut world);
    let there = world.positions().to_vec();
    world.restore(&bytes).expect("a checkpoint of this scene");
    assert_eq!(go_on(&mut world), expected);
    // Without the substep before, it would go another way.
    world.restore(&bytes).expect("a checkpoint of this scene");
    world.state.motion.velocity_offset = 0.0;
    go_on(&mut world);
    assert_ne!(world.positions(), there);
    world.state.motion.velocity_offset = f64::NAN;
    let bytes = world.checkpoint();
    let error = world.restore(&bytes).expect_err("no number");
    assert!(error.to_string().contains("velocity_offset"), "{error}");
}

#[test]
fn bad_checkpoints_are_refused_and_change_nothing() {
    let mut world = World::new(scene()).expect("valid scene");
    let bytes = world.checkpoint();
    run(&mut world, 3);
    let before = world.report().state_hash;
    let mut refuse = |bytes: &[u8]| {
        let error = world.restore(bytes).expect_err("bad bytes");
        assert_eq!(world.report().state_hash, before);
        error
    };
    let not_one = refuse(b"version = 1\nname = \"scene\"");
    assert!(matches!(not_one, CheckpointError::NotACheckpoint { .. }));
    let short = refuse(&bytes[..bytes.len() - 5]);
    assert!(matches!(short, CheckpointError::Short { .. }));
    for found in [VERSION - 1, VERSION + 1] {
        let mut foreign = bytes.clone();
        foreign[MAGIC.len()..MAGIC.len() + 4].copy_from_slice(&found.to_le_bytes());
        let expected = VERSION;
        assert_eq!(
            refuse(&foreign),
            CheckpointError::Version { found, expected }
        );
    }
    // Every single byte counts.
    for at in (HEADER..bytes.len()).step_by(997) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        assert!(
            matches!(refuse(&damaged), CheckpointError::Damaged { .. }),
            "byte {at}"
        );
    }
    let mut other = scene();
    other.particles.position[7][1] += 1e-9;
    let mut other = World::new(other).expect("valid scene");
    let error = other.restore(&bytes).expect_err("another scene");
    assert!(
        matches!(error, CheckpointError::OtherScene { .. }),
        "{error}"
    );
}

#[test]
fn a_checkpoint_with_a_right_sum_and_wrong_content_is_refused() {
    let world = World::new(scene()).expect("valid scene");
    let mut forged = World::new(scene()).expect("valid scene");
    forged.state.matter.particles.fixed[0].id[1] = forged.state.matter.particles.fixed[0].id[0];
    let twice = forged.checkpoint();
    let mut world = world;
    let error = world.restore(&twice).expect_err("one particle twice");
    assert!(error.to_string().contains("twice"), "{error}");
    let mut forged = World::new(scene()).expect("valid scene");
    forged.state.matter.particles.blocks.swap(0, 1);
    let error = world
        .restore(&forged.checkpoint())
        .expect_err("blocks swapped");
    assert!(error.to_string().contains("out of order"), "{error}");
    let mut forged = World::new(scene()).expect("valid scene");
    forged.state.matter.extremes.push(Extremes::NONE);
    let error = world
        .restore(&forged.checkpoint())
        .expect_err("one too many");
    assert!(error.to_string().contains("extremes"), "{error}");
}

fn matter(world: &mut World) -> &mut Particles {
    &mut world.state.matter.particles
}

/// The first group, whose first lane holds a particle.
fn group(world: &mut World) -> &mut Group {
    &mut matter(world).groups[0]
}

fn body(world: &mut World) -> &mut RigidBody {
    world.state.bodies.of[1]
        .as_mut()
        .expect("object 1 is rigid")
}

/// A change of a world that no run comes to, and what is said of it.
type Forgery = (fn(&mut World), &'static str);

#[test]
fn forged_numbers_are_refused_and_change_nothing() {
    let forgeries: &[Forgery] = &[
        (|w| group(w).x[1].0[0] = f32::NAN, "`x`"),
        (|w| group(w).f[4].0[0] = f32::INFINITY, "`f`"),
        (|w| group(w).f[4].0[0] = 1e13, "`f`"),
        (|w| group(w).x[1].0[0] = 3.9, "near its block"),
        (|w| matter(w).motion[0].v[2].0[0] = f32::NEG_INFINITY, "`v`"),
        (|w| matter(w).motion[0].c[8].0[0] = f32::NAN, "`c`"),
        (|w| matter(w).memory[0].0[0] = f32::NAN, "`memory`"),
        (|w| matter(w).fixed[0].mass.0[0] = f32::NAN, "`mass`"),
        (
            |w| matter(w).fixed[0].mass.0[0] *= 2.0,
            "a lane has the mass",
        ),
        (
            |w| matter(w).blocks[0].index[0] = i32::MIN,
            "beyond all grids",
        ),
        (|w| w.state.matter.drift = f64::NAN, "`drift`"),
        (|w| w.state.matter.drift = -1.0, "none of a run"),
        (|w| w.state.matter.extremes[0].stiffness = -1.0, "negative"),
        (
            |w| w.state.motion.frame_velocity[0] = 1e20,
            "frame velocity",
        ),
        (|w| w.state.motion.velocity_offset = 1e9, "behind positions"),
        (|w| w.state.progress.sim_time = f64::NAN, "`sim_time`"),
        (
            |w| w.state.progress.steps = u64::MAX,
            "step 18446744073709551615",
        ),
        (
            |w| w.state.progress.momentum[0][0] = f64::INFINITY,
            "`momentum`",
        ),
        (|w| w.state.commanded.gravity[1] = f64::NAN, "`gravity`"),
        (|w| w.state.commanded.gravity[1] = 1e9, "gravity is"),
        (
            |w| w.state.commanded.materials[0].youngs_modulus = 1e25,
            "youngs_modulus",
        ),
        (
            |w| w.state.commanded.materials[0].law = Law::Rigid,
            "is rigid and has particles",
        ),
        (|w| body(w).body.com[0] = f64::NAN, "`com`"),
        (|w| body(w).body.com[0] = 50.0, "the body of object 1"),
        (|w| body(w).body.velocity[0] = 1e9, "the body of object 1"),
        (|w| body(w).body.angular_momentum[0] = 1e25, "spins"),
        (|w| body(w).own = -1.0, "the body of object 1"),
        (
            |w| body(w).members[3].place[0] = 1e9,
            "the body of object 1",
        ),
        (|w| body(w).members[3].visible[0] = f32::NAN, "`visible`"),
    ];
    let mut taken = Vec::new();
    for (n, (forge, words)) in forgeries.iter().enumerate() {
        let mut world = World::new(scene()).expect("valid scene");
        run(&mut world, 2);
        let before = world.checkpoint();
        let mut forged = World::new(scene()).expect("valid scene");
        run(&mut forged, 2);
        forge(&mut forged);
        let outcome = world.restore(&forged.checkpoint());
        let is_refused = matches!(&outcome, Err(CheckpointError::Inconsistent { reason }) if reason.contains(words));
        if !is_refused || world.checkpoint() != before {
            taken.push((n, words, outcome));
        }
    }
    assert!(taken.is_empty(), "{taken:#?}");
}
