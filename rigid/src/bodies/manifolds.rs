//! Manifolds of two shapes: those of parry, merged where they are of one plane, and our own of fields of distances.

use rapier3d_f64::parry::{
    bounding_volume::BoundingVolume,
    math::{Pose, Vector},
    query::{
        DefaultQueryDispatcher, PersistentQueryDispatcher, TrackedContact,
        details::NormalConstraints,
    },
    shape::{Shape, TriMesh, TypedShape},
};

use super::{
    by_points::{Manifold, by_points},
    sampled::Sampled,
};

/// Least cosine of the angle between normals of what is one plane.
const PLANE: f64 = 0.996;
/// Sine of the angle between an axis and a normal below which it is that of a lid.
const FLAT: f64 = 1e-3;
/// Part of the prediction within which two points are one.
const SAME: f64 = 0.25;

/// All manifolds of two shapes, the second `pos12` in the frame of the first, with points that are less than `prediction` [m] apart.
pub(super) fn manifolds(
    pos12: &Pose,
    g1: &dyn Shape,
    g2: &dyn Shape,
    prediction: f64,
) -> Vec<Manifold> {
    if g1.as_shape::<Sampled>().is_some() || g2.as_shape::<Sampled>().is_some() {
        return by_points(pos12, g1, g2, prediction);
    }
    if let Some(mesh) = g1.as_trimesh() {
        return of_mesh(pos12, mesh, g2, prediction);
    }
    if let Some(mesh) = g2.as_trimesh() {
        let mut found = of_mesh(&pos12.inverse(), mesh, g1, prediction);
        found.iter_mut().for_each(flip);
        return found;
    }
    let mut one = Manifold::new();
    let found = DefaultQueryDispatcher
        .contact_manifold_convex_convex(pos12, g1, g2, None, None, prediction, &mut one);
    // Two half-spaces do not meet as bodies.
    if found.is_err() || one.points.is_empty() {
        return vec![];
    }
    // Of a lid parry knows a square.
    let round = [(g1, one.local_n1), (g2, one.local_n2)];
    if round
        .iter()
        .any(|(shape, normal)| lies_on_lid(*shape, *normal))
    {
        return by_points(pos12, g1, g2, prediction);
    }
    vec![one]
}

/// Whether a normal is that of a lid.
pub(super) fn lies_on_lid(shape: &dyn Shape, normal: Vector) -> bool {
    let is_round = matches!(
        shape.as_typed_shape(),
        TypedShape::Cylinder(_) | TypedShape::RoundCylinder(_)
    );
    is_round && normal.x.hypot(normal.z) < FLAT
}

fn flip(manifold: &mut Manifold) {
    std::mem::swap(&mut manifold.local_n1, &mut manifold.local_n2);
    for point in &mut manifold.points {
        std::mem::swap(&mut point.local_p1, &mut point.local_p2);
    }
}

/// Of a mesh and a convex shape: what its triangles say, once for each plane.
fn of_mesh(pos12: &Pose, mesh: &TriMesh, g2: &dyn Shape, prediction: f64) -> Vec<Manifold> {
    let around = g2.compute_aabb(pos12).loosened(prediction);
    let mut numbers: Vec<u32> = mesh.bvh().intersect_aabb(&around).collect();
    numbers.sort_unstable();
    let mut found: Vec<Manifold> = vec![];
    for n in numbers {
        let triangle = mesh.triangle(n);
        let normals = mesh.triangle_normal_constraints(n);
        let normals = normals
            .as_ref()
            .map(|normals| normals as &dyn NormalConstraints);
        let mut one = Manifold::new();
        let is_known = DefaultQueryDispatcher.contact_manifold_convex_convex(
            pos12, &triangle, g2, normals, None, prediction, &mut one,
        );
        if is_known.is_err() || one.points.is_empty() {
            continue;
        }
        match found
            .iter_mut()
            .find(|known| known.local_n1.dot(one.local_n1) > PLANE)
        {
            Some(plane) => one
                .points
                .iter()
                .for_each(|point| add(plane, point, prediction)),
            None => found.push(one),
        }
    }
    found
}

/// Adds a point to a plane; of two that are the same the deeper one stays.
fn add(plane: &mut Manifold, point: &TrackedContact<()>, prediction: f64) {
    let same = SAME * prediction;
    let is_same = |known: &&mut TrackedContact<()>| gone(known.local_p1, point.local_p1) < same;
    match plane.points.iter_mut().find(is_same) {
        Some(known) if point.dist < known.dist => *known = *point,
        Some(_) => {}
        None => plane.points.push(*point),
    }
}

fn gone(a: Vector, b: Vector) -> f64 {
    (a - b).length()
}
