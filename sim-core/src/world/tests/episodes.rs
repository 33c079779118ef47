//! Episodes of solids on grids of their own: how they bounce is a matter of their laws, whatever restitution is stated.

use super::*;
use crate::{
    ContactEpisode,
    scene::{ContactSurface, Fidelity, Object, Solver},
};

/// Adds a ball of 0.4 m across as a solid.
fn add_ball(scene: &mut Scene, center: [f64; 3], velocity: [f64; 3], restitution: Option<f64>) {
    let first = scene.particles.position.len();
    for (position, volume) in ball(scene.dx, center, 0.2) {
        scene.particles.position.push(position);
        scene.particles.volume.push(volume);
    }
    let material = elastic(Law::NeoHookean, 1e5, 0.3);
    scene.objects.push(Object {
        solver: Solver::Lagrangian,
        linear_velocity: velocity,
        surface: ContactSurface {
            restitution,
            friction: Some(0.2),
        },
        ..Object::new("ball", material, first..scene.particles.position.len())
    });
}

/// What two balls that meet off centre make of it, and by how much energy was above that at the start at most, over that.
fn collide(stated: Option<f64>, change: impl Fn(&mut Scene)) -> (ContactEpisode, f64) {
    let mut scene = empty(0.05);
    scene.cfl = 0.8;
    add_ball(&mut scene, [-0.25, 0.03, 0.0], [1.0, 0.0, 0.0], None);
    add_ball(&mut scene, [0.25, -0.03, 0.02], [-1.0, 0.0, 0.1], stated);
    change(&mut scene);
    let mut world = World::new(scene).expect("valid scene");
    let first = world.report().clone();
    let (mut episode, mut growth) = (None, 0.0_f64);
    for _ in 0..60 {
        let report = world.step(1.0 / 60.0, &[]);
        let energy = |r: &StepReport| r.kinetic_energy + r.elastic_energy;
        growth = growth.max(energy(&report) / energy(&first) - 1.0);
        // Later ones are vibration.
        episode = episode.or(report.contacts.first().copied());
    }
    let last = world.report();
    let mass = first.objects[0].mass;
    let p = distance(last.linear_momentum, first.linear_momentum) / mass;
    let l = distance(last.angular_momentum, first.angular_momentum) / (mass * 0.2);
    // As much as single precision takes of velocities.
    assert!(p < 1e-5 && l < 1e-4, "{stated:?}: {p:e} {l:e}");
    (episode.expect("they met and parted"), growth)
}

#[test]
fn solids_part_as_their_matter_does_whatever_is_stated() {
    let (found, growth) = collide(None, |_| {});
    let left = found.restitution.expect("they parted");
    assert!((0.9..1.0).contains(&left), "{found:?}");
    assert!((found.speed_after / found.speed_before - left).abs() < 1e-12);
    assert!(growth < 5e-3, "{growth}");
    let (stated, _) = collide(Some(0.3), |_| {});
    assert_eq!(stated, found);
}

#[test]
fn a_solid_parts_from_a_rigid_body_as_its_matter_does() {
    let (found, growth) = collide(None, |scene| {
        scene.objects[0].fidelity = Fidelity::Rigid;
        scene.objects[0].solver = Solver::Spatial;
    });
    let left = found.restitution.expect("they parted");
    assert!((0.9..1.0).contains(&left), "{found:?}");
    assert!(growth < 5e-3, "{growth}");
}

/// Speeds of a ball before and after it meets a floor of this restitution.
fn bounce(restitution: f64) -> [f64; 2] {
    let mut scene = empty(0.05);
    (scene.cfl, scene.gravity) = (0.8, [0.0, 0.0, -10.0]);
    add_ball(&mut scene, [0.0, 0.0, 0.22], [0.3, 0.0, -2.0], None);
    let up = [0.0, 0.0, 1.0];
    add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.0);
    scene.colliders[0].restitution = restitution;
    let mut world = World::new(scene).expect("valid scene");
    let (mut fastest, mut after) = (0.0_f64, 0.0);
    for _ in 0..40 {
        let report = world.step(1.0 / 240.0, &[]);
        assert!(report.contacts.is_empty(), "pairs of objects alone");
        let object = &report.objects[0];
        fastest = fastest.max(-object.linear_velocity[2]);
        if norm(object.contact_impulse) > 0.02 * object.mass {
            // At the height at which it touched; it has risen since.
            let squared = object.linear_velocity[2].powi(2) + 20.0 * (object.com[2] - 0.2);
            after = squared.max(0.0).sqrt();
        }
    }
    [fastest, after]
}

#[test]
fn a_solid_bounces_off_a_floor_as_its_matter_does() {
    let [before, after] = bounce(0.0);
    assert!(after > 0.85 * before, "{after} of {before}");
    assert_eq!(bounce(0.3), [before, after]);
}

/// What it was in contact with is forgotten.
#[test]
fn a_solid_may_go_over_while_it_meets_another() {
    let mut scene = empty(0.05);
    add_ball(&mut scene, [-0.21, 0.0, 0.0], [1.0, 0.0, 0.0], None);
    add_ball(&mut scene, [0.21, 0.0, 0.0], [-1.0, 0.0, 0.0], None);
    let mut world = World::new(scene).expect("valid scene");
    // They touch from 0.01 s on, for half the way of a wave of 10 m/s about them at least.
    for _ in 0..8 {
        let report = world.step(1.0 / 240.0, &[]);
        assert!(report.contacts.is_empty());
    }
    assert!(norm(world.report().objects[0].contact_impulse) > 0.0);
    let water = Law::Fluid {
        bulk_modulus: 1e5,
        viscosity: 1.0,
    };
    let command = Command {
        client: 1,
        sequence: 0,
        apply_at_step: 0,
        action: crate::Action::SetMaterial {
            object: 0,
            region: None,
            patch: None,
            material: elastic(water, 1e5, 0.3),
        },
    };
    let report = world.step(1.0 / 240.0, &[command]);
    assert_eq!(report.gone_over.len(), 1);
    for _ in 0..8 {
        let report = world.step(1.0 / 240.0, &[]);
        assert!(report.quarantined.is_empty() && report.contacts.is_empty());
    }
}
