//! A point of one solid against the distance from another: where it is, how near, and along which normal.

use super::{
    ball::Ball,
    body::Body,
    edges::{gap_of_part, spot_of_part},
    shape::{Form, Shape},
    vector::{Vec3, add, along, length, sub, unit},
};
use crate::{colliders::Placed, rotation::rotate};

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
    if let Solid::Wall(wall) = of {
        return gap_of_part(wall, feature.point, other);
    }
    of.probe(feature.point, other)
        .map_or(f64::INFINITY, |found| found.1)
}

/// The feature with its place and normal.
pub(super) fn spot(a: &Solid<'_>, b: &Solid<'_>, feature: Feature) -> Spot {
    let (of, other) = if feature.second { (b, a) } else { (a, b) };
    if let Solid::Wall(wall) = of {
        return spot_of_part(wall, feature, other);
    }
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
