//! The side of a thin collider that a point of deformable matter is on.
//!
//! The nearest face of a thin wall changes when a point is halfway through, and an open mesh has no inside at all. A point that came
//! through a face is therefore held by that face until it is in front of it again, or beside the collider.

use super::{Placed, primitives::Distance, shape::Shape, sweep::SKIN};
use crate::{
    mat3::{dot, length},
    rotation::{conjugate, rotate},
};

/// Smallest cosine between the normal of the nearest face and that of the face a point came through at which both are the same side.
const SAME_SIDE: f64 = 0.3;

/// A point of matter on its way.
#[derive(Clone, Copy, Debug)]
pub struct MovedPoint {
    /// Where it is [units].
    pub x: [f64; 3],
    /// How far it has come in the frame of the collider since it was last looked at [units].
    pub way: [f64; 3],
    /// Outward normal of the face that it came through before, zero where it did not.
    pub side: [f32; 3],
    /// How deep it was behind that face [units].
    pub depth: f64,
}

impl Shape {
    /// How far the shape reaches along a direction, where it is convex.
    fn support(&self, n: [f64; 3]) -> Option<f64> {
        let round = |radius: f64, x: f64, z: f64| radius * x.hypot(z);
        match *self {
            Self::HalfSpace { .. } | Self::Mesh(_) => None,
            Self::Box { half_extents } => Some((0..3).map(|a| half_extents[a] * n[a].abs()).sum()),
            Self::Sphere { radius } => Some(radius),
            Self::Cylinder {
                radius,
                half_height,
            } => Some(round(radius, n[0], n[2]) + half_height * n[1].abs()),
            Self::Capsule {
                radius,
                half_height,
            } => Some(radius + half_height * n[1].abs()),
        }
    }

    /// How deep a point is behind the face with the outward normal `n`; none where it is in front of it or beside the shape. Faces of
    /// meshes are looked for as far as `reach` in front of the point.
    fn depth_behind(&self, x: [f64; 3], n: [f64; 3], reach: f64) -> Option<f64> {
        let before = |by: f64| std::array::from_fn(|a| x[a] + by * n[a]);
        let depth = match self.support(n) {
            Some(support) => {
                let depth = support - dot(n, x);
                let foot = self.distance(before(depth));
                (foot.value <= 1e-6 * depth.abs()).then_some(depth)?
            }
            None => {
                let Self::Mesh(mesh) = self else {
                    return None;
                };
                let (t, normal) = mesh.crossing(before(reach), x)?;
                (dot(normal, n) > SAME_SIDE).then_some((1.0 - t) * reach)?
            }
        };
        (depth > 0.0).then_some(depth)
    }
}

impl Placed<'_> {
    /// Whether matter may come through it to where the other side is nearer: it is thinner than nodes can tell.
    pub fn is_thin(&self) -> bool {
        self.body.is_thin
    }

    /// Signed distance of a point of matter, less the [skin](Self::skin), from the side of a thin collider that it is on, and the outward
    /// normal of the face that it came through or touches, if it is behind that; zero otherwise.
    pub fn separation(&self, point: &MovedPoint) -> (Distance, [f32; 3]) {
        let mut found = self.distance(point.x);
        found.value -= self.skin();
        let is_behind = |normal: [f64; 3]| normal.map(|n| n as f32);
        let inside = |found: Distance| match found.value < 0.0 {
            true => (found, is_behind(found.normal)),
            false => (found, [0.0; 3]),
        };
        let way = length(point.way);
        let mut side = point.side.map(f64::from);
        // From well in front of the face: what has not moved is as deep as it was, and a ray from the face itself does not meet that.
        let mut reach = 1.25 * point.depth + 2.0 * way;
        if side == [0.0; 3] {
            if found.value > way {
                return (found, [0.0; 3]);
            }
            let from = std::array::from_fn(|a| point.x[a] - point.way[a]);
            let ends = [from, point.x].map(|x| self.start.inverse_point(x));
            let skin = SKIN * way;
            let Some((_, normal)) = self.body.shape.first_contact(ends[0], ends[1], skin) else {
                return inside(found);
            };
            side = rotate(self.start.rotation, normal);
            reach = 2.0 * way;
        }
        let size = length(side);
        let side = side.map(|n| n / size);
        if self.body.shape.thickness() > 0.0 && dot(found.normal, side) > SAME_SIDE {
            return inside(found);
        }
        let local = self.start.inverse_point(point.x);
        let n = rotate(conjugate(self.start.rotation), side);
        match self.body.shape.depth_behind(local, n, reach) {
            Some(depth) => {
                let behind = Distance {
                    value: -depth - self.skin(),
                    normal: side,
                };
                (behind, is_behind(side))
            }
            None => inside(found),
        }
    }
}
