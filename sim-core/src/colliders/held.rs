//! Boxes whose nodes are held or moved, at one moment.

use crate::scene::{Aabb, PinnedRegion, Scene, TimeSpan};

/// A held region during one substep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub bounds: Aabb,
    pub velocity: [f64; 3],
    /// Whether it acts always and no matter was in it at the start.
    pub is_empty: bool,
    /// Place among all regions.
    pub id: usize,
}

impl Held {
    pub fn holds(&self, x: [f64; 3]) -> bool {
        self.bounds.contains(x)
    }

    pub fn touches(&self, first: [f64; 3], last: [f64; 3]) -> bool {
        (0..3).all(|a| last[a] >= self.bounds.min[a] && first[a] <= self.bounds.max[a])
    }
}

/// Whether a region always acts and no particle is in it at the start.
pub(super) fn is_empty(region: &PinnedRegion, scene: &Scene) -> bool {
    let inside = |x: &[f64; 3]| region.bounds.contains(*x);
    region.span == TimeSpan::ALWAYS && !scene.particles.position.iter().any(inside)
}
