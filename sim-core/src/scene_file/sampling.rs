//! Particles, Gaussians and binding of one body, in the body's own frame.

use glam::DQuat;

use super::spec::Shape;
use crate::{
    assets::Gaussians,
    binding::bind,
    fill::{FillOptions, FillReport, Filled, fill, per_gaussian},
    scene::{Aabb, BINDING_NEIGHBORS, Binding, RestParticles},
};

/// Most grid cells in the boxes of all simulated objects together: what a large machine holds, and what a slip
/// in a unit exceeds.
pub(super) const MAX_CELLS: f64 = 3e7;

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
    Filled { closed_below: bool },
    PerGaussian,
}

/// Sizes that sampling depends on.
pub(super) struct Numerics {
    /// Grid cell size [m].
    pub dx: f64,
    /// Particles per filled cell.
    pub particles_per_cell: f64,
    /// See [`SceneFile::jitter`](super::SceneFile::jitter).
    pub jitter: f64,
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
    /// What filling found, for splat objects.
    pub fill: Option<FillReport>,
}

/// Particles of a body (none when `rest` is none), its Gaussians, and how these follow the particles.
pub(super) fn sample(
    body: &Body,
    rest: Option<Rest>,
    numerics: &Numerics,
) -> Result<Sampled, String> {
    let spacing = numerics.dx / numerics.particles_per_cell.cbrt();
    let gaussians = body.gaussians.clone();
    let Some(rest) = rest else {
        let binding = Binding {
            particle: vec![[0; BINDING_NEIGHBORS]; gaussians.len()],
            weight: vec![[0.0; BINDING_NEIGHBORS]; gaussians.len()],
        };
        return Ok(Sampled {
            gaussians,
            binding,
            ..Sampled::default()
        });
    };
    let (particles, fill) = match rest {
        Rest::Shape(shape) => (
            shape.particles(spacing, numerics.jitter, numerics.seed),
            None,
        ),
        Rest::Filled { closed_below } => {
            let options = FillOptions {
                dx: numerics.dx,
                particles_per_cell: numerics.particles_per_cell,
                seed: numerics.seed,
                closed_below,
            };
            rest_particles(fill(&gaussians, &options))
        }
        Rest::PerGaussian => rest_particles(per_gaussian(&gaussians, numerics.dx)),
    };
    let count = particles.position.len();
    if count == 0 {
        return Err(format!(
            "filling its {} Gaussians makes no particle: nothing in it is opaque and near enough to the rest",
            gaussians.len()
        ));
    }
    let binding = if rest == Rest::PerGaussian && count == gaussians.len() {
        one_to_one(count)
    } else {
        bind(&gaussians.position, &particles.position, spacing, 0)
    };
    Ok(Sampled {
        gaussians,
        particles,
        binding,
        fill,
    })
}

fn rest_particles(filled: Filled) -> (RestParticles, Option<FillReport>) {
    let particles = RestParticles {
        position: filled.position,
        volume: filled.volume,
    };
    (particles, Some(filled.report))
}

/// Every Gaussian follows its own particle.
fn one_to_one(count: usize) -> Binding {
    let mut weight = [0.0; BINDING_NEIGHBORS];
    weight[0] = 1.0;
    Binding {
        particle: (0..count).map(|i| [i as u32; BINDING_NEIGHBORS]).collect(),
        weight: vec![weight; count],
    }
}
