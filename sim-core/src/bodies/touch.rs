//! Where two solids touch: single points of one against the distance from the other, and the few that matter.

use super::{
    ball::Ball,
    body::Body,
    rims::near_rims,
    shape::{Form, Shape},
    vector::{Vec3, add, along, length, sub, unit},
};
use crate::{
    colliders::{Placed, pose::rotate},
    mat3::{cross, dot},
};

/// Rounds in which the point of a ball nearest to a surface is found.
const ROUNDS: usize = 16;
/// Cosine of the angle between normals up to which points belong to one face.
pub(super) const FACE: f64 = 0.9;

/// A body or a collider at a moment.
#[derive(Clone, Copy, Debug)]
pub(super) enum Solid<'a> {
    Body(&'a Shape, Body),
    Wall(&'a Placed<'a>),
}

/// Which point of which of the two solids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Feature {
    /// Whether the point is the second solid's.
    pub second: bool,
    pub point: u32,
}

/// A point where two solids are near each other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub feature: Feature,
    /// Halfway between the two surfaces [m].
    pub x: Vec3,
    /// Out of the second into the first.
    pub normal: Vec3,
    /// Distance between the two; negative where they overlap [m].
    pub gap: f64,
}

impl Solid<'_> {
    pub fn distance(&self, x: Vec3) -> f64 {
        match self {
            Self::Body(shape, body) => shape.distance(body.inverse_point(x)),
            Self::Wall(wall) => wall.distance(x).value - wall.skin(),
        }
    }

    pub fn normal(&self, x: Vec3) -> Vec3 {
        match self {
            Self::Body(shape, body) => rotate(body.rotation, shape.normal(body.inverse_point(x))),
            Self::Wall(wall) => wall.distance(x).normal,
        }
    }

    /// Point `n` of it as far as it is near `other`: place, outward normal of `other`, gap. `other` may be given at
    /// any moment.
    fn probe(&self, n: u32, other: &Solid<'_>) -> Option<(Vec3, f64)> {
        let Self::Body(shape, body) = self else {
            return None;
        };
        match &shape.form {
            Form::Field(_) | Form::Cuboid(_) | Form::Cylinder(_) => {
                let x = match self.computed(n) {
                    Some(k) => self.compute(k, other)?,
                    None => body.point(shape.points[n as usize]),
                };
                Some((x, other.distance(x)))
            }
            Form::Ball(ball) => {
                if other.is_held_by(self) {
                    return None;
                }
                let (c, radius) = (body.point(ball.outer.center), ball.outer.radius);
                if !other.is_field() {
                    return Some((c, other.distance(c) - radius));
                }
                let mut normal = other.normal(c);
                for _ in 0..ROUNDS {
                    let next = other.normal(along(c, -radius, normal));
                    // Half way: at an edge the normal would jump to and fro.
                    let next = unit(add(next, normal), normal);
                    let change = length(sub(next, normal));
                    normal = next;
                    if change < 1e-15 {
                        break;
                    }
                }
                let x = along(c, -radius, normal);
                Some((x, other.distance(x)))
            }
        }
    }

    /// Whether it is a body in the cavity of another.
    pub fn is_held_by(&self, other: &Self) -> bool {
        match (self, other.ball()) {
            (Self::Body(shape, body), Some((ball, around))) => {
                ball.holds(around.inverse_point(body.com), shape.radius)
            }
            _ => false,
        }
    }

    fn is_field(&self) -> bool {
        matches!(
            self,
            Self::Body(
                Shape {
                    form: Form::Field(_),
                    ..
                },
                _
            )
        )
    }

    fn ball(&self) -> Option<(&Ball, &Body)> {
        match self {
            Self::Body(
                Shape {
                    form: Form::Ball(ball),
                    ..
                },
                body,
            ) => Some((ball, body)),
            _ => None,
        }
    }

    pub fn is_ball(&self) -> bool {
        self.ball().is_some()
    }
}

/// Where a point of a body is; the centre of a ball.
pub(super) fn place(of: &Solid<'_>, n: u32) -> Vec3 {
    match of {
        Solid::Body(shape, body) => body.point(match &shape.form {
            Form::Ball(ball) => ball.outer.center,
            _ => shape.points.get(n as usize).copied().unwrap_or_default(),
        }),
        Solid::Wall(_) => [0.0; 3],
    }
}

/// The gap of a feature of the pair `a`, `b` [m].
pub(super) fn gap(a: &Solid<'_>, b: &Solid<'_>, feature: Feature) -> f64 {
    let (of, other) = if feature.second { (b, a) } else { (a, b) };
    of.probe(feature.point, other)
        .map_or(f64::INFINITY, |found| found.1)
}

/// The feature with its place and normal.
pub(super) fn spot(a: &Solid<'_>, b: &Solid<'_>, feature: Feature) -> Spot {
    let (of, other) = if feature.second { (b, a) } else { (a, b) };
    let (x, gap) = of
        .probe(feature.point, other)
        .unwrap_or(([0.0; 3], f64::INFINITY));
    let outward = match of.computed(feature.point) {
        Some(k) => of.computed_normal(k, x, other),
        None => other.normal(x),
    };
    // The ball's own point, where what was probed is its centre.
    let x = match of.ball() {
        Some((ball, _)) if !other.is_field() => along(x, -ball.outer.radius, outward),
        _ => x,
    };
    Spot {
        feature,
        x: along(x, -0.5 * gap, outward),
        normal: if feature.second {
            outward.map(|n| -n)
        } else {
            outward
        },
        gap,
    }
}

/// Features of the pair with a gap below `margin`, with the gap.
pub(super) fn near(a: &Solid<'_>, b: &Solid<'_>, margin: f64) -> Vec<(Feature, f64)> {
    let mut found = Vec::new();
    let balls = a.is_ball() && b.is_ball();
    for (second, of, other) in [(false, a, b), (true, b, a)] {
        let Solid::Body(shape, body) = of else {
            continue;
        };
        // Of two balls one is enough, unless the second is in the first.
        if balls && second && !b.is_held_by(a) {
            continue;
        }
        match &shape.form {
            Form::Ball(_) => {
                let feature = Feature { second, point: 0 };
                found.push((feature, gap(a, b, feature)));
            }
            Form::Field(_) | Form::Cuboid(_) | Form::Cylinder(_) => {
                found.extend(near_rims(a, b, second, margin));
                for cluster in &shape.clusters {
                    let center = body.point(cluster.center);
                    if other.distance(center) > 2.0 * (cluster.radius + margin) {
                        continue;
                    }
                    for n in cluster.points.clone() {
                        let feature = Feature {
                            second,
                            point: n as u32,
                        };
                        let x = body.point(shape.points[n]);
                        let gap = other.distance(x);
                        if gap <= margin && of.counts(feature.point, x, gap, other) {
                            found.push((feature, gap));
                        }
                    }
                }
            }
        }
    }
    found.retain(|(_, gap)| *gap <= margin);
    found
}

/// The few spots that stand for all: per face those that span most of it. Deeper than `deep` the deepest stays too.
pub(super) fn reduce(a: &Solid<'_>, b: &Solid<'_>, mut spots: Vec<Spot>, deep: f64) -> Vec<Spot> {
    // A ball has one nearest point: points of the other count only where they are on another of its sides.
    if a.is_ball() != b.is_ball() {
        let second = b.is_ball();
        if let Some(own) = spots.iter().find(|s| s.feature.second == second).copied() {
            spots.retain(|s| s.feature == own.feature || dot(s.normal, own.normal) < FACE);
        }
    }
    spots.sort_by(|p, q| p.gap.total_cmp(&q.gap).then(p.feature.cmp(&q.feature)));
    let mut kept: Vec<Spot> = Vec::new();
    while let Some(first) = spots.first().copied() {
        let (face, others): (Vec<Spot>, Vec<Spot>) = spots
            .into_iter()
            .partition(|s| dot(s.normal, first.normal) > FACE);
        spots = others;
        kept.extend(span(&face, deep));
    }
    kept
}

/// Up to four of the points of a face, far from each other, and the first if it is deep.
fn span(face: &[Spot], deep: f64) -> Vec<Spot> {
    if face.len() <= 2 {
        return face.to_vec();
    }
    let count = face.len() as f64;
    let middle = [0, 1, 2].map(|a| face.iter().map(|s| s.x[a]).sum::<f64>() / count);
    // Strictly farther by more than round-off: of equals the first feature is kept, whoever moves or turns the scene,
    // and the same ones in every step.
    let mut order: Vec<usize> = (0..face.len()).collect();
    order.sort_by_key(|&n| face[n].feature);
    let best = |score: &dyn Fn(&Spot) -> f64| {
        let (mut at, mut most) = (order[0], score(&face[order[0]]));
        for &n in &order {
            let value = score(&face[n]);
            if value > most + 1e-9 * most.abs() {
                (at, most) = (n, value);
            }
        }
        at
    };
    let p = best(&|s| length(sub(s.x, middle)));
    let q = best(&|s| length(sub(s.x, face[p].x)));
    let line = sub(face[q].x, face[p].x);
    let side = cross(face[p].normal, line);
    let r = best(&|s| dot(sub(s.x, face[p].x), side));
    let t = best(&|s| -dot(sub(s.x, face[p].x), side));
    let mut chosen = vec![p, q, r, t];
    if face[0].gap < deep {
        chosen.push(0);
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|n| face[n]).collect()
}
