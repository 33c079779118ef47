//! What points of contact bore, where the next step begins its search.

use serde::{Deserialize, Serialize};

use super::vector::{Vec3, length, sub};

/// Farthest that a point of contact may have gone from one step to the next and be the same, on the surface of the one that it went
/// the less on [m].
const SAME: f64 = 5e-3;
/// Least cosine of the angle between the two normals of what is the same.
const ALIKE: f64 = 0.9;

/// Forces at a point of contact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CachedImpulse {
    /// The two by their numbers: bodies first, then colliders.
    pub pair: [u32; 2],
    /// Where it is on each of them, in its own frame [m].
    pub places: [Vec3; 2],
    /// Unit normal out of the first, in its frame.
    pub normal: Vec3,
    /// Along the normal [N].
    pub normal_impulse: f64,
    /// Across it, of the whole manifold, on the first [N].
    pub friction_impulse: Vec3,
    /// About it, of the whole manifold [N m].
    pub twist: f64,
}

impl CachedImpulse {
    /// How far another point of the pair is from it [m], where that may be the same.
    fn gone(&self, places: [Vec3; 2], normal: Vec3) -> Option<f64> {
        let way = |n: usize| length(sub(places[n], self.places[n]));
        let gone = way(0).min(way(1));
        (gone < SAME && crate::mat3::dot(normal, self.normal) > ALIKE).then_some(gone)
    }
}

/// Points of one pair, each to be taken once.
pub(super) struct PairImpulses(pub Vec<CachedImpulse>);

impl PairImpulses {
    /// Takes the nearest point.
    pub fn take(&mut self, places: [Vec3; 2], normal: Vec3) -> Option<CachedImpulse> {
        let ways = self.0.iter().enumerate();
        let near = ways.filter_map(|(n, one)| Some((n, one.gone(places, normal)?)));
        let (nearest, _) = near.min_by(|p, q| p.1.total_cmp(&q.1))?;
        Some(self.0.swap_remove(nearest))
    }
}

/// Those of a pair among all, which are in the order of pairs.
pub(super) fn of_pair(all: &[CachedImpulse], pair: [u32; 2]) -> &[CachedImpulse] {
    let begin = all.partition_point(|one| one.pair < pair);
    let end = all.partition_point(|one| one.pair <= pair);
    &all[begin..end]
}
