//! Every material on three scenes, both solvers: the difference is that of single precision.

use cosplat_reference::ReferenceWorld;
use cosplat_sim_core::{
    World,
    materials::{
        Law, Material,
        limits::{DeformationBounds, critical_dt},
    },
    scene::{ContactMethod, Scene, Surface},
    test_scenes::{add_box, add_plane, empty, one_of_each, spin},
};

use crate::rounding::Difference;

/// Half of the spacing of `f32` numbers between 1 and 2.
const ROUNDING: f64 = 1.0 / 16_777_216.0;
/// Substeps of a run.
const SUBSTEPS: usize = 400;

/// A spinning block falls onto a floor with friction.
fn drop(material: &Material) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    add_box(
        &mut scene,
        material.clone(),
        [-0.17, 0.11, 0.05],
        0.05,
        [6; 3],
    );
    scene.objects[0].linear_velocity = [0.6, -0.2, -2.0];
    scene.objects[0].velocity_gradient = spin([2.0, 3.0, -1.0]);
    let up = [0.0, 0.0, 1.0];
    let floor = [0.0, 0.0, -0.013];
    add_plane(&mut scene, floor, up, Surface::Separate, 0.3);
    scene
}

/// Two blocks meet off their centres.
fn collide(material: &Material) -> Scene {
    let mut scene = empty(0.1);
    // The one method that the reference has.
    scene.contact.method = ContactMethod::SingleField;
    for (corner, speed) in [([-0.31, 0.02, 0.0], 1.5), ([0.12, -0.07, 0.04], -1.5)] {
        let id = add_box(&mut scene, material.clone(), corner, 0.05, [5, 5, 4]);
        scene.objects[id].linear_velocity = [speed, 0.1, 0.0];
    }
    scene
}

/// A block on a sticky floor is sheared and squeezed by the velocity it starts with.
fn shear(material: &Material) -> Scene {
    let mut scene = empty(0.1);
    add_box(&mut scene, material.clone(), [0.0; 3], 0.05, [6, 6, 5]);
    scene.objects[0].linear_velocity = [0.6, 0.0, -0.5];
    scene.objects[0].velocity_gradient = [[0.0, 0.0, 5.0], [0.0; 3], [0.0, 0.0, -4.0]];
    let up = [0.0, 0.0, 1.0];
    let floor = [0.0, 0.0, 0.033];
    add_plane(&mut scene, floor, up, Surface::Sticky, 0.0);
    scene
}

/// Differences after a sixteenth of the run and at its end.
fn differences(scene: Scene) -> [Difference; 2] {
    let material = &scene.objects[0].material;
    let limit = critical_dt(material, 1000.0, scene.dx, &DeformationBounds::REST);
    let dt = (0.4 * limit).min(1e-3);
    let mut reference = ReferenceWorld::new(&scene);
    let mut fast = World::new(scene).expect("the scene is valid");
    let mut found = [Difference::default(), Difference::default()];
    for step in 1..=SUBSTEPS {
        let report = fast.step(dt, &[]);
        assert_eq!(report.rollbacks, 0);
        // Most often one substep; snow that has hardened takes several.
        reference.step_with(fast.substeps(), &[]);
        if step <= SUBSTEPS / 16 {
            found[0].compare(&fast, &reference);
        }
        if step % 20 == 0 {
            found[1].compare(&fast, &reference);
        }
    }
    found
}

/// Largest differences measured over the three scenes, in units of the round-off walk
/// `ROUNDING sqrt(SUBSTEPS)` = 1.2e-6, at the end and (in brackets) after a sixteenth of the substeps, where the
/// walk is a quarter:
///
/// | law | position [m] | elastic `F` | memory |
/// | --- | --- | --- | --- |
/// | fixed corotated, neo-Hookean | 0.5 (0.06) | 3.6 (0.8) | |
/// | von Mises, foam, plasticine | 1.7 (0.06) | 14 (0.7) | 13 |
/// | fluid | 3.2 (0.06) | | 70 |
/// | sand | 5.7 (0.08) | 298 (1.2) | 19 |
/// | snow | 19 (0.4) | 70 (3.7) | 200 |
///
/// Sand and snow have corners in their yield surfaces: what happens
/// one substep earlier in one of the two precisions makes a jump. Until the first do (early), they differ by no more than the others.
#[test]
fn every_material_moves_alike_in_both_precisions() {
    let walk = ROUNDING * (SUBSTEPS as f64).sqrt();
    for material in one_of_each().into_iter().filter(|m| !m.law.is_rigid()) {
        let law = material.law;
        // Three times what was measured.
        let (x, f, memory) = match law {
            Law::DruckerPrager { .. } => (18.0, 900.0, 900.0),
            Law::Fluid { .. } => (10.0, 1.0, 210.0),
            Law::Snow { .. } => (57.0, 210.0, 600.0),
            _ => (3.5, 40.0, 40.0),
        };
        for (name, scene) in [
            ("drop", drop(&material)),
            ("collide", collide(&material)),
            ("shear", shear(&material)),
        ] {
            let [early, late] = differences(scene);
            let of = format!("{law:?}, {name}: {early:?}, {late:?}");
            assert!(
                early.position < walk && early.deformation < 9.0 * walk,
                "{of}"
            );
            assert!(early.position <= late.position, "shrank: {of}");
            assert!(late.position < x * walk, "{of}");
            assert!(late.deformation < f * walk, "{of}");
            assert!(late.memory < memory * walk, "{of}");
            assert!(late.strain > 0.07, "nothing happened: {of}");
        }
    }
}
