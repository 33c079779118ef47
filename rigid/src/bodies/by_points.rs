//! Manifolds by points: those of either shape in the distance of the other.

use rapier3d_f64::parry::{
    bounding_volume::BoundingVolume,
    math::{Pose, Vector},
    query::{ContactManifold, TrackedContact},
    shape::{PackedFeatureId, Shape},
};

use super::{
    probes::{Probe, probes},
    sampled::{Sampled, distance},
    vector::{Vec3, add, along, length, sub, unit},
};
use crate::mat3::{cross, dot};

/// Rounds in which the point of a ball nearest to a surface is found.
const ROUNDS: usize = 16;
/// Cosine of the angle between normals up to which points are of one manifold.
const FACE: f64 = 0.998;
/// Manifolds of a pair at most: those of the deepest points.
const MOST_FACES: usize = 12;
/// Distance between points of what is known exactly, in parts of the radius about it.
const SPACING: f64 = 0.1;
/// How much farther off a point must be to be taken in place of an earlier one, in parts, and how much deeper [m].
const ALIKE: f64 = 1e-3;
const SLACK: f64 = 2e-5;
/// Depth from which on only points count whose surface faces the other [spacings], and the least cosine of the angle at which it does:
/// more than round-off has, less than an edge that meets a face.
const DEEP: f64 = 0.05;
const FACING: f64 = 0.3;

/// Points of contact with one normal; places and normals are in the frames of the two.
pub(super) type Manifold = ContactManifold<(), ()>;

/// Where two surfaces are near each other, in the frame of the first.
#[derive(Clone, Copy)]
struct Spot {
    /// On each.
    x: [Vec3; 2],
    /// Out of the first.
    normal: Vec3,
    gap: f64,
    /// Whether the two surfaces face each other.
    faces: bool,
    /// Place in the order of probes.
    number: usize,
}

/// Where a probe of one is near the surface of another, in the frame of the latter.
struct ProbeGap {
    /// On the surface that the probe stands for, and on the other.
    own: Vec3,
    on: Vec3,
    /// Out of the other.
    normal: Vec3,
    gap: f64,
    faces: bool,
}

impl ProbeGap {
    /// Of a probe whose frame the pose takes into that of the other; infinitely far where that is known by no number.
    fn new(probe: &Probe, other: &dyn Shape, to_other: &Pose) -> Self {
        let center = Vec3::from(to_other.transform_point(probe.x.into()));
        let found = distance(other, center);
        let mut normal = found.normal;
        let mut gap = found.value - probe.radius;
        if probe.radius > 0.0 && other.as_shape().is_some_and(Sampled::is_field) {
            // The field is known near its surface.
            for _ in 0..ROUNDS {
                let next = distance(other, along(center, -probe.radius, normal)).normal;
                // Half way: at an edge the normal would jump to and fro.
                let next = unit(add(next, normal), normal);
                let change = length(sub(next, normal));
                normal = next;
                if change < 1e-15 {
                    break;
                }
            }
            gap = distance(other, along(center, -probe.radius, normal)).value;
        }
        let own = along(center, -probe.radius, normal);
        let turned = |own: Vec3| Vec3::from(to_other.rotation * Vector::from(own));
        Self {
            own,
            on: along(own, -gap, normal),
            normal,
            gap: if gap.is_nan() { f64::INFINITY } else { gap },
            faces: probe
                .normal
                .is_none_or(|own| dot(turned(own), normal) < -FACING),
        }
    }

    /// The spot of a probe of the second: the frame is that of the first.
    fn of_second(self, number: usize) -> Spot {
        Spot {
            x: [self.on, self.own],
            normal: self.normal,
            gap: self.gap,
            faces: self.faces,
            number,
        }
    }

    /// The spot of a probe of the first.
    fn of_first(self, pos12: &Pose, number: usize) -> Spot {
        let point = |x: Vec3| Vec3::from(pos12.transform_point(x.into()));
        Spot {
            x: [point(self.own), point(self.on)],
            normal: (pos12.rotation * -Vector::from(self.normal)).into(),
            gap: self.gap,
            faces: self.faces,
            number,
        }
    }
}

/// Manifolds of a pair by points of both: where one at least is [`Sampled`], or flat and round.
pub(super) fn by_points(
    pos12: &Pose,
    g1: &dyn Shape,
    g2: &dyn Shape,
    prediction: f64,
) -> Vec<Manifold> {
    let pos21 = pos12.inverse();
    let both = [g1, g2];
    let sampled = both.map(|shape| shape.as_shape::<Sampled>());
    let mut spots: Vec<Spot> = vec![];
    // What is known exactly is looked at where the smaller of the two may be.
    let least = both.map(|shape| shape.compute_local_bounding_sphere().radius);
    let known = sampled.iter().flatten().map(|sampled| sampled.spacing());
    let spacing = known.fold(SPACING * least[0].min(least[1]), f64::min);
    let deep = DEEP * spacing;
    for second in [false, true] {
        // Points of `one` in the distance of `other`.
        let n = usize::from(second);
        let (one, other, to_other) = match second {
            false => (g1, g2, &pos21),
            true => (g2, g1, pos12),
        };
        let from_other = to_other.inverse();
        let found = match (sampled[n], sampled[1 - n]) {
            (Some(sampled), _) => sampled.probes(other, &from_other, prediction),
            // Of what is outside of a hollow ball the ball's own nearest point is enough.
            (None, Some(hollow)) if !hollow.is_field() && !hollow.holds(one, to_other) => vec![],
            (None, _) => {
                let within = other.compute_aabb(&from_other).loosened(prediction);
                probes(one, &within, spacing)
            }
        };
        for probe in found {
            let met = ProbeGap::new(&probe, other, to_other);
            if met.gap <= prediction {
                spots.push(match second {
                    true => met.of_second(spots.len()),
                    false => met.of_first(pos12, spots.len()),
                });
            }
        }
    }
    // Of what overlaps points may be nearest to a side that they did not come in by: two sides would hold each other.
    if spots.iter().any(|spot| spot.gap < -deep) && spots.iter().any(|spot| spot.faces) {
        spots.retain(|spot| spot.faces);
    }
    reduced(spots, pos12)
}

/// The few spots that stand for all: per face those that span most of it, and the deepest.
fn reduced(mut spots: Vec<Spot>, pos12: &Pose) -> Vec<Manifold> {
    // In a stable order: of equals the first stays.
    spots.sort_by(|p, q| p.gap.total_cmp(&q.gap));
    let mut manifolds = vec![];
    while let Some(first) = spots.first().copied() {
        if manifolds.len() == MOST_FACES {
            break;
        }
        let is_of_face = |spot: &Spot| dot(spot.normal, first.normal) > FACE;
        let (face, others): (Vec<Spot>, Vec<Spot>) = spots.into_iter().partition(is_of_face);
        spots = others;
        manifolds.push(manifold(&span(&face), pos12));
    }
    manifolds
}

fn manifold(spots: &[Spot], pos12: &Pose) -> Manifold {
    let mut manifold = Manifold::new();
    let normal = Vector::from(spots[0].normal);
    manifold.local_n1 = normal;
    manifold.local_n2 = pos12.rotation.inverse() * -normal;
    for spot in spots {
        let (p1, p2) = (Vector::from(spot.x[0]), Vector::from(spot.x[1]));
        let p2 = pos12.inverse_transform_point(p2);
        let unknown = PackedFeatureId::UNKNOWN;
        let point = TrackedContact::new(p1, p2, unknown, unknown, spot.gap);
        manifold.points.push(point);
    }
    manifold
}

/// Up to four of the points of a face, far from each other, and the one that is deepest where it is deeper than those. The first of them
/// in the order of probes stays, wherever two are as good: what stands on them would tremble if they were others in every step.
fn span(face: &[Spot]) -> Vec<Spot> {
    if face.len() <= 2 {
        return face.to_vec();
    }
    let mut order: Vec<usize> = (0..face.len()).collect();
    order.sort_by_key(|&n| face[n].number);
    let place = |n: usize| face[n].x[0];
    let count = face.len() as f64;
    let middle = [0, 1, 2].map(|a| face.iter().map(|spot| spot.x[0][a]).sum::<f64>() / count);
    // Strictly farther by more than the solver lets things overlap: of equals the first is kept.
    let best = |score: &dyn Fn(usize) -> f64| {
        let (mut at, mut most) = (order[0], score(order[0]));
        for &n in &order {
            let value = score(n);
            if value > most + ALIKE * most.abs() {
                (at, most) = (n, value);
            }
        }
        at
    };
    let first = best(&|n| length(sub(place(n), middle)));
    let far = best(&|n| length(sub(place(n), place(first))));
    let line = sub(place(far), place(first));
    let side = cross(face[0].normal, line);
    let left = best(&|n| dot(sub(place(n), place(first)), side));
    let right = best(&|n| -dot(sub(place(n), place(first)), side));
    let mut chosen = vec![first, far, left, right];
    let deepest = chosen
        .iter()
        .map(|&n| face[n].gap)
        .fold(f64::INFINITY, f64::min);
    if face[0].gap < deepest - SLACK {
        chosen.push(0);
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|n| face[n]).collect()
}
