//! What makes a scene impossible to simulate.

use super::boundary_checks;
use crate::{
    scene::{ContactMethod, Fidelity, Scene},
    simd::Isa,
};

/// Why no world could be made from a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// The processor lacks the instruction set.
    #[error("this processor does not have {0}")]
    NoSuchIsa(Isa),
    /// A number is outside its valid range, NaN included.
    #[error("{what} is {value}, expected {min} to {max}")]
    OutOfRange {
        /// Which number.
        what: String,
        /// Its value.
        value: f64,
        /// Smallest valid value.
        min: f64,
        /// Largest valid value.
        max: f64,
    },
    /// An object's particles are not a run of the scene's particles behind those of the objects before it.
    #[error(
        "object {object} claims particles {start}..{end}, expected a range that begins at {expected} and ends by {count}"
    )]
    ParticleRange {
        /// Object id.
        object: usize,
        /// First particle claimed.
        start: usize,
        /// End of the claim.
        end: usize,
        /// Where it must begin.
        expected: usize,
        /// Particles in the scene.
        count: usize,
    },
    /// The regions of an object do not follow each other up to the end of its particles.
    #[error(
        "region {region} of object {object} claims particles {start}..{end}, expected a range that begins at {expected}"
    )]
    RegionRange {
        /// Object id.
        object: usize,
        /// Region.
        region: usize,
        /// First particle claimed.
        start: usize,
        /// End of the claim.
        end: usize,
        /// Where it must begin.
        expected: usize,
    },
    /// Contact between spheres moves particles, which a rigid object does not have.
    #[error(
        "object {object} is rigid, and contact = \"com_sphere\" is for objects that deform; expected \"two_scale\", \
         \"multi_field\" or \"single_field\""
    )]
    RigidSphere {
        /// Object id.
        object: usize,
    },
    /// A scene cannot come to rest while something in it moves by itself.
    #[error(
        "settle is for scenes in which nothing moves by itself: no moving collider or held region, no rule, no body_force"
    )]
    Unsettled,
    /// Parallel arrays differ in length.
    #[error(
        "scene has {positions} particle positions and {volumes} volumes, expected equal counts"
    )]
    Counts {
        /// Positions.
        positions: usize,
        /// Volumes.
        volumes: usize,
    },
}

/// Largest magnitude of a coordinate [cells].
pub(super) const MAX_CELLS: f64 = 16_777_216.0;

pub(super) fn within(
    what: impl Fn() -> String,
    value: f64,
    min: f64,
    max: f64,
) -> Result<(), WorldError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(WorldError::OutOfRange {
        what: what(),
        value,
        min,
        max,
    })
}

/// Checks every number that the solver computes with.
pub(super) fn validate(scene: &Scene) -> Result<(), WorldError> {
    const BIG: f64 = 1e9;
    let tiny = f64::MIN_POSITIVE;
    within(|| "dx".into(), scene.dx, 1e-6, 1e6)?;
    within(|| "cfl".into(), scene.cfl, tiny, 1.5)?;
    within(|| "frame_rate".into(), scene.frame_rate, tiny, 1e6)?;
    let reach = MAX_CELLS * scene.dx;
    for a in 0..3 {
        within(|| format!("gravity[{a}]"), scene.gravity[a], -BIG, BIG)?;
        within(
            || format!("domain.min[{a}]"),
            scene.domain.min[a],
            -reach,
            reach,
        )?;
        let min = scene.domain.min[a];
        within(
            || format!("domain.max[{a}]"),
            scene.domain.max[a],
            min,
            reach,
        )?;
    }
    boundary_checks::validate(scene)?;
    validate_particles(scene)?;
    validate_objects(scene)
}

fn validate_particles(scene: &Scene) -> Result<(), WorldError> {
    let particles = &scene.particles;
    let count = particles.position.len();
    if particles.volume.len() != count {
        return Err(WorldError::Counts {
            positions: count,
            volumes: particles.volume.len(),
        });
    }
    within(
        || "particle count".into(),
        count as f64,
        0.0,
        f64::from(u32::MAX / 64),
    )?;
    let reach = MAX_CELLS * scene.dx;
    for p in 0..count {
        let what = || format!("volume of particle {p}");
        within(what, particles.volume[p], f64::MIN_POSITIVE, 1e18)?;
        for a in 0..3 {
            let what = || format!("position[{a}] of particle {p}");
            within(what, particles.position[p][a], -reach, reach)?;
        }
    }
    Ok(())
}

fn validate_objects(scene: &Scene) -> Result<(), WorldError> {
    let count = scene.particles.position.len();
    let mut expected = 0;
    for (object, o) in scene.objects.iter().enumerate() {
        let range = &o.particles;
        let empty = range.is_empty();
        if !empty && (range.start < expected || range.end > count) {
            return Err(WorldError::ParticleRange {
                object,
                start: range.start,
                end: range.end,
                expected,
                count,
            });
        }
        if !empty {
            expected = range.end;
        }
        if o.fidelity == Fidelity::Static {
            continue;
        }
        if scene.contact.method == ContactMethod::ComSphere && o.has_rigid_matter() {
            return Err(WorldError::RigidSphere { object });
        }
        let mut end = o.regions.first().map_or(range.end, |r| r.particles.start);
        for (region, r) in o.regions.iter().enumerate() {
            let (first, last) = (r.particles.start, r.particles.end);
            if first != end || first < range.start || last < first || last > range.end {
                return Err(WorldError::RegionRange {
                    object,
                    region,
                    start: first,
                    end: last,
                    expected: end,
                });
            }
            end = last;
        }
        if end != range.end {
            return Err(WorldError::RegionRange {
                object,
                region: o.regions.len(),
                start: range.end,
                end: range.end,
                expected: end,
            });
        }
        let what = |name: &str| format!("{name} of object {object}");
        for part in o.parts(object) {
            part.material
                .check()
                .map_err(|found| WorldError::OutOfRange {
                    what: what(found.key),
                    value: found.value,
                    min: found.min,
                    max: found.max,
                })?;
        }
        for a in 0..3 {
            within(|| what("linear_velocity"), o.linear_velocity[a], -1e6, 1e6)?;
            for value in o.velocity_gradient[a] {
                within(|| what("velocity_gradient"), value, -1e6, 1e6)?;
            }
        }
    }
    Ok(())
}
