//! The largest allowed substep.

use cosplat_sim_core::{
    mat3::Mat3,
    materials::{
        Coefficients, Material, Trial,
        limits::{DeformationBounds, critical_dt},
        svd::svd,
    },
    report::DtLimit,
    scene::{Part, Scene},
};

use crate::Particles;

/// A substep and what limits it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeStep {
    /// Size [s]; infinite without particles.
    pub dt: f64,
    /// Cause.
    pub limit: DtLimit,
    /// Object behind it.
    pub object: Option<usize>,
}

impl TimeStep {
    /// Limited by the frame alone.
    pub(crate) const FRAME: Self = Self {
        dt: f64::INFINITY,
        limit: DtLimit::Frame,
        object: None,
    };
}

/// Largest `|v| dt` [cells].
const MAX_TRAVEL: f64 = 0.5;
/// Largest `dt |C|`.
const MAX_STRAIN: f64 = 0.4;

/// Smallest of: `cfl` times the isolated-particle limit at the current tangent, and the kinematic limits.
pub(crate) fn time_step(
    scene: &Scene,
    parts: &[Part],
    materials: &[Material],
    particles: &Particles,
) -> TimeStep {
    let mut smallest = TimeStep::FRAME;
    for (part, material) in parts.iter().zip(materials) {
        let k = Coefficients::new(material);
        let mut bounds = DeformationBounds::REST;
        let (mut speed, mut rate) = (0.0_f64, 0.0_f64);
        let alive = part.particles.clone().filter(|&p| particles.mass[p] > 0.0);
        let mut count = 0;
        for p in alive {
            let response = material.law.respond(
                &Trial {
                    f: Mat3(particles.elastic[p]),
                    memory: particles.memory[p],
                    gradient: Mat3(particles.affine[p]),
                    dt: 0.0,
                },
                &k,
            );
            if !material.law.is_fluid() {
                let stretch = svd(&response.f).sigma[0];
                bounds.max_stretch = bounds.max_stretch.max(stretch);
            }
            bounds.min_j = bounds.min_j.min(response.j);
            bounds.max_j = bounds.max_j.max(response.j);
            bounds.max_stiffness = bounds.max_stiffness.max(response.stiffness);
            speed = speed.max(
                particles.velocity[p]
                    .iter()
                    .map(|v| v * v)
                    .sum::<f64>()
                    .sqrt(),
            );
            rate = rate.max(Mat3(particles.affine[p]).norm_squared().sqrt());
            count += 1;
        }
        if count == 0 {
            continue;
        }
        let rho0 = part.material.density;
        let kept = scene.conditions.time_step_kept(material.law.is_fluid());
        let sound = kept * critical_dt(material, rho0, scene.dx, &bounds);
        for (dt, limit) in [
            (scene.cfl * sound, DtLimit::Sound),
            (MAX_TRAVEL * scene.dx / speed, DtLimit::Velocity),
            (MAX_STRAIN / rate, DtLimit::Deformation),
        ] {
            if dt < smallest.dt {
                smallest = TimeStep {
                    dt,
                    limit,
                    object: Some(part.object),
                };
            }
        }
    }
    smallest
}
