//! Particles, Gaussians and binding of one body, in the body's own frame.

use glam::DQuat;

use super::spec::Shape;
use crate::{
    assets::Gaussians,
    binding::bind,
    scene::{Aabb, BINDING_NEIGHBORS, Binding, RestParticles},
};

/// Most grid cells in the boxes of all simulated objects together: 10^8 cells of 8 particles are beyond any
/// machine this runs on, and reached by a slip in a unit.
pub(super) const MAX_CELLS: f64 = 1e8;

/// Geometry of an object before its rigid motion to the world.
pub(super) struct Body {
    /// Its Gaussians.
    pub gaussians: Gaussians,
    /// Box of the Gaussian centres or of the shape [m].
    pub bounds: Aabb,
    /// Rotation applied to the asset so far.
    pub body_from_asset: DQuat,
}

/// Where the particles of a body come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rest {
    Shape(Shape),
    Filled,
    PerGaussian,
}

/// Sizes that sampling depends on.
pub(super) struct Numerics {
    /// Grid cell size [m].
    pub dx: f64,
    /// Particles per filled cell.
    pub particles_per_cell: f64,
    /// Seed.
    pub seed: u64,
}

/// A body, sampled.
#[derive(Default)]
pub(super) struct Sampled {
    pub gaussians: Gaussians,
    pub particles: RestParticles,
    /// Particle indices count from the body's first particle.
    pub binding: Binding,
}

/// Particles of a body (none when `rest` is none), its Gaussians, and how these follow the particles.
pub(super) fn sample(
    body: &Body,
    rest: Option<Rest>,
    numerics: &Numerics,
) -> Result<Sampled, String> {
    let spacing = numerics.dx / numerics.particles_per_cell.cbrt();
    let gaussians = body.gaussians.clone();
    let particles = match rest {
        None => {
            let binding = Binding {
                particle: vec![[0; BINDING_NEIGHBORS]; gaussians.len()],
                weight: vec![[0.0; BINDING_NEIGHBORS]; gaussians.len()],
            };
            return Ok(Sampled {
                gaussians,
                particles: RestParticles::default(),
                binding,
            });
        }
        Some(Rest::Shape(shape)) => shape.particles(spacing, numerics.seed),
        Some(Rest::Filled | Rest::PerGaussian) => {
            return Err("splat objects cannot be simulated yet: use a shape".into());
        }
    };
    let binding = bind(&gaussians.position, &particles.position, spacing, 0);
    Ok(Sampled {
        gaussians,
        particles,
        binding,
    })
}
