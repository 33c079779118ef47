//! Particles, Gaussians and binding of one body, in the body's own frame.

use cosplat_sim_core::scene::{Aabb, BINDING_NEIGHBORS, Binding, RestParticles};
use glam::DQuat;

use super::formed::Form;
use crate::{
    assets::{Gaussians, Paint, generate::Style},
    binding::bind,
    fill::{FillOptions, FillReport, Filled, fill, per_gaussian},
};

/// Most grid cells in the boxes of all simulated objects together: what a large machine holds, and what a slip
/// in a unit exceeds.
pub(super) const MAX_CELLS: f64 = 3e7;

/// Gaussians that a shape shows when the file does not say how dense.
const DEFAULT_GAUSSIANS: f64 = 5000.0;
/// Most of those for each of its particles: a scene of thousands of small objects is not a picture of each.
const GAUSSIANS_PER_PARTICLE: f64 = 200.0;
/// Most Gaussians of one shape.
const MAX_GAUSSIANS: f64 = 5e6;

/// What an object looks like before its rigid motion to the world.
pub(super) enum Looks {
    /// Gaussians of an asset.
    Captured(Gaussians),
    /// Those on the surface of a shape or mesh, made when its particles are.
    Surface {
        /// What it encloses.
        form: Form,
        /// Their colour, RGB 0..=1.
        color: [f32; 3],
        /// Their distance [m]; derived when absent.
        spacing: Option<f64>,
    },
}

impl Looks {
    /// Degree of the spherical harmonics and length of the feature vectors.
    pub fn widths(&self) -> (u8, u32) {
        match self {
            Self::Captured(gaussians) => (gaussians.sh_degree, gaussians.feature_dim),
            // One colour from all sides.
            Self::Surface { .. } => (0, 0),
        }
    }

    /// Why they are too many, with what was asked for.
    pub fn refusal(&self) -> Option<String> {
        let Self::Surface {
            form,
            spacing: Some(spacing),
            ..
        } = self
        else {
            return None;
        };
        let count = form.area() / (spacing * spacing);
        (count > MAX_GAUSSIANS).then(|| {
            format!(
                "`gaussian_spacing` of {spacing} m makes {count:.1e} Gaussians, expected at most {MAX_GAUSSIANS:.0e}"
            )
        })
    }

    /// The Gaussians, of a shape or mesh with so many particles, or none.
    fn gaussians(&mut self, particles: Option<usize>, seed: u64) -> Gaussians {
        match self {
            Self::Captured(gaussians) => std::mem::take(gaussians),
            Self::Surface {
                form,
                color,
                spacing,
            } => {
                let most = particles.map(|count| GAUSSIANS_PER_PARTICLE * count as f64);
                let count = most.map_or(DEFAULT_GAUSSIANS, |most| DEFAULT_GAUSSIANS.min(most));
                form.gaussians(&Style {
                    spacing: spacing.unwrap_or((form.area() / count).sqrt()),
                    paint: Paint::Plain(*color),
                    seed,
                })
            }
        }
    }
}

/// Geometry of an object before its rigid motion to the world.
pub(super) struct Body {
    /// What it looks like.
    pub looks: Looks,
    /// Where its particles come from; none for what is only seen.
    pub rest: Option<Rest>,
    /// Box of the Gaussian centres or of the shape [m].
    pub bounds: Aabb,
    /// Rotation applied to the asset so far.
    pub body_from_asset: DQuat,
}

/// Where the particles of a body come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rest {
    /// What is inside of its shape or mesh.
    Formed,
    Filled {
        closed_below: bool,
    },
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
    /// What is suspicious about it.
    pub warning: Option<String>,
}

/// Particles of a body (none when `rest` is none), its Gaussians, and how these follow the particles.
pub(super) fn sample(
    mut looks: Looks,
    rest: Option<Rest>,
    numerics: &Numerics,
) -> Result<Sampled, String> {
    let spacing = numerics.dx / numerics.particles_per_cell.cbrt();
    let formed = match (rest, &looks) {
        (Some(Rest::Formed), Looks::Surface { form, .. }) => {
            Some(form.particles(numerics, spacing))
        }
        _ => None,
    };
    // At least one: without particles it is refused below.
    let count = formed.as_ref().map(|(made, _)| made.position.len().max(1));
    let gaussians = looks.gaussians(count, numerics.seed);
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
    let mut warning = None;
    let (particles, fill) = match rest {
        Rest::Formed => {
            let (particles, suspicious) = formed.unwrap_or_default();
            warning = suspicious;
            (particles, None)
        }
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
    if count == 0 && rest == Rest::Formed {
        return Err(format!(
            "particles that are {spacing:.3e} m apart find nothing inside of its surface: it is too thin, or `dx` too large"
        ));
    }
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
        warning,
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
