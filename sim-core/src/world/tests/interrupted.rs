//! A frame ends when somebody asks for that, however long it is.

use std::sync::atomic::{AtomicU32, Ordering};

use super::*;
use crate::{interruption::Interruption, scene::Solver};

/// One kind of matter at rest above a floor.
fn scene(law: Law, solver: Solver) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    let modulus = if law.is_rigid() { 0.0 } else { 1e5 };
    add_box(
        &mut scene,
        elastic(law, modulus, 0.0),
        [0.0; 3],
        0.05,
        [4, 4, 4],
    );
    scene.objects[0].solver = solver;
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
fn a_frame_of_days_ends_when_it_is_interrupted() {
    for (law, solver) in [
        (Law::NeoHookean, Solver::Spatial),
        (Law::NeoHookean, Solver::Lagrangian),
        (Law::Rigid, Solver::Spatial),
    ] {
        let mut world = World::new(scene(law, solver)).expect("valid");
        world.step(1.0 / 60.0, &[]);
        let (before, places) = (world.report().clone(), world.positions().to_vec());
        let asked = AtomicU32::new(0);
        let asks = || asked.fetch_add(1, Ordering::Relaxed) >= 10;
        let frame = world.step_unless(&Interruption::when(&asks), 1e6, &[]);
        assert!(frame.is_none(), "{law:?} {solver:?}");
        // Once it was told, it does not ask again.
        assert_eq!(asked.into_inner(), 11, "{law:?} {solver:?}");
        // What is seen is the step before.
        assert_eq!(world.report().state_hash, before.state_hash);
        assert_eq!(world.positions(), places);
    }
}

#[test]
fn a_frame_that_nobody_interrupts_is_the_same_bits() {
    let of = |watched: bool| {
        let mut world = World::new(scene(Law::NeoHookean, Solver::Lagrangian)).expect("valid");
        let asks = || false;
        let interruption = Interruption::when(&asks);
        for _ in 0..3 {
            match watched {
                true => world.step_unless(&interruption, 1.0 / 60.0, &[]).is_some(),
                false => world.step(1.0 / 60.0, &[]).substeps > 0,
            };
        }
        world.report().state_hash
    };
    assert_eq!(of(true), of(false));
}
