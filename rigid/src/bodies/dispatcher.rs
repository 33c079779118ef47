//! What rapier asks about pairs of shapes. Its world lives for one step of ours: manifolds that it keeps meanwhile depend on nothing that
//! came before.

use std::sync::Arc;

use rapier3d_f64::{
    geometry::{ContactData, ContactManifoldData},
    parry::{
        bounding_volume::{Aabb, BoundingSphere},
        math::{Pose, Real, Vector},
        query::{
            ClosestPoints, Contact, ContactManifold, DefaultQueryDispatcher, NonlinearRigidMotion,
            PersistentQueryDispatcher, PointProjection, PointQuery, QueryDispatcher, Ray, RayCast,
            RayIntersection, ShapeCastHit, ShapeCastOptions, TrackedContact, Unsupported,
            details::{
                ContactManifoldsWorkspace, NormalConstraints, VoxelsShapeContactManifoldsWorkspace,
            },
        },
        shape::{FeatureId, PackedFeatureId, Shape, ShapeType, SharedShape, TypedShape},
    },
    prelude::MassProperties,
};

use super::{
    by_points::Manifold,
    manifolds::{lies_on_lid, manifolds},
    warm_start::{CachedImpulse, PairImpulses, of_pair},
};

/// Cosine of the turn and square of the way [m^2] within which points of a manifold stay: of flat faces as parry has it, a degree and a
/// millimetre. What is round rolls on.
const STAYS: [f64; 2] = [0.999_847_7, 1e-6];
const STAYS_ROUND: [f64; 2] = [1.0 - 5e-9, 4e-10];

/// A shape with the place of whose it is among bodies and colliders.
#[derive(Clone)]
pub(super) struct Tagged {
    pub id: u32,
    pub shape: SharedShape,
}

/// The shape itself.
fn untagged(shape: &dyn Shape) -> &dyn Shape {
    shape
        .as_shape::<Tagged>()
        .map_or(shape, |tagged| &*tagged.shape)
}

/// Whether a shape is flat where it has a normal.
fn is_flat(shape: &dyn Shape, normal: Vector) -> bool {
    match shape.as_typed_shape() {
        TypedShape::Cuboid(_) | TypedShape::RoundCuboid(_) | TypedShape::HalfSpace(_) => true,
        _ => lies_on_lid(shape, normal),
    }
}

/// Answers about [`Tagged`] shapes.
#[derive(Clone)]
pub(super) struct Dispatcher {
    /// What pairs bore that have no manifold yet, in their order.
    pub warm_start: Arc<Vec<CachedImpulse>>,
    /// Length of the solver's iterations that come [s].
    pub length: f64,
    /// Of those before [s].
    pub before: f64,
}

type SolverManifold = ContactManifold<ContactManifoldData, ContactData>;

/// What the points of a pair's manifolds bore in their step, in impulses of the length of the solver's iterations.
pub(super) fn borne(manifolds: &[SolverManifold]) -> impl Iterator<Item = CachedImpulse> + '_ {
    let points = manifolds
        .iter()
        .flat_map(|manifold| manifold.points.iter().map(move |point| (manifold, point)));
    let bore = points.filter(|(_, point)| point.data.impulse > 0.0);
    bore.map(|(manifold, point)| CachedImpulse {
        pair: [0; 2],
        places: [point.local_p1.into(), point.local_p2.into()],
        normal: manifold.local_n1.into(),
        normal_impulse: point.data.warmstart_impulse,
        friction_impulse: point.data.warmstart_tangent_world.into(),
        twist: point.data.warmstart_twist_impulse,
    })
}

impl Dispatcher {
    /// Forces that a pair is known to have borne, as impulses of the coming iterations.
    fn known(&self, pair: [u32; 2], manifolds: &[SolverManifold]) -> PairImpulses {
        let scaled = |one: CachedImpulse, scale: f64| CachedImpulse {
            normal_impulse: scale * one.normal_impulse,
            friction_impulse: one.friction_impulse.map(|j| scale * j),
            twist: scale * one.twist,
            ..one
        };
        if !manifolds.is_empty() {
            let scale = self.length / self.before;
            return PairImpulses(borne(manifolds).map(|one| scaled(one, scale)).collect());
        }
        let cached = of_pair(&self.warm_start, pair).iter();
        PairImpulses(cached.map(|one| scaled(*one, self.length)).collect())
    }
}

/// Makes what a point bore in the step before the beginning of the next, whose impulses are `scale` times as long. A point that comes
/// and goes begins with what it bore when it was last there.
fn keep(data: &mut ContactData, scale: f64) {
    data.warmstart_impulse *= scale;
    data.warmstart_tangent_world *= scale;
    data.warmstart_twist_impulse *= scale;
}

/// Writes the points of a manifold, with what they are known to have borne.
fn write(found: &Manifold, known: &mut PairImpulses, into: &mut SolverManifold) {
    into.points.clear();
    (into.local_n1, into.local_n2) = (found.local_n1, found.local_n2);
    let unknown = PackedFeatureId::UNKNOWN;
    for point in &found.points {
        let (p1, p2) = (point.local_p1, point.local_p2);
        let mut contact = TrackedContact::<ContactData>::new(p1, p2, unknown, unknown, point.dist);
        if let Some(bore) = known.take([p1.into(), p2.into()], found.local_n1.into()) {
            contact.data.warmstart_impulse = bore.normal_impulse;
            contact.data.warmstart_tangent_world = bore.friction_impulse.into();
            contact.data.warmstart_twist_impulse = bore.twist;
        }
        into.points.push(contact);
    }
}

impl PersistentQueryDispatcher<ContactManifoldData, ContactData> for Dispatcher {
    fn contact_manifolds(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        prediction: Real,
        into: &mut Vec<SolverManifold>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        // Points that have hardly moved stay the same ones: found anew they are others where edges lie on edges, and what stands on them
        // trembles.
        if let [one] = &mut into[..]
            && workspace.is_none()
        {
            let is_flat =
                is_flat(untagged(g1), one.local_n1) && is_flat(untagged(g2), one.local_n2);
            let [turn, way] = if is_flat { STAYS } else { STAYS_ROUND };
            if one.try_update_contacts_eps(pos12, turn, way) {
                let scale = self.length / self.before;
                one.points
                    .iter_mut()
                    .for_each(|point| keep(&mut point.data, scale));
                return Ok(());
            }
        }
        let id = |shape: &dyn Shape| shape.as_shape::<Tagged>().map_or(0, |tagged| tagged.id);
        let mut known = self.known([id(g1), id(g2)], into);
        let found = manifolds(pos12, untagged(g1), untagged(g2), prediction);
        // One is kept, as rapier does itself for shapes that are convex: it knows manifolds by their places in the list.
        let count = found.len().max(1);
        let is_one = into.len() <= 1 && count == 1;
        into.truncate(count);
        into.resize_with(count, SolverManifold::new);
        into[0].points.clear();
        for (found, into) in found.iter().zip(into.iter_mut()) {
            write(found, &mut known, into);
        }
        // Tells that manifolds may have changed places.
        *workspace = (!is_one).then(|| VoxelsShapeContactManifoldsWorkspace::<2>::new().into());
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        normals1: Option<&dyn NormalConstraints>,
        normals2: Option<&dyn NormalConstraints>,
        prediction: Real,
        manifold: &mut SolverManifold,
    ) -> Result<(), Unsupported> {
        let (g1, g2) = (untagged(g1), untagged(g2));
        DefaultQueryDispatcher
            .contact_manifold_convex_convex(pos12, g1, g2, normals1, normals2, prediction, manifold)
    }
}

impl QueryDispatcher for Dispatcher {
    fn intersection_test(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
    ) -> Result<rapier3d_f64::parry::query::ShapeIntersection, Unsupported> {
        DefaultQueryDispatcher.intersection_test(pos12, untagged(g1), untagged(g2))
    }

    fn distance(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
    ) -> Result<rapier3d_f64::parry::query::ShapeDistance, Unsupported> {
        DefaultQueryDispatcher.distance(pos12, untagged(g1), untagged(g2))
    }

    fn contact(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        prediction: Real,
    ) -> Result<Option<Contact>, Unsupported> {
        DefaultQueryDispatcher.contact(pos12, untagged(g1), untagged(g2), prediction)
    }

    fn closest_points(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        max_dist: Real,
    ) -> Result<ClosestPoints, Unsupported> {
        DefaultQueryDispatcher.closest_points(pos12, untagged(g1), untagged(g2), max_dist)
    }

    fn cast_shapes(
        &self,
        pos12: &Pose,
        vel12: Vector,
        g1: &dyn Shape,
        g2: &dyn Shape,
        options: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes(pos12, vel12, untagged(g1), untagged(g2), options)
    }

    fn cast_shapes_nonlinear(
        &self,
        motion1: &NonlinearRigidMotion,
        g1: &dyn Shape,
        motion2: &NonlinearRigidMotion,
        g2: &dyn Shape,
        start_time: Real,
        end_time: Real,
        stop_at_penetration: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        // Fields of distances have no sweep: the dispatcher says so, and rapier lets them go.
        DefaultQueryDispatcher.cast_shapes_nonlinear(
            motion1,
            untagged(g1),
            motion2,
            untagged(g2),
            start_time,
            end_time,
            stop_at_penetration,
        )
    }
}

impl PointQuery for Tagged {
    fn project_local_point(&self, x: Vector, solid: bool) -> PointProjection {
        self.shape.project_local_point(x, solid)
    }

    fn project_local_point_and_get_feature(&self, x: Vector) -> (PointProjection, FeatureId) {
        self.shape.project_local_point_and_get_feature(x)
    }
}

impl RayCast for Tagged {
    fn cast_local_ray_and_get_normal(
        &self,
        ray: &Ray,
        farthest: Real,
        solid: bool,
    ) -> Option<RayIntersection> {
        self.shape
            .cast_local_ray_and_get_normal(ray, farthest, solid)
    }
}

impl Shape for Tagged {
    fn compute_local_aabb(&self) -> Aabb {
        self.shape.compute_local_aabb()
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.shape.compute_local_bounding_sphere()
    }

    fn compute_aabb(&self, position: &Pose) -> Aabb {
        self.shape.compute_aabb(position)
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, _: Vector, _: u32) -> Option<Box<dyn Shape>> {
        None
    }

    fn mass_properties(&self, density: Real) -> MassProperties {
        self.shape.mass_properties(density)
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Custom(self)
    }

    fn ccd_thickness(&self) -> Real {
        self.shape.ccd_thickness()
    }

    fn ccd_angular_thickness(&self) -> Real {
        self.shape.ccd_angular_thickness()
    }
}
