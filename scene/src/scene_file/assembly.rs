//! Objects to the scene: what one adds to its lists, and the box round all.

use cosplat_sim_core::scene::{Aabb, Object, Scene};
use glam::{DQuat, DVec3};

use crate::bounds::bounds_of;

use super::{
    edit::{append, bounds, move_rigidly},
    placement::Rigid,
    regions::RegionSpec,
    sampling::Sampled,
    spec::ObjectSpec,
};

/// One object to be, with its geometry in its own frame.
pub(super) struct Part<'f> {
    pub spec: &'f ObjectSpec,
    pub name: String,
    pub body: usize,
    pub world_from_body: Rigid,
    /// Its regions, with Gaussians in place of names.
    pub regions: Vec<RegionSpec>,
}

/// Appends one object to the scene.
pub(super) fn push(scene: &mut Scene, part: &Part, sampled: &Sampled, body_from_asset: DQuat) {
    let spec = part.spec;
    let Rigid {
        rotation,
        translation,
    } = part.world_from_body;
    let (first_particle, first_gaussian) = (scene.particles.position.len(), scene.gaussians.len());
    let particles = &sampled.particles;
    let moved = particles
        .position
        .iter()
        .map(|&p| part.world_from_body.point(p));
    scene.particles.position.extend(moved);
    scene.particles.volume.extend_from_slice(&particles.volume);
    let mut gaussians = sampled.gaussians.clone();
    move_rigidly(&mut gaussians, rotation, translation);
    append(&mut scene.gaussians, &gaussians);
    let shifted = sampled.binding.particle.iter();
    let shifted = shifted.map(|slots| slots.map(|p| p + first_particle as u32));
    scene.binding.particle.extend(shifted);
    scene
        .binding
        .weight
        .extend_from_slice(&sampled.binding.weight);
    let [x, y, z] = spec.angular_velocity;
    let spin = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let gradient = |i: usize, j: usize| spec.velocity_gradient[i][j] + spin[i][j];
    scene.objects.push(Object {
        name: part.name.clone(),
        material: spec.material.clone(),
        regions: Vec::new(),
        surface: spec.surface,
        coherence: spec.coherence,
        present: spec.present,
        fidelity: spec.fidelity,
        solver: spec.solver.unwrap_or_default(),
        particles: first_particle..scene.particles.position.len(),
        gaussians: first_gaussian..scene.gaussians.len(),
        world_from_asset: (rotation * body_from_asset)
            .normalize()
            .as_quat()
            .to_array(),
        linear_velocity: spec.linear_velocity,
        velocity_gradient: std::array::from_fn(|i| std::array::from_fn(|j| gradient(i, j))),
        velocity: spec.velocity.clone(),
        body_force: spec.body_force.clone(),
    });
}

/// The box of everything simulated, grown by ten times its diagonal to every side: room to fall and fly.
pub(super) fn default_domain(scene: &Scene) -> Aabb {
    let particles = bounds_of(scene.particles.position.iter().copied());
    let Some(b) = particles.or_else(|| bounds(&scene.gaussians)) else {
        return Aabb {
            min: [-1.0; 3],
            max: [1.0; 3],
        };
    };
    let diagonal = DVec3::from(b.max).distance(DVec3::from(b.min));
    let room = 10.0 * diagonal.max(scene.dx);
    Aabb {
        min: b.min.map(|x| x - room),
        max: b.max.map(|x| x + room),
    }
}
