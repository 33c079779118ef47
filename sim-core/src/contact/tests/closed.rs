//! What a closed scene keeps.

use super::*;

/// A soft cube that flies about in a hollow box.
fn rattle() -> Scene {
    let mut scene = empty(0.1);
    scene.contact.method = ContactMethod::MultiField;
    let material = || elastic(Law::NeoHookean, 3e5, 0.3);
    let shell = add_box(&mut scene, material(), [-0.4; 3], 0.05, [16; 3]);
    let solid = |x: &[f64; 3]| x.iter().any(|x| x.abs() > 0.25);
    scene.particles.position.retain(solid);
    let count = scene.particles.position.len();
    scene.particles.volume.truncate(count);
    scene.objects[shell].particles = 0..count;
    let cube = add_box(&mut scene, material(), [-0.13, -0.16, -0.11], 0.05, [6; 3]);
    scene.objects[cube].linear_velocity = [1.1, 0.7, -0.9];
    scene.objects[cube].velocity_gradient = spin([1.0, -2.0, 0.5]);
    scene
}

/// In a box.
#[test]
fn a_rattling_cube_conserves_momentum_and_gains_no_energy() {
    let mut world = World::new(rattle()).expect("valid scene");
    let first = world.report().clone();
    // Sizes against which errors count: those of the single objects, whose sums partly cancel.
    let momentum: f64 = first
        .objects
        .iter()
        .map(|o| o.mass * norm(o.linear_velocity))
        .sum();
    let angular: f64 = first.objects.iter().map(|o| norm(o.angular_momentum)).sum();
    let energy = first.kinetic_energy + first.elastic_energy;
    let (mut substeps, mut exchanged, mut highest) = (0, 0.0, 0.0_f64);
    while substeps < 10_000 {
        let report = world.step(1.0 / 30.0, &[]);
        substeps += report.substeps;
        exchanged += norm(report.objects[1].contact_impulse);
        highest = highest.max((report.kinetic_energy + report.elastic_energy) / energy);
        assert_eq!((report.rollbacks, report.quarantined.len()), (0, 0));
    }
    let last = world.report();
    let p = norm(difference(last.linear_momentum, first.linear_momentum)) / momentum;
    let l = norm(difference(last.angular_momentum, first.angular_momentum)) / angular;
    // Gradients without a gap test hold the cube fast before long.
    assert!(exchanged > 1.5 * momentum, "{exchanged} of {momentum} N s");
    assert!(p < 1e-5, "linear momentum moved by {p:e}");
    assert!(l < 1e-5, "angular momentum moved by {l:e}");
    // The gate of the validation suite.
    assert!(highest < 1.005, "energy rose to {highest}");
}
