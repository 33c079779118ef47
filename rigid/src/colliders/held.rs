//! Boxes whose nodes are held or moved, at one moment.

use super::ON_FACE;
use crate::scene::{Aabb, PinnedRegion, Scene, TimeSpan, TurnedBox};

/// A held region during one substep.
#[derive(Clone, Copy, Debug)]
pub(super) struct FixedRegion {
    /// Where it is [units].
    place: TurnedBox,
    /// The box along the axes around it [units].
    pub bounds: Aabb,
    /// Of its nodes [units/s].
    pub velocity: [f64; 3],
    /// See [`has_faces`].
    pub has_faces: bool,
    /// Place among all regions.
    pub id: usize,
}

impl FixedRegion {
    /// The region with this number after it `moved` for so long [s], in units of `unit` metres with cells of `cell` units.
    pub fn new(
        region: &PinnedRegion,
        id: usize,
        has_faces: bool,
        moved: f64,
        cell: f64,
        unit: f64,
    ) -> Self {
        let slack = ON_FACE * cell;
        let at = |x: f64, a: usize| (x + moved * region.velocity[a]) / unit;
        let Aabb { min, max } = region.bounds.bounds;
        let place = TurnedBox {
            bounds: Aabb {
                min: std::array::from_fn(|a| at(min[a], a) - slack),
                max: std::array::from_fn(|a| at(max[a], a) + slack),
            },
            ..region.bounds
        };
        Self {
            place,
            bounds: place.around(),
            velocity: region.velocity.map(|v| v / unit),
            has_faces,
            id,
        }
    }

    pub fn holds(&self, x: [f64; 3]) -> bool {
        self.place.contains(x)
    }

    pub fn touches(&self, first: [f64; 3], last: [f64; 3]) -> bool {
        (0..3).all(|a| last[a] >= self.bounds.min[a] && first[a] <= self.bounds.max[a])
    }
}

/// Whether matter is attached to the faces of a region: it lies along the axes and always acts, and no particle is in it at
/// the start.
pub(super) fn has_faces(region: &PinnedRegion, scene: &Scene) -> bool {
    let inside = |x: &[f64; 3]| region.bounds.contains(*x);
    region.span == TimeSpan::ALWAYS
        && !region.bounds.is_turned()
        && !scene.particles.position.iter().any(inside)
}
