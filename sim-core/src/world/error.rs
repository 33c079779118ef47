//! Why a scene cannot be simulated.

use crate::simd::Isa;

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
    /// A solid on a grid of its own is asked for what such solids do not do.
    #[error(
        "object {object} has solver = \"lagrangian\", which does not go with {what}; expected {expected}, or solver = \"spatial\""
    )]
    Solid {
        /// Object id.
        object: usize,
        /// What does not go with it.
        what: String,
        /// What would.
        expected: &'static str,
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

/// Refuses what is outside a range.
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
