//! Where colliders touch bodies with what sticks out of them: corners, edges and rims, and what is round about a corner or an edge.
//!
//! A body that is convex is nearest to an edge in one place, or along a part of it: both ends of that are points of contact, found for
//! where the body is. Of other bodies the distance may have many lowest places; they meet points of the edge as near to each other as
//! what they are known by.

use super::{
    cylinder::{Circle, crossing},
    feature::{Feature, Solid, Spot},
    overlap::FACING,
    rims::{FLAT, SAME, across_edge, nearest_of_circle},
    shape::Form,
    vector::{Vec3, along, length, sub, unit},
};
use crate::{
    colliders::{Placed, skeleton::Skeleton},
    mat3::{cross, dot},
    rotation::rotate,
};

/// Points of one edge at most.
const MOST_OF_EDGE: u32 = 4096;
/// Part of an edge within which a place is its end.
const AT_END: f64 = 1e-9;
/// How far on each side of a place on an edge normals are looked at, in depths of the body.
const ASIDE: f64 = 1e-4;
/// How far off a collider's surface it is looked whether that faces a body [cells], and the least part of it that must be outside: all of
/// it, but for what fields of distances are off.
const OFF: f64 = 1e-2;
/// Rounding of distances, in depths of the body.
const ROUND_OFF: f64 = 1e-9;
const STRAIGHT: f64 = 0.9;

/// A part of a collider that sticks out, by its number in the skeleton.
#[derive(Clone, Copy, Debug)]
enum Part {
    Corner(usize),
    /// The lower and the upper end of where a line is nearest.
    End(usize, usize),
    /// So far along a line, 0 to 1.
    Point(usize, f64),
    Rim(usize),
}

/// Where such a part is nearest to a body.
struct Place {
    x: Vec3,
    /// Radius about it [m].
    radius: f64,
    /// Unit vector along the edge.
    tangent: Option<Vec3>,
    /// Whether another part says the same.
    is_double: bool,
}

/// A collider's skeleton beside a body.
#[derive(Clone, Copy)]
struct Beside<'a> {
    wall: &'a Placed<'a>,
    skeleton: &'a Skeleton,
    other: &'a Solid<'a>,
}

impl<'a> Beside<'a> {
    fn new(wall: &'a Placed<'a>, other: &'a Solid<'a>) -> Self {
        Self {
            wall,
            skeleton: wall.skeleton(),
            other,
        }
    }

    /// Distance between points on the surface of a body that is known by a field [m].
    fn spacing(&self) -> Option<f64> {
        match self.other {
            Solid::Body(shape, _) => match &shape.form {
                Form::Field(field) => Some(field.spacing()),
                Form::Ball(_) | Form::Cuboid(_) | Form::Cylinder(_) => None,
            },
            Solid::Wall(_) => None,
        }
    }

    /// Ends of a line [m].
    fn line(&self, n: usize) -> [Vec3; 2] {
        self.skeleton.ends(n).map(|x| self.wall.start.point(x))
    }

    /// Points that stand for a line, from a field that is known by points so far apart [m].
    fn points_of(&self, n: usize, spacing: f64) -> u32 {
        let [from, to] = self.line(n);
        let count = (length(sub(to, from)) / spacing).ceil();
        count.clamp(1.0, f64::from(MOST_OF_EDGE)) as u32
    }

    /// The part that a number means.
    fn part(&self, n: u32) -> Part {
        let Skeleton { corners, lines, .. } = self.skeleton;
        let Some(n) = n.checked_sub(corners.len() as u32) else {
            return Part::Corner(n as usize);
        };
        if let Some(spacing) = self.spacing() {
            let line = (n / MOST_OF_EDGE) as usize;
            let count = self.points_of(line, spacing);
            let at = (f64::from(n % MOST_OF_EDGE) + 0.5) / f64::from(count);
            return Part::Point(line, at);
        }
        match n.checked_sub(2 * lines.len() as u32) {
            None => Part::End((n / 2) as usize, (n % 2) as usize),
            Some(rim) => Part::Rim(rim as usize),
        }
    }

    /// Both ends of where a line is nearest to a convex body, 0 to 1.
    fn nearest(&self, [from, to]: [Vec3; 2]) -> [f64; 2] {
        let way = sub(to, from);
        let size = length(way);
        let tangent = unit(way, way);
        // The lower end: the least place at which the distance does not fall. The upper one in a mirror.
        [1.0, -1.0].map(|sign| {
            let begin = if sign > 0.0 { from } else { to };
            let rise = |s: f64| {
                let normal = self.other.normal(along(begin, sign * s * size, tangent));
                sign * dot(normal, tangent) + FLAT
            };
            let found = match (rise(0.0), rise(1.0)) {
                (low, _) if low >= 0.0 => 0.0,
                (_, high) if high < 0.0 => 1.0,
                (low, high) => crossing(&rise, (0.0, low), (1.0, high), 1e-13),
            };
            if sign > 0.0 { found } else { 1.0 - found }
        })
    }

    fn place(&self, part: Part) -> Place {
        let Skeleton {
            corner_radius,
            line_radius,
            ..
        } = *self.skeleton;
        match part {
            Part::Corner(n) => Place {
                x: self.wall.start.point(self.skeleton.corners[n]),
                radius: corner_radius,
                tangent: None,
                is_double: false,
            },
            Part::End(n, which) => {
                let [from, to] = self.line(n);
                let found = self.nearest([from, to]);
                let (at, way) = (found[which], sub(to, from));
                let is_end = !(AT_END..=1.0 - AT_END).contains(&at);
                let same = (found[1] - found[0]) * length(way) < SAME * self.size();
                Place {
                    x: along(from, at, way),
                    // What is round about an axis ends with it, unless it is round at its ends too.
                    radius: if is_end { corner_radius } else { line_radius },
                    tangent: (!is_end).then(|| unit(way, way)),
                    is_double: is_end || which == 1 && same,
                }
            }
            Part::Point(n, at) => {
                let [from, to] = self.line(n);
                Place {
                    x: along(from, at, sub(to, from)),
                    radius: line_radius,
                    tangent: None,
                    is_double: false,
                }
            }
            Part::Rim(n) => {
                let [radius, height] = self.skeleton.rims[n];
                let turned = |x: Vec3| rotate(self.wall.start.rotation, x);
                let axis = turned([0.0, 1.0, 0.0]);
                let circle = Circle {
                    center: self.wall.start.point([0.0, height, 0.0]),
                    axis,
                    radius,
                };
                let others = [turned([0.0, 0.0, 1.0]), turned([1.0, 0.0, 0.0])];
                let x = nearest_of_circle(&circle, others, self.other, true);
                let radial = unit(sub(x, circle.center), others[0]);
                Place {
                    x,
                    radius: 0.0,
                    tangent: Some(cross(axis, radial)),
                    is_double: false,
                }
            }
        }
    }

    /// Depth of the body [m].
    fn size(&self) -> f64 {
        match self.other {
            Solid::Body(shape, _) => shape.depth,
            Solid::Wall(_) => 0.0,
        }
    }

    fn gap(&self, place: &Place) -> f64 {
        self.other.distance(place.x) - place.radius - self.wall.skin()
    }

    /// Whether the surface about a place is in the body if the gap says so: at least half as deep. What is round about an axis ends with
    /// that. A body on its end is near the axis, and far from what is round.
    fn is_met(&self, place: &Place, gap: f64) -> bool {
        if place.radius == 0.0 || gap >= 0.0 {
            return true;
        }
        let out = place.radius + self.wall.skin();
        let surface = along(place.x, -out, self.normal(place));
        self.other.distance(surface) <= 0.5 * gap + ROUND_OFF * self.size()
    }

    /// Outward normal of the body at a place; where an edge lies on an edge, that across both.
    fn normal(&self, place: &Place) -> Vec3 {
        match place.tangent {
            Some(tangent) => across_edge(self.other, place.x, tangent, ASIDE * self.size()),
            None => self.other.normal(place.x),
        }
    }
}

/// The gap of a part of a collider, by its number, to a body [m].
pub(super) fn gap_of_part(wall: &Placed<'_>, n: u32, other: &Solid<'_>) -> f64 {
    let beside = Beside::new(wall, other);
    beside.gap(&beside.place(beside.part(n)))
}

/// The spot at a part of a collider, by its number.
pub(super) fn spot_of_part(wall: &Placed<'_>, feature: Feature, other: &Solid<'_>) -> Spot {
    let beside = Beside::new(wall, other);
    let place = beside.place(beside.part(feature.point));
    let (gap, outward) = (beside.gap(&place), beside.normal(&place));
    let out = place.radius + wall.skin() + 0.5 * gap;
    Spot {
        feature,
        x: along(place.x, -out, outward),
        normal: outward.map(|n| -n),
        gap,
    }
}

/// Parts of a collider with a gap to a body below `margin`, with the gap.
pub(super) fn near_parts(wall: &Placed<'_>, other: &Solid<'_>, margin: f64) -> Vec<(Feature, f64)> {
    let Solid::Body(shape, body) = other else {
        return vec![];
    };
    // Of a ball its own nearest point is enough.
    if other.is_ball() {
        return vec![];
    }
    let beside = Beside::new(wall, other);
    let skeleton = beside.skeleton;
    let (corners, lines) = (skeleton.corners.len() as u32, skeleton.lines.len() as u32);
    let reach = shape.radius + margin + wall.skin();
    let [near_corners, near_lines] = skeleton.near(wall.start.inverse_point(body.com), reach);
    let mut numbers = vec![];
    let spacing = beside.spacing();
    // A field is known near its surface: what is round and thicker than that its own points meet.
    let knows = |radius: f64| spacing.is_none_or(|spacing| radius <= 2.0 * spacing);
    if knows(skeleton.corner_radius) {
        numbers.extend(near_corners.into_iter().map(|n| n as u32));
    }
    let far = |x: Vec3| length(sub(x, body.com)) > reach + skeleton.line_radius;
    for n in near_lines {
        let line = n as u32;
        match spacing {
            Some(spacing) if knows(skeleton.line_radius) => {
                let count = beside.points_of(n, spacing);
                let [from, to] = beside.line(n);
                let at =
                    |k: u32| along(from, (f64::from(k) + 0.5) / f64::from(count), sub(to, from));
                let near = (0..count).filter(|&k| !far(at(k)));
                numbers.extend(near.map(|k| corners + line * MOST_OF_EDGE + k));
            }
            Some(_) => {}
            None => {
                let [from, to] = beside.line(n);
                let middle = along(from, 0.5, sub(to, from));
                let least = other.distance(middle) - 0.5 * length(sub(to, from));
                if least <= margin + skeleton.line_radius + wall.skin() {
                    numbers.extend([0, 1].map(|end| corners + 2 * line + end));
                }
            }
        }
    }
    if spacing.is_none() {
        numbers.extend((0..skeleton.rims.len() as u32).map(|n| corners + 2 * lines + n));
    }
    let found = numbers.into_iter().filter_map(|point| {
        let place = beside.place(beside.part(point));
        let gap = beside.gap(&place);
        let feature = Feature {
            second: true,
            point,
        };
        (gap <= margin && beside.is_met(&place, gap)).then_some((feature, gap))
    });
    found.collect()
}

/// Leaves of the spots of a body and a collider those where their surfaces face each other, each once, as long as there are any.
pub(super) fn only_outside(a: &Solid<'_>, b: &Solid<'_>, spots: &mut Vec<Spot>, dx: f64) {
    let Solid::Wall(wall) = b else {
        return;
    };
    let beside = Beside::new(wall, a);
    let faces = |spot: &&Spot| {
        if !spot.feature.second {
            return a.looks(spot, spot.normal.map(|n| -n)) > FACING;
        }
        let place = beside.place(beside.part(spot.feature.point));
        let surface = along(place.x, place.radius, spot.normal);
        let off = OFF * dx;
        let beyond = wall.distance(along(surface, off, spot.normal)).value;
        !place.is_double && beyond > STRAIGHT * off
    };
    let facing: Vec<Spot> = spots.iter().filter(faces).copied().collect();
    if facing.is_empty() {
        // Deep inside: where it came in by is not known.
        spots.retain(|spot| !spot.feature.second);
    } else {
        *spots = facing;
    }
}
