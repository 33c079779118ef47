//! Rigid bodies and matter on the grid: what floats, and what matter meets as it would meet a wall.

use crate::{
    World,
    materials::{Law, Material},
    scene::{Fidelity, Scene, Solver, Surface},
    test_scenes::{add_box, add_plane, elastic, empty},
};

/// Frame length [s].
const FRAME: f64 = 1.0 / 60.0;

/// Height of its middle where it displaces its weight: 0.18 m under water, which stands 0.3253 m high then.
const AFLOAT: f64 = 0.3253 - 0.18 + 0.15;

/// A block of some law and six tenths of the density of water, 0.3 m wide, above a tank of 0.8 m with 0.3 m of it.
fn tank(dx: f64, block: Material) -> Scene {
    let mut scene = empty(dx);
    scene.gravity = [0.0, -9.81, 0.0];
    let mut wall = |point, normal| add_plane(&mut scene, point, normal, Surface::Slip, 0.0);
    wall([0.0; 3], [0.0, 1.0, 0.0]);
    for (a, sign) in [(0, 1.0), (0, -1.0), (2, 1.0), (2, -1.0)] {
        let (mut point, mut normal) = ([0.0; 3], [0.0; 3]);
        (point[a], normal[a]) = (-0.4 * sign, sign);
        wall(point, normal);
    }
    let water = Law::Fluid {
        bulk_modulus: 1e5,
        viscosity: 5.0,
    };
    let water = elastic(water, 0.0, 0.0);
    add_box(&mut scene, water, [-0.4, 0.0, -0.4], 0.5 * dx, [32, 12, 32]);
    let block = Material {
        density: 600.0,
        ..block
    };
    add_box(&mut scene, block, [-0.15, 0.31, -0.15], 0.5 * dx, [12; 3]);
    for object in &mut scene.objects {
        object.surface.friction = Some(0.0);
    }
    scene
}

#[test]
fn a_light_body_floats_and_no_water_passes_through_it() {
    const DX: f64 = 0.05;
    let scene = tank(DX, elastic(Law::Rigid, 0.0, 0.0));
    let water = scene.objects[0].particles.clone();
    let mut world = World::new(scene).expect("valid");
    let mut heights = vec![];
    for _ in 0..180 {
        let report = world.step(FRAME, &[]);
        assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
        heights.push(report.objects[1].com[1]);
    }
    // Contact is of first order, between six cells of body and five of water to either side: within a cell.
    for height in &heights[120..] {
        assert!((height - AFLOAT).abs() < DX, "{:?}", &heights[100..]);
    }

    let body = &world.report().objects[1];
    let deepest = world.positions()[water].iter().map(|x| {
        let inside = |a: usize| 0.15 - (f64::from(x[a]) - body.com[a]).abs();
        inside(0).min(inside(1)).min(inside(2))
    });
    let deepest = deepest.fold(f64::NEG_INFINITY, f64::max);
    assert!(deepest < DX, "{deepest}");
}

#[test]
fn a_light_solid_on_its_own_grid_does_not_go_under() {
    const DX: f64 = 0.05;
    let mut scene = tank(DX, elastic(Law::NeoHookean, 2e5, 0.3));
    scene.objects[1].solver = Solver::Lagrangian;
    let mut world = World::new(scene).expect("valid");
    for frame in 0..240 {
        let report = world.step(FRAME, &[]);
        assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
        let height = report.objects[1].com[1];
        // Within a cell, as a rigid one; where overlaps stayed it was two cells too low.
        assert!(frame < 150 || (height - AFLOAT).abs() < DX, "{height}");
    }
}

/// Speed that a soft block keeps which hits something heavy or a wall at 1 m/s, and the nearest that its middle came to it [m].
fn hit(dx: f64, wall: bool) -> (f64, f64) {
    let mut scene = empty(dx);
    let cells = (0.6 / dx).round() as usize;
    let soft = elastic(Law::NeoHookean, 1e5, 0.3);
    add_box(&mut scene, soft, [0.1, -0.1, -0.12], 0.5 * dx, [cells; 3]);
    scene.objects[0].linear_velocity = [-1.0, 0.0, 0.0];
    if wall {
        add_plane(
            &mut scene,
            [0.0; 3],
            [1.0, 0.0, 0.0],
            Surface::Separate,
            0.5,
        );
    } else {
        let heavy = Material {
            density: 1e7,
            ..elastic(Law::Rigid, 0.0, 0.0)
        };
        let id = add_box(&mut scene, heavy, [-0.3, -0.3, -0.3], 0.05, [6, 12, 12]);
        scene.objects[id].surface.friction = Some(0.5);
        scene.objects[0].surface.friction = Some(0.5);
    }
    scene.objects[0].fidelity = Fidelity::Mpm;
    let mut world = World::new(scene).expect("valid");
    let mut nearest = f64::INFINITY;
    for _ in 0..60 {
        world.step(0.5 * FRAME, &[]);
        nearest = nearest.min(world.report().objects[0].com[0]);
    }
    (world.report().objects[0].linear_velocity[0], nearest)
}

#[test]
fn matter_meets_a_heavy_body_as_it_meets_a_wall() {
    let off = [0.05, 0.025].map(|dx| {
        let ((body, near), (wall, nearest)) = (hit(dx, false), hit(dx, true));
        assert!((near - nearest).abs() < 0.1 * dx, "{dx}: {near} {nearest}");
        wall - body
    });
    // A wall along the axes is of second order, contact with a body of first: what it takes more halves.
    assert!(off[0] < 0.2 && off[1] < 0.65 * off[0], "{off:?}");
}
