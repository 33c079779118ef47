//! Where a cylinder touches: the lowest points of its two rims, and the ends of what lies on its side in between.
//!
//! They are computed for what it meets, so that it rolls on a circle and not on the corners of fixed points. Flat on a
//! lid the lowest point of a rim means nothing; there the fixed points of the lid hold it.

use super::{
    body::Body,
    cylinder::{Circle, Cylinder, crossing},
    feature::{FACE, Feature, Solid, Spot, gap},
    shape::{Form, Shape},
    vector::{Vec3, add, along, length, scaled, sub, unit},
};
use crate::{
    colliders::shape::Shape as Wall,
    mat3::{cross, dot},
    rotation::rotate,
};

/// Sine of the angle between the axis and a normal below which a lid lies flat, and the cosine below which a side does.
pub(super) const FLAT: f64 = 1e-3;
/// Cosine between the normal of a lid and the direction that it is pressed from, above which it takes part.
const LID: f64 = 0.3;
/// Margin, in parts of the smaller of radius and half length, by which points of the other solid may lie outside of
/// the line of contact and still be of it.
const LINE_MARGIN: f64 = 0.1;
/// Directions around a rim among which the search for its lowest point begins: cosine and sine.
const AROUND: [[f64; 2]; 12] = [
    [1.0, 0.0],
    [C, 0.5],
    [0.5, C],
    [0.0, 1.0],
    [-0.5, C],
    [-C, 0.5],
    [-1.0, 0.0],
    [-C, -0.5],
    [-0.5, -C],
    [0.0, -1.0],
    [0.5, -C],
    [C, -0.5],
];
/// Cosine of 30 degrees.
const C: f64 = 0.866_025_403_784_438_6;
/// Distance below which computed points are one, in parts of the smallest radius or half length.
pub(super) const SAME: f64 = 1e-2;
/// How far on each side of a rim's lowest point normals are looked at, in radii: gaps at an impact, 1e-12 cells, are
/// nothing beside it, and curved surfaces are flat.
const EDGE: f64 = 1e-4;
/// Computed points: of the lower and of the upper rim, the lower and the upper end of the line of contact between them.
const RIMS: [u32; 2] = [0, 1];
const ENDS: [u32; 2] = [2, 3];

/// A cylinder in its place.
struct Drum<'a> {
    shape: &'a Shape,
    body: &'a Body,
    form: Cylinder,
    /// World direction of the axis.
    axis: Vec3,
}

impl Drum<'_> {
    /// The circle of its side at a height along the axis.
    fn circle(&self, height: f64) -> Circle {
        Circle {
            center: along(self.body.com, height, self.axis),
            axis: self.axis,
            radius: self.form.radius,
        }
    }

    /// The point of its side at a height that is nearest to another solid.
    fn lowest(&self, height: f64, other: &Solid<'_>) -> Vec3 {
        let others = [1, 2].map(|n| {
            let mut one = [0.0; 3];
            one[(self.form.axis + n) % 3] = 1.0;
            rotate(self.body.rotation, one)
        });
        let is_rim = height.abs() == self.form.half;
        nearest_of_circle(&self.circle(height), others, other, is_rim)
    }

    /// Outward normal of the other solid at a computed point. Where a rim lies on an edge of the other, a mean of the
    /// normals of the edge's two faces: that across both the edge and the rim. Where a side does, its own.
    fn normal(&self, k: u32, x: Vec3, other: &Solid<'_>) -> Vec3 {
        let out = sub(x, self.body.com);
        let radial = unit(along(out, -dot(out, self.axis), self.axis), self.axis);
        if ENDS.contains(&k) {
            return scaled(radial, -1.0);
        }
        let tangent = cross(self.axis, radial);
        across_edge(other, x, tangent, EDGE * self.form.radius)
    }

    /// How fast the distance of the lowest point grows with the height.
    fn rise(&self, height: f64, other: &Solid<'_>) -> f64 {
        dot(other.normal(self.lowest(height, other)), self.axis)
    }

    /// Height of a computed point; that of a rim where the line of contact goes as far.
    fn height(&self, point: u32, other: &Solid<'_>) -> f64 {
        let half = self.form.half;
        let sign = if point.is_multiple_of(2) { 1.0 } else { -1.0 };
        if RIMS.contains(&point) {
            return -sign * half;
        }
        // The lower end: the least height at which the distance does not fall with it. The upper one in a mirror.
        let rise = |x: f64| sign * self.rise(sign * x, other) + FLAT;
        let low = rise(-half);
        if low >= 0.0 {
            return -sign * half;
        }
        let high = rise(half);
        if high < 0.0 {
            return sign * half;
        }
        sign * crossing(&rise, (-half, low), (half, high), 1e-12 * half)
    }
}

/// The point of a circle that is nearest to another solid; of a rim, all around, as an edge across a lid is near in two places. `others`
/// are unit vectors in its plane.
pub(super) fn nearest_of_circle(
    circle: &Circle,
    others: [Vec3; 2],
    other: &Solid<'_>,
    is_rim: bool,
) -> Vec3 {
    let axis = circle.axis;
    let normal = other.normal(circle.center);
    let down = along(scaled(normal, -1.0), dot(normal, axis), axis);
    let mut start = if length(down) > 1e-9 {
        unit(down, down)
    } else {
        others[0]
    };
    // Round-off along the axis would add up.
    start = unit(along(start, -dot(start, axis), axis), start);
    if is_rim && !other.is_plane() {
        let at = |e: Vec3| other.distance(along(circle.center, circle.radius, e));
        let mut least = at(start);
        for [c, s] in AROUND {
            let e = add(scaled(others[0], c), scaled(others[1], s));
            let value = at(e);
            if value < least - 1e-9 * circle.radius {
                (least, start) = (value, e);
            }
        }
    }
    let direction = circle.lowest(&|x| other.normal(x), start);
    along(circle.center, circle.radius, direction)
}

/// Outward normal of a solid at a place on an edge of another that goes along `tangent`; where it lies on an edge, a mean of the normals
/// of that edge's two faces, so far apart [m]: that across both edges.
pub(super) fn across_edge(other: &Solid<'_>, x: Vec3, tangent: Vec3, apart: f64) -> Vec3 {
    let aside = |w: f64| other.normal(along(x, w, tangent));
    let (before, after) = (aside(-apart), aside(apart));
    let (p, q) = (-dot(before, tangent), dot(after, tangent));
    if p <= 0.0 || q <= 0.0 {
        return other.normal(x);
    }
    unit(add(scaled(before, q), scaled(after, p)), before)
}

impl<'a> Solid<'a> {
    fn is_plane(&self) -> bool {
        matches!(self, Self::Wall(wall) if matches!(wall.shape(), Wall::HalfSpace { .. }))
    }

    fn cylinder(&'a self) -> Option<Drum<'a>> {
        let Self::Body(shape, body) = self else {
            return None;
        };
        let Form::Cylinder(form) = shape.form else {
            return None;
        };
        let mut axis = [0.0; 3];
        axis[form.axis] = 1.0;
        Some(Drum {
            shape,
            body,
            form,
            axis: rotate(body.rotation, axis),
        })
    }

    /// Whether a point of it is computed for what it meets, and which.
    pub fn computed(&self, n: u32) -> Option<u32> {
        let Self::Body(shape, _) = self else {
            return None;
        };
        let is_cylinder = matches!(shape.form, Form::Cylinder(_));
        n.checked_sub(shape.points.len() as u32)
            .filter(|_| is_cylinder)
    }

    /// How much a computed point's surface, with the point at `x`, looks in a direction.
    pub fn computed_looks(&self, k: u32, x: Vec3, direction: Vec3) -> f64 {
        let Some(Drum { body, axis, .. }) = self.cylinder() else {
            return 1.0;
        };
        let out = sub(x, body.com);
        let up = dot(out, axis);
        let radial = unit(along(out, -up, axis), axis);
        let side = dot(radial, direction).max(0.0);
        match RIMS.contains(&k) {
            // All directions between the side's and the lid's.
            true => side.hypot((up.signum() * dot(axis, direction)).max(0.0)),
            false => side,
        }
    }

    /// Where the computed point `k` is.
    pub fn compute(&self, k: u32, other: &Solid<'_>) -> Option<Vec3> {
        let cylinder = self.cylinder()?;
        Some(cylinder.lowest(cylinder.height(k, other), other))
    }

    /// Outward normal of another solid at the computed point `k`, which is at `x`.
    pub fn computed_normal(&self, k: u32, x: Vec3, other: &Solid<'_>) -> Vec3 {
        match self.cylinder() {
            Some(cylinder) => cylinder.normal(k, x, other),
            None => other.normal(x),
        }
    }

    /// Whether a fixed point of a cylinder, at this place and gap, may say anything about where it touches.
    pub fn counts(&self, n: u32, x: Vec3, gap: f64, other: &Solid<'_>) -> bool {
        let Some(cylinder) = self.cylinder() else {
            return true;
        };
        let both = matches!(other, Solid::Body(..));
        // What bodies that overlap look to; and in a cavity a rim may lie on all of a circle.
        if both && gap < 0.0 || self.is_held_by(other) {
            return true;
        }
        match cylinder.form.normals(cylinder.shape.points[n as usize]) {
            [Some(lid), _] => -dot(rotate(cylinder.body.rotation, lid), other.normal(x)) > LID,
            // Of a surface that turns inwards a circle touches more than its lowest point.
            _ => matches!(other, Solid::Wall(wall) if !wall.shape().is_convex()),
        }
    }
}

/// Computed points of a cylinder that may be near another solid, with their gaps.
pub(super) fn near_rims(
    a: &Solid<'_>,
    b: &Solid<'_>,
    second: bool,
    margin: f64,
) -> Vec<(Feature, f64)> {
    let (of, other) = if second { (b, a) } else { (a, b) };
    let Some(cylinder) = of.cylinder() else {
        return vec![];
    };
    // Of a ball its own nearest point is enough.
    if other.is_ball() || other.distance(cylinder.body.com) > cylinder.shape.radius + margin {
        return vec![];
    }
    let first = cylinder.shape.points.len() as u32;
    let feature = |k: u32| Feature {
        second,
        point: first + k,
    };
    let mut found = RIMS.map(|k| (feature(k), gap(a, b, feature(k)))).to_vec();
    if other.is_plane() {
        return found;
    }
    for k in ENDS {
        let height = cylinder.height(k, other);
        if height.abs() < (1.0 - 1e-6) * cylinder.form.half {
            let x = cylinder.lowest(height, other);
            found.push((feature(k), other.distance(x)));
        }
    }
    found
}

/// Makes one of computed spots that are the same place, found from both solids or as both ends of a line without length:
/// what they are shared between would hang on their order.
fn merge(a: &Solid<'_>, b: &Solid<'_>, spots: &mut Vec<Spot>) {
    let size = |of: &Solid<'_>| {
        of.cylinder()
            .map_or(f64::INFINITY, |c| c.form.radius.min(c.form.half))
    };
    let near = SAME * size(a).min(size(b));
    let computed = |spot: &Spot| {
        let of = if spot.feature.second { b } else { a };
        of.computed(spot.feature.point).is_some()
    };
    let (mut left, mut merged): (Vec<Spot>, Vec<Spot>) = spots.iter().partition(|s| computed(s));
    while let Some(first) = left.first().copied() {
        let same =
            |s: &Spot| length(sub(s.x, first.x)) < near && dot(s.normal, first.normal) >= FACE;
        let (cluster, others): (Vec<Spot>, Vec<Spot>) = left.into_iter().partition(same);
        left = others;
        let share = 1.0 / cluster.len() as f64;
        let mean = |of: &dyn Fn(&Spot) -> Vec3| {
            cluster
                .iter()
                .fold([0.0; 3], |sum, s| along(sum, share, of(s)))
        };
        merged.push(Spot {
            x: mean(&|s| s.x),
            normal: unit(mean(&|s| s.normal), first.normal),
            gap: cluster.iter().map(|s| share * s.gap).sum(),
            ..first
        });
    }
    *spots = merged;
}

/// Leaves of the spots of a pair those that say where cylinders touch: where a side or a rim does, its computed points
/// and nothing else near their line; where a lid lies flat, its fixed points.
pub(super) fn choose(a: &Solid<'_>, b: &Solid<'_>, spots: &mut Vec<Spot>) {
    for (second, of, other) in [(false, a, b), (true, b, a)] {
        let Some(cylinder) = of.cylinder() else {
            continue;
        };
        if other.is_ball() {
            continue;
        }
        let height = |x: Vec3| dot(sub(x, cylinder.body.com), cylinder.axis);
        // Sine between the axis and the normal.
        let tilt = |spot: &Spot| length(cross(spot.normal, cylinder.axis));
        let is_own = |spot: &Spot| spot.feature.second == second;
        let computed = |spot: &Spot| of.computed(spot.feature.point).filter(|_| is_own(spot));
        spots.retain(|spot| computed(spot).is_none() || tilt(spot) >= FLAT);
        let line: Vec<(u32, Spot)> = spots
            .iter()
            .filter_map(|spot| Some((computed(spot)?, *spot)))
            .collect();
        let beside = LINE_MARGIN * cylinder.form.radius.min(cylinder.form.half);
        let is_of_line = |spot: &Spot| {
            let like = line.iter().filter(|l| dot(l.1.normal, spot.normal) >= FACE);
            let heights: Vec<f64> = like.map(|l| height(l.1.x)).collect();
            let at = height(spot.x);
            heights.iter().any(|h| *h <= at + beside) && heights.iter().any(|h| *h >= at - beside)
        };
        spots.retain(|spot| {
            if !is_own(spot) {
                return other.computed(spot.feature.point).is_some() || !is_of_line(spot);
            }
            if computed(spot).is_some() {
                return true;
            }
            let x = cylinder.shape.points[spot.feature.point as usize];
            let [lid, side] = cylinder.form.normals(x);
            match lid {
                Some(lid) => {
                    let against = if second { 1.0 } else { -1.0 };
                    let normal_impulse =
                        against * dot(rotate(cylinder.body.rotation, lid), spot.normal);
                    let rim = RIMS[usize::from(x[cylinder.form.axis] > 0.0)];
                    let known = side.is_some() && line.iter().any(|l| l.0 == rim);
                    normal_impulse > LID && !known
                }
                None => !line.iter().any(|l| dot(l.1.normal, spot.normal) >= FACE),
            }
        });
    }
    if spots.len() > 1 && (a.cylinder().is_some() || b.cylinder().is_some()) {
        merge(a, b, spots);
    }
}
