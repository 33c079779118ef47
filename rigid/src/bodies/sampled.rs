//! Shapes that parry has none of: a distance, and points of the surface that are looked at in the distance of what they meet.
//!
//! What narrow things meet between those points, edges of the other say, which are looked at in the distance of this one.

use rapier3d_f64::parry::{
    bounding_volume::{Aabb, BoundingSphere, BoundingVolume},
    mass_properties::MassProperties,
    math::{Pose, Real, Vector},
    query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection},
    shape::{FeatureId, Shape, ShapeType, TypedShape},
};

use super::{
    ball::Ball,
    field::Field,
    points::Cluster,
    probes::Probe,
    vector::{Vec3, length, scaled},
};
use crate::{
    colliders::{
        mesh,
        primitives::{Distance, ball, box_distance, cylinder_distance},
    },
    mat3::dot,
};

/// Where the surface is.
#[derive(Clone, Debug)]
pub(super) enum Source {
    /// A hollow ball.
    Hollow(Ball),
    Field(Field),
}

/// A surface known by its distance and by points.
#[derive(Clone, Debug)]
pub(super) struct Sampled {
    source: Source,
    points: Vec<Vec3>,
    clusters: Vec<Cluster>,
    bounds: Aabb,
}

impl Sampled {
    pub fn new(source: Source, points: Vec<Vec3>, clusters: Vec<Cluster>) -> Self {
        let bounds = match &source {
            Source::Hollow(ball) => {
                Aabb::from_half_extents(ball.outer.center.into(), Vector::splat(ball.outer.radius))
            }
            Source::Field(field) => {
                let all = points.iter().map(|x| Vector::from(*x));
                Aabb::from_points(all).loosened(0.5 * field.spacing())
            }
        };
        Self {
            source,
            points,
            clusters,
            bounds,
        }
    }

    /// Signed distance [m].
    pub fn distance(&self, x: Vec3) -> f64 {
        match &self.source {
            Source::Hollow(ball) => ball.distance(x),
            Source::Field(field) => field.distance(x),
        }
    }

    /// Outward normal.
    pub fn normal(&self, x: Vec3) -> Vec3 {
        match &self.source {
            Source::Hollow(ball) => ball.normal(x),
            Source::Field(field) => field.normal(x),
        }
    }

    /// Depth of the point that is deepest inside [m].
    pub fn depth(&self) -> f64 {
        match &self.source {
            Source::Hollow(ball) => ball.depth(),
            Source::Field(field) => field.depth(),
        }
    }

    /// Farthest that a point of the surface is from the origin [m].
    pub fn reach(&self) -> f64 {
        let points = self.points.iter().map(|x| length(*x));
        points.fold(0.0, f64::max)
    }

    /// Distance between points that its surface is known by [m].
    pub fn spacing(&self) -> f64 {
        match &self.source {
            Source::Hollow(ball) => ball.outer.radius,
            Source::Field(field) => field.spacing(),
        }
    }

    /// Whether it is a field, which is known near its surface alone.
    pub fn is_field(&self) -> bool {
        matches!(self.source, Source::Field(_))
    }

    /// Points of it, as far as they may be nearer than `margin` [m] to another, whose place in its frame is `at`.
    pub fn probes(&self, other: &dyn Shape, at: &Pose, margin: f64) -> Vec<Probe> {
        match &self.source {
            Source::Hollow(ball) => match self.holds(other, at) {
                true => vec![],
                false => vec![Probe {
                    x: ball.outer.center,
                    radius: ball.outer.radius,
                    normal: None,
                }],
            },
            Source::Field(field) => {
                let is_near = |cluster: &&Cluster| {
                    let center = at.inverse_transform_point(cluster.center.into());
                    distance(other, center.into()).value <= 2.0 * (cluster.radius + margin)
                };
                let near = self.clusters.iter().filter(is_near);
                let points = near.flat_map(|cluster| &self.points[cluster.points.clone()]);
                let probe = |x: &Vec3| Probe {
                    x: *x,
                    radius: 0.0,
                    normal: Some(field.normal(*x)),
                };
                points.map(probe).collect()
            }
        }
    }

    /// Whether another shape is in its cavity.
    pub fn holds(&self, other: &dyn Shape, at: &Pose) -> bool {
        let Source::Hollow(ball) = &self.source else {
            return false;
        };
        let around = other.compute_bounding_sphere(at);
        ball.holds(around.center.into(), around.radius)
    }
}

/// Signed distance [m] and outward normal of a shape at a point of its frame.
pub(super) fn distance(shape: &dyn Shape, x: Vec3) -> Distance {
    match shape.as_typed_shape() {
        TypedShape::HalfSpace(plane) => Distance {
            value: dot(plane.normal.into(), x),
            normal: plane.normal.into(),
        },
        TypedShape::Cuboid(cuboid) => box_distance(cuboid.half_extents.into(), x),
        TypedShape::RoundCuboid(round) => {
            let half: Vec3 = round.inner_shape.half_extents.into();
            box_distance(half.map(|h| h + round.border_radius), x)
        }
        TypedShape::Ball(round) => ball(x, round.radius),
        TypedShape::Cylinder(cylinder) => {
            cylinder_distance(cylinder.radius, cylinder.half_height, x)
        }
        TypedShape::RoundCylinder(round) => {
            let (inner, border) = (&round.inner_shape, round.border_radius);
            cylinder_distance(inner.radius + border, inner.half_height + border, x)
        }
        TypedShape::Capsule(capsule) => {
            let half = capsule.half_height();
            let y = x[1] - x[1].clamp(-half, half);
            ball([x[0], y, x[2]], capsule.radius)
        }
        TypedShape::TriMesh(surface) => mesh::signed_distance(surface, x),
        _ => match shape.as_shape::<Sampled>() {
            Some(sampled) => Distance {
                value: sampled.distance(x),
                normal: sampled.normal(x),
            },
            None => Distance {
                value: f64::INFINITY,
                normal: [0.0, 1.0, 0.0],
            },
        },
    }
}

impl PointQuery for Sampled {
    fn project_local_point(&self, x: Vector, solid: bool) -> PointProjection {
        let (gap, normal) = (self.distance(x.into()), self.normal(x.into()));
        let is_inside = gap <= 0.0;
        let point = match solid && is_inside {
            true => x,
            false => x - Vector::from(scaled(normal, gap)),
        };
        PointProjection::new(is_inside, point)
    }

    fn project_local_point_and_get_feature(&self, x: Vector) -> (PointProjection, FeatureId) {
        (self.project_local_point(x, false), FeatureId::Unknown)
    }
}

impl RayCast for Sampled {
    /// Nobody casts rays at bodies through rapier.
    fn cast_local_ray_and_get_normal(&self, _: &Ray, _: Real, _: bool) -> Option<RayIntersection> {
        None
    }
}

impl Shape for Sampled {
    fn compute_local_aabb(&self) -> Aabb {
        self.bounds
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.bounds.bounding_sphere()
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, _: Vector, _: u32) -> Option<Box<dyn Shape>> {
        None
    }

    /// None: bodies state their own.
    fn mass_properties(&self, _: Real) -> MassProperties {
        MassProperties::default()
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Custom(self)
    }

    fn ccd_thickness(&self) -> Real {
        self.depth()
    }

    fn ccd_angular_thickness(&self) -> Real {
        std::f64::consts::FRAC_PI_4
    }
}
