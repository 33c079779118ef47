//! What objects cost, and where the time of a frame goes.

use super::*;
use crate::{report::DtLimit, scene::Solver};

#[test]
fn every_object_says_what_it_costs() {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    let sand = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 0.0,
    };
    let soft = || elastic(Law::NeoHookean, 1e6, 0.3);
    // Each stands on the floor, away from the others.
    add_box(&mut scene, soft(), [0.0, 0.0, 0.0], 0.05, [8, 8, 8]);
    add_box(
        &mut scene,
        elastic(sand, 1e6, 0.3),
        [2.0, 0.0, 0.0],
        0.05,
        [8, 8, 8],
    );
    add_box(
        &mut scene,
        elastic(Law::Rigid, 0.0, 0.0),
        [4.0, 0.0, 0.0],
        0.05,
        [8, 8, 8],
    );
    scene.objects[0].solver = Solver::Lagrangian;
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.5);
    let mut world = World::new(scene).expect("valid scene");
    let frame = 1.0 / 60.0;
    for _ in 0..10 {
        let report = world.step(frame, &[]);
        let [solid, sand, body] = report.costs[..] else {
            panic!("three objects: {:?}", report.costs);
        };
        for cost in [solid, sand, body] {
            assert!(cost.seconds > 0.0, "{cost:?}");
        }
        // As long as the frame together, and as many as the grid at least: they meet where its substeps end.
        assert!(solid.substeps >= sand.substeps && sand.substeps > 1);
        assert_eq!(sand.dt_limit, DtLimit::Sound);
        assert!(solid.dt_min * solid.substeps as f64 <= frame * (1.0 + 1e-9));
        assert_eq!(sand.substeps, world.substeps().len() as u64);
        assert_eq!((body.substeps, body.contact_points), (0, 0));
        let t = &report.timings;
        let solids = t.solids + t.solid_contact + t.solid_measuring;
        let flow = t.particles + t.grid + t.contact;
        assert!(t.solids > 0.0 && t.solid_contact > 0.0 && t.bodies > 0.0 && flow > 0.0);
        let phases = t.commands + t.sort + flow + t.coupling + solids + t.bodies + t.moments;
        assert!(phases <= t.total, "{phases} of {} s", t.total);
    }
    // Half a face of points at least.
    let points = world.report().costs[0].contact_points;
    assert!(points >= 32, "{points} points of the block touch the floor");
}
