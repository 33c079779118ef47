//! Solids that are put where something is already, at any depth: that holds no energy, and they are led apart at a limited speed.

use super::*;
use crate::{
    notices::Notices,
    scene::{ColliderMotion, ColliderShape, Solver, TimeSpan},
    test_scenes::add_collider,
};

const DX: f64 = 0.05;

/// A block of 4 cells that begins with its lowest face at a height [m].
fn block(height: f64) -> Scene {
    let mut scene = empty(DX);
    scene.gravity = [0.0, 0.0, -10.0];
    scene.cfl = 0.8;
    let jelly = elastic(Law::FixedCorotated, 1e6, 0.3);
    let corner = [-0.1, -0.1, height];
    add_box(&mut scene, jelly, corner, 0.5 * DX, [8; 3]);
    scene.objects[0].solver = Solver::Lagrangian;
    scene
}

fn floor(scene: &mut Scene, surface: Surface, friction: f64) {
    add_plane(scene, [0.0; 3], [0.0, 0.0, 1.0], surface, friction);
}

/// Runs it for so many hundredths of a second; the fastest that object 0 was [m/s], the most substeps of a frame, its height in the end [m].
fn run(scene: Scene, frames: usize) -> (f64, u32, f64) {
    let mut world = World::new(scene).expect("valid");
    let (mut fastest, mut substeps) = (0.0_f64, 0);
    for _ in 0..frames {
        let report = world.step(0.01, &[]);
        fastest = fastest.max(norm(report.objects[0].linear_velocity));
        substeps = substeps.max(report.substeps);
        assert!(report.quarantined.is_empty(), "{report:?}");
    }
    (fastest, substeps, world.report().objects[0].com[2])
}

#[test]
fn a_block_that_begins_in_its_floor_comes_out_of_it_slowly() {
    let calm = {
        let mut scene = block(0.0);
        floor(&mut scene, Surface::Separate, 0.5);
        run(scene, 30)
    };
    for depth in [0.003, 0.01, 0.03, 0.1, 0.19] {
        let mut scene = block(-depth);
        floor(&mut scene, Surface::Separate, 0.5);
        let (fastest, substeps, height) = run(scene, 250);
        // It was shot out at 2.5 m/s from 10 mm, and with 1,034 substeps from 30.
        let most = 0.08 + 1.5 * depth / 0.25;
        assert!(fastest < most, "{depth}: {fastest}");
        assert!(substeps <= 2 * calm.1, "{depth}: {substeps} {}", calm.1);
        assert!((height - calm.2).abs() < 0.1 * DX, "{depth}: {height}");
    }
}

#[test]
fn what_binds_holds_a_block_in_it_where_it_is() {
    for (surface, friction) in [(Surface::Slip, 0.0), (Surface::Sticky, 0.0)] {
        let mut scene = block(-0.07);
        floor(&mut scene, surface, friction);
        let (fastest, _, height) = run(scene, 60);
        assert!(fastest < 0.1, "{surface:?}: {fastest}");
        assert!((height - 0.03).abs() < 0.1 * DX, "{surface:?}: {height}");
    }
}

#[test]
fn nothing_is_shot_out_of_shapes_bodies_solids_and_what_moves() {
    // A table that is thinner than the block is deep in it, and a ball.
    let table = ColliderShape::Box {
        half_extents: [0.3, 0.3, 0.02],
    };
    for shape in [table, ColliderShape::Sphere { radius: 0.08 }] {
        let mut scene = block(-0.06);
        add_collider(&mut scene, shape, Surface::Separate);
        let (fastest, ..) = run(scene, 40);
        assert!(fastest < 0.1 + 10.0 * 0.4, "{fastest}");
    }
    // Without gravity all that moves it is what it is in.
    let others: [fn(&mut Scene); 4] = [
        |scene| floor(scene, Surface::Separate, 0.0),
        |scene| {
            floor(scene, Surface::Separate, 0.3);
            scene.colliders[0].motion = ColliderMotion::Velocity {
                linear: [0.0, 0.0, 0.1],
                angular: [0.0; 3],
                span: TimeSpan::ALWAYS,
            };
        },
        |scene| {
            let rigid = elastic(Law::Rigid, 0.0, 0.0);
            add_box(scene, rigid, [-0.1, -0.1, -0.2], 0.5 * DX, [8; 3]);
        },
        |scene| {
            let jelly = elastic(Law::FixedCorotated, 1e6, 0.3);
            add_box(scene, jelly, [-0.1, -0.1, -0.2], 0.5 * DX, [8; 3]);
            scene.objects[1].solver = Solver::Lagrangian;
        },
    ];
    for (n, add) in others.into_iter().enumerate() {
        for depth in [0.01, 0.04, 0.12] {
            let mut scene = block(-depth);
            scene.gravity = [0.0; 3];
            add(&mut scene);
            let (fastest, ..) = run(scene, 60);
            let pushed = if n == 1 { 0.25 } else { 0.02 };
            assert!(
                fastest < pushed + 1.5 * depth / 0.25,
                "{n}, {depth}: {fastest}"
            );
        }
    }
}

/// A state that is restored goes on as it would have.
#[test]
fn overlaps_are_part_of_checkpoints() {
    let mut scene = block(-0.04);
    floor(&mut scene, Surface::Separate, 0.5);
    let mut world = World::new(scene.clone()).expect("valid");
    for _ in 0..10 {
        world.step(0.01, &[]);
    }
    let saved = world.checkpoint();
    let mut other = World::new(scene).expect("valid");
    other.restore(&saved).expect("its own");
    for _ in 0..10 {
        let [one, two] = [&mut world, &mut other].map(|world| world.step(0.01, &[]).state_hash);
        assert_eq!(one, two);
    }
}

#[test]
fn what_is_crushed_is_said_once_with_what_to_do() {
    let world = World::new(block(0.0)).expect("valid");
    let mut notices = Notices::new(world.scene());
    let mut report = world.report().clone();
    (report.dt_object, report.dt_min) = (Some(0), 1e-3);
    assert!(notices.of(world.scene(), &report).is_empty());
    report.dt_min = 1e-6;
    let said = notices.of(world.scene(), &report);
    assert!(
        said.len() == 1 && said[0].contains("as short as at rest"),
        "{said:?}"
    );
    assert!(notices.of(world.scene(), &report).is_empty());
}
