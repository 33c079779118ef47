//! Signed distance of collider shapes, for whoever fills a shape with particles or checks a finished scene.

use crate::{
    colliders::shape::Shape,
    scene::{Collider, ColliderShape, Pose, pose_at},
};

/// Distance of points from the surface of a shape, in SI units.
#[derive(Clone, Debug)]
pub struct SignedDistance {
    shape: Shape,
    /// Where the shape is; none of a shape in its own frame.
    pose: Option<Pose>,
}

impl SignedDistance {
    /// Distance from a shape in its own frame; of a mesh this builds a search tree.
    pub fn new(shape: &ColliderShape) -> Self {
        Self {
            shape: Shape::new(shape, 1.0),
            pose: None,
        }
    }

    /// Distance from a collider where it is at time 0.
    pub fn at_start(collider: &Collider) -> Self {
        Self {
            pose: Some(pose_at(&collider.pose, &collider.motion, 0.0)),
            ..Self::new(&collider.shape)
        }
    }

    /// Distance of `x` [m], negative inside, and the unit vector along which it grows fastest, in the shape's own frame.
    ///
    /// An open mesh has no inside; a mesh without triangles is infinitely far away.
    pub fn at(&self, x: [f64; 3]) -> (f64, [f64; 3]) {
        let x = self.pose.map_or(x, |pose| pose.inverse_point(x));
        let found = self.shape.distance(x);
        (found.value, found.normal)
    }

    /// Number of directed edges that no neighbouring triangle meets: not 0 where a mesh encloses nothing.
    /// None where it is closed, or no mesh.
    pub fn loose_edges(&self) -> Option<usize> {
        match &self.shape {
            Shape::Mesh(mesh) if !mesh.is_closed() => Some(mesh.loose_edges()),
            _ => None,
        }
    }
}
