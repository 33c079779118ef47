//! Bodies that no capture shows: primitive shapes and meshes, with generated Gaussians on their surface.

use std::{collections::HashMap, sync::Arc};

use cosplat_sim_core::{
    distance::SignedDistance,
    scene::{Aabb, ColliderShape, Fidelity, RestParticles, TriangleMesh},
};
use glam::{DQuat, DVec3};

use crate::bounds::bounds_of;

use super::{
    boundaries::placed,
    build::LoadMesh,
    placement::Rigid,
    sampling::{Body, Looks, Numerics},
    select::longest_side,
    solids::Solid,
    spec::{Geometry, ObjectSpec, Shape},
};
use crate::assets::{
    Gaussians,
    generate::{Style, surface_mesh},
};

/// Distance of corners that are meant to be one, in longest sides of the mesh: what files round to.
const WELD: f64 = 1e-6;

/// A surface that generated Gaussians show, in the body's frame.
pub(super) enum Form {
    /// Of a shape, hollow where it has a wall [m].
    Shape { shape: Shape, wall: Option<f64> },
    /// Of a mesh.
    Mesh(Box<MeshForm>),
}

/// A mesh and what it encloses.
pub(super) struct MeshForm {
    mesh: TriangleMesh,
    /// [m^2]
    area: f64,
    /// None of what is only seen.
    solid: Option<Solid>,
}

impl Form {
    /// Surface that is seen [m^2].
    pub fn area(&self) -> f64 {
        match self {
            Self::Shape { shape, .. } => shape.area(),
            Self::Mesh(form) => form.area,
        }
    }

    /// What shows it.
    pub fn gaussians(&self, style: &Style) -> Gaussians {
        match self {
            Self::Shape { shape, .. } => shape.surface(style),
            Self::Mesh(form) => surface_mesh(&form.mesh, style),
        }
    }

    /// Particles at about `spacing` [m], and what is suspicious about them; none where nothing is inside.
    pub fn particles(&self, numerics: &Numerics, spacing: f64) -> (RestParticles, Option<String>) {
        let Numerics { jitter, seed, .. } = *numerics;
        let hollow = match self {
            Self::Shape { shape, wall } => wall.and_then(|wall| shape.hollow(wall)),
            Self::Mesh(_) => None,
        };
        let solid = match self {
            Self::Shape { .. } => hollow.as_ref(),
            Self::Mesh(form) => form.solid.as_ref(),
        };
        match (self, solid) {
            (_, Some(solid)) => {
                let (particles, suspicious) = solid.particles(spacing, jitter, seed);
                (particles, solid.thin(numerics.dx).or(suspicious))
            }
            (Self::Shape { shape, .. }, None) => (shape.particles(spacing, jitter, seed), None),
            (Self::Mesh(_), None) => Default::default(),
        }
    }
}

/// The body of an object that is a shape or a mesh, and its place; none for assets.
///
/// # Errors
/// What is wrong with its size, its wall or its mesh.
pub(super) fn body(
    spec: &ObjectSpec,
    load: &mut LoadMesh,
) -> Result<Option<(Body, Rigid)>, String> {
    let (form, color, spacing) = match &spec.geometry {
        Geometry::Asset { .. } => return Ok(None),
        Geometry::Shape {
            shape,
            wall,
            color,
            gaussian_spacing,
        } => {
            let shape = shape.scaled(spec.placement.factor(&shape.bounds()));
            (of_shape(shape, *wall)?, *color, *gaussian_spacing)
        }
        Geometry::Mesh {
            path,
            wall,
            color,
            gaussian_spacing,
        } => {
            let read = load(path).map_err(|e| e.to_string())?;
            (of_mesh(path, read, *wall, spec)?, *color, *gaussian_spacing)
        }
    };
    let (bounds, up, anchor) = match &form {
        Form::Shape { shape, .. } => {
            let up = spec.placement.up.to_world_up();
            (shape.bounds(), up, anchor_of(spec, &shape.bounds(), up))
        }
        Form::Mesh(form) => (bounds(&form.mesh), DQuat::IDENTITY, DVec3::ZERO),
    };
    let looks = Looks::Surface {
        form,
        color,
        spacing,
    };
    if let Some(message) = looks.refusal() {
        return Err(message);
    }
    let shaped = Rigid {
        rotation: up,
        translation: -anchor,
    };
    let body = Body {
        looks,
        rest: None,
        bounds,
        body_from_asset: up,
    };
    Ok(Some((body, spec.placement.rigid().after(&shaped))))
}

fn of_shape(shape: Shape, wall: Option<f64>) -> Result<Form, String> {
    if let Some(wall) = wall.filter(|wall| shape.shrunk(*wall).is_none()) {
        let Aabb { min, max } = shape.bounds();
        let sides = (0..3).map(|a| max[a] - min[a]);
        let side = sides.fold(f64::INFINITY, f64::min);
        return Err(format!(
            "`wall` is {wall} m, expected less than half of its shortest side, which is {side:.4} m"
        ));
    }
    Ok(Form::Shape { shape, wall })
}

/// Where a shape with these bounds has its anchor once it is upright.
fn anchor_of(spec: &ObjectSpec, bounds: &Aabb, up: DQuat) -> DVec3 {
    let Aabb { min, max } = *bounds;
    let corner = |i: usize| {
        let pick = |a: usize| if i >> a & 1 == 0 { min[a] } else { max[a] };
        (up * DVec3::new(pick(0), pick(1), pick(2))).to_array()
    };
    let turned = bounds_of((0..8).map(corner));
    turned.map_or(DVec3::ZERO, |b| spec.placement.anchor_of(&b))
}

/// The mesh after `up`, `scale` or `height`, and `anchor`, seen from outside.
fn of_mesh(
    path: &str,
    mesh: TriangleMesh,
    wall: Option<f64>,
    spec: &ObjectSpec,
) -> Result<Form, String> {
    let factor = spec.placement.factor(&bounds(&mesh));
    if !(factor.is_finite() && factor > 0.0) {
        return Err("is flat along its up axis: give `scale` instead of `height`".into());
    }
    let mut mesh = welded(placed(mesh, &spec.placement));
    let area = area(&mesh);
    if !(area > 0.0 && area.is_finite()) {
        return Err(format!(
            "{path} has a surface of {area} m^2, expected more than 0"
        ));
    }
    if volume(&mesh).0 < 0.0 {
        mesh = turned_out(mesh);
    }
    let solid = match spec.fidelity {
        Fidelity::Static => None,
        _ => Some(enclosed(path, &mesh, wall)?),
    };
    Ok(Form::Mesh(Box::new(MeshForm { mesh, area, solid })))
}

/// The mesh with corners that differ by round-off made one, and without the triangles that lose their surface by that.
fn welded(mesh: TriangleMesh) -> TriangleMesh {
    let reach = WELD * longest_side(&bounds(&mesh));
    if !(reach > 0.0 && reach.is_finite()) {
        return mesh;
    }
    let mut near: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut weld = |x: &[f64; 3]| {
        let x = DVec3::from(*x);
        let cell = (x / reach).floor().as_i64vec3().to_array();
        let around = |n: i64| {
            [
                cell[0] + n % 3 - 1,
                cell[1] + n / 3 % 3 - 1,
                cell[2] + n / 9 - 1,
            ]
        };
        let candidates = (0..27).filter_map(|n| near.get(&around(n))).flatten();
        let same = |i: &&u32| DVec3::from(points[**i as usize]).distance(x) <= reach;
        let known = candidates.copied().find(|i| same(&i));
        known.unwrap_or_else(|| {
            let next = points.len() as u32;
            near.entry(cell).or_default().push(next);
            points.push(x.to_array());
            next
        })
    };
    let corners: Vec<u32> = mesh.points.iter().map(&mut weld).collect();
    let triangles = mesh
        .triangles
        .iter()
        .map(|t| t.map(|i| corners[i as usize]));
    let keeps = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    TriangleMesh {
        triangles: triangles.filter(keeps).collect(),
        points,
    }
}

/// Triangles seen from the other side.
fn turned_out(mut mesh: TriangleMesh) -> TriangleMesh {
    for triangle in &mut mesh.triangles {
        triangle.swap(1, 2);
    }
    mesh
}

/// What a closed mesh encloses, or its wall.
fn enclosed(path: &str, mesh: &TriangleMesh, wall: Option<f64>) -> Result<Solid, String> {
    let surface = SignedDistance::new(&ColliderShape::Mesh(Arc::new(mesh.clone())));
    if let Some(loose) = surface.loose_edges() {
        return Err(format!(
            "{path} is no closed surface, expected one that has an inside: {} of its edges do not belong to exactly two \
             triangles that are seen from the same side (`fidelity = \"static\"` shows it all the same)",
            loose
        ));
    }
    Ok(Solid {
        surface,
        origin: [0.0; 3],
        bounds: bounds(mesh),
        wall: wall.unwrap_or(f64::INFINITY),
        exact: wall.is_none().then(|| volume(mesh)),
    })
}

fn bounds(mesh: &TriangleMesh) -> Aabb {
    let used = mesh.triangles.iter().flatten();
    let found = bounds_of(used.map(|&i| mesh.points[i as usize]));
    found.unwrap_or(Aabb {
        min: [0.0; 3],
        max: [0.0; 3],
    })
}

fn corners<'m>(mesh: &'m TriangleMesh) -> impl Iterator<Item = [DVec3; 3]> + 'm {
    let corner = |i: u32| DVec3::from(mesh.points[i as usize]);
    mesh.triangles.iter().map(move |t| t.map(corner))
}

/// Surface [m^2].
fn area(mesh: &TriangleMesh) -> f64 {
    corners(mesh)
        .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length())
        .sum()
}

/// Volume [m^3] and centroid [m] inside of a closed mesh, by the divergence theorem; the volume is negative when it is seen
/// from inside.
fn volume(mesh: &TriangleMesh) -> (f64, [f64; 3]) {
    // Tetrahedra to the middle of its box, so that nothing cancels far from the origin.
    let Aabb { min, max } = bounds(mesh);
    let middle = 0.5 * (DVec3::from(min) + DVec3::from(max));
    let (mut volume, mut moment) = (0.0, DVec3::ZERO);
    for corners in corners(mesh) {
        let [a, b, c] = corners.map(|x| x - middle);
        let part = a.dot(b.cross(c)) / 6.0;
        volume += part;
        moment += part * 0.25 * (a + b + c);
    }
    let centroid = if volume == 0.0 {
        middle
    } else {
        middle + moment / volume
    };
    (volume, centroid.to_array())
}
