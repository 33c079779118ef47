//! Triangle meshes as colliders: distance and ray queries through parry's bounding volume hierarchy.

use std::{collections::BTreeMap, sync::Arc};

use parry3d_f64::{
    math::Vector,
    query::{PointQuery, Ray, RayCast},
    shape::{TriMesh, TriMeshFlags},
};

use super::primitives::Distance;
use crate::scene::TriangleMesh;

/// Triangles with a search tree.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// None when there is no triangle that could be hit.
    surface: Option<Arc<TriMesh>>,
    /// Whether it has an inside.
    closed: bool,
    /// See [`Mesh::loose_edges`].
    loose: usize,
    radius: f64,
    thickness: f64,
}

fn vector([x, y, z]: [f64; 3]) -> Vector {
    Vector::new(x, y, z)
}

fn array(v: Vector) -> [f64; 3] {
    [v.x, v.y, v.z]
}

impl Mesh {
    /// The mesh with lengths in units of `unit` metres.
    pub fn new(mesh: &TriangleMesh, unit: f64) -> Self {
        let points: Vec<Vector> = mesh
            .points
            .iter()
            .map(|p| vector(p.map(|x| x / unit)))
            .collect();
        let radius = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        let welded =
            TriMeshFlags::MERGE_DUPLICATE_VERTICES | TriMeshFlags::DELETE_DEGENERATE_TRIANGLES;
        let triangles = mesh.triangles.clone();
        let open = TriMesh::with_flags(points, triangles, welded).ok();
        let loose = open.as_ref().map_or(0, |open| loose_edges(open.indices()));
        let solid = open
            .as_ref()
            .filter(|open| loose == 0 && open.num_triangles() > 0)
            .and_then(|open| {
                let (points, triangles) = (open.vertices().to_vec(), open.indices().to_vec());
                let flags = TriMeshFlags::ORIENTED | TriMeshFlags::FIX_INTERNAL_EDGES;
                TriMesh::with_flags(points, triangles, flags).ok()
            });
        let closed = solid.is_some();
        let mut mesh = Self {
            surface: solid
                .or(open)
                .filter(|surface| surface.num_triangles() > 0)
                .map(Arc::new),
            closed,
            loose,
            radius,
            thickness: 0.0,
        };
        if closed {
            mesh.thickness = mesh.measure_thickness();
        }
        mesh
    }

    /// Shortest way straight through, from the middle of every triangle.
    fn measure_thickness(&self) -> f64 {
        let Some(surface) = &self.surface else {
            return 0.0;
        };
        let mut thickness = f64::INFINITY;
        for triangle in surface.triangles() {
            let Some(normal) = triangle.normal() else {
                continue;
            };
            let start = triangle.center() - normal * (1e-9 * self.radius);
            let ray = Ray::new(start, -normal);
            if let Some(hit) = surface.cast_local_ray(&ray, f64::MAX, false) {
                thickness = thickness.min(hit);
            }
        }
        thickness
    }

    /// Signed distance for a closed mesh, distance from the surface for an open one; far away from no mesh.
    pub fn distance(&self, x: [f64; 3]) -> Distance {
        let far = Distance {
            value: f64::INFINITY,
            normal: [0.0, 1.0, 0.0],
        };
        let Some(surface) = &self.surface else {
            return far;
        };
        signed_distance(surface, x)
    }

    /// Where the segment from `from` to `to` first crosses the surface: part of the way, and the normal of the
    /// crossed triangle on the side of `from`.
    pub fn crossing(&self, from: [f64; 3], to: [f64; 3]) -> Option<(f64, [f64; 3])> {
        let (from, to) = (vector(from), vector(to));
        let ray = Ray::new(from, to - from);
        let surface = self.surface.as_ref()?;
        let hit = surface.cast_local_ray_and_get_normal(&ray, 1.0, false)?;
        let normal = hit.normal;
        let facing = if normal.dot(ray.dir) > 0.0 { -1.0 } else { 1.0 };
        Some((hit.time_of_impact, array(normal * facing)))
    }

    /// Its triangles, where it has any.
    pub fn surface(&self) -> Option<&Arc<TriMesh>> {
        self.surface.as_ref()
    }

    /// Radius of a ball about the origin that holds it.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Whether it has an inside.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Directed edges that no triangle on the other side meets.
    pub fn loose_edges(&self) -> usize {
        self.loose
    }

    /// Smallest thickness, 0 for an open mesh.
    pub fn thickness(&self) -> f64 {
        self.thickness
    }
}

/// Signed distance from triangles that enclose something, distance from others.
pub fn signed_distance(surface: &TriMesh, x: [f64; 3]) -> Distance {
    let projection = surface.project_local_point(vector(x), false);
    let away = vector(x) - projection.point;
    let length = away.length();
    let is_closed = surface.flags().contains(TriMeshFlags::ORIENTED);
    let sign = match is_closed && projection.is_inside {
        true => -1.0,
        false => 1.0,
    };
    let normal = match length > 1e-12 * surface.local_aabb().half_extents().length() {
        true => away * (sign / length),
        false => {
            let on = surface.triangle(projection.subshape);
            on.normal().unwrap_or(Vector::Y)
        }
    };
    Distance {
        value: sign * length,
        normal: array(normal),
    }
}

/// Directed edges that do not belong to exactly two triangles, once in each direction.
fn loose_edges(triangles: &[[u32; 3]]) -> usize {
    let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for t in triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *edges.entry([a, b]).or_default() += 1;
        }
    }
    let met =
        |([a, b], count): &(&[u32; 2], &i32)| **count == 1 && edges.get(&[*b, *a]) == Some(&1);
    edges.iter().filter(|edge| !met(edge)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::box_mesh;

    #[test]
    fn a_segment_finds_the_first_crossing_from_either_side() {
        let mesh = Mesh::new(&box_mesh([1.0; 3]), 1.0);
        let (t, normal) = mesh
            .crossing([0.2, 3.0, 0.1], [0.2, -1.0, 0.1])
            .expect("crosses the top");
        assert!((t - 0.5).abs() < 1e-12);
        assert_eq!(normal, [0.0, 1.0, 0.0]);
        let (t, normal) = mesh
            .crossing([0.2, 0.0, 0.1], [0.2, 2.0, 0.1])
            .expect("leaves through the top");
        assert!((t - 0.5).abs() < 1e-12);
        assert_eq!(normal, [0.0, -1.0, 0.0]);
        assert!(mesh.crossing([0.2, 3.0, 0.1], [0.2, 1.1, 0.1]).is_none());
    }

    #[test]
    fn a_mesh_without_triangles_stops_nothing() {
        let mesh = Mesh::new(&TriangleMesh::default(), 1.0);
        assert_eq!(mesh.distance([0.0; 3]).value, f64::INFINITY);
        assert!(mesh.crossing([0.0; 3], [1.0; 3]).is_none());
    }
}
