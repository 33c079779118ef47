//! What sticks out of shapes that are known exactly, or stands for all of them: points to be looked at in the distance of another.

use rapier3d_f64::parry::{
    bounding_volume::{Aabb, BoundingVolume},
    shape::{Shape, TriMesh, TypedShape},
};

use super::vector::{Vec3, along, length, sub};

/// Points of one edge at most.
const MOST_OF_EDGE: f64 = 4096.0;
/// Points of a rim at least.
const AROUND: f64 = 24.0;

/// A point that stands for a part of a surface, or the middle of a ball that does.
pub(super) struct Probe {
    pub x: Vec3,
    pub radius: f64,
    /// Outward normal, where there is one.
    pub normal: Option<Vec3>,
}

/// Points of the segment between two places that are in a box, about `spacing` apart.
fn of_edge([from, to]: [Vec3; 2], within: &Aabb, spacing: f64, radius: f64, into: &mut Vec<Probe>) {
    let way = sub(to, from);
    let size = length(way);
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for a in 0..3 {
        let (low, high) = (within.mins[a] - from[a], within.maxs[a] - from[a]);
        if way[a] == 0.0 {
            if low > 0.0 || high < 0.0 {
                return;
            }
            continue;
        }
        let (p, q) = (low / way[a], high / way[a]);
        (first, last) = (first.max(p.min(q)), last.min(p.max(q)));
    }
    if first > last || size == 0.0 {
        return;
    }
    // At places of the edge, wherever the box is.
    let count = (size / spacing).ceil().clamp(1.0, MOST_OF_EDGE);
    let (low, high) = ((first * count).floor() as u32, (last * count).ceil() as u32);
    into.extend((low..=high).map(|n| Probe {
        x: along(from, f64::from(n) / count, way),
        radius,
        normal: None,
    }));
}

/// Corners and edges of a box.
fn of_box(half: Vec3, within: &Aabb, spacing: f64, into: &mut Vec<Probe>) {
    let side = |n: u32, axis: u32| if n >> axis & 1 == 0 { -1.0 } else { 1.0 };
    let corner = |n: u32| [0, 1, 2].map(|a| side(n, a as u32) * half[a]);
    for axis in 0..3 {
        for n in (0..8).filter(|n| n >> axis & 1 == 0) {
            of_edge(
                [corner(n), corner(n | 1 << axis)],
                within,
                spacing,
                0.0,
                into,
            );
        }
    }
}

/// Rims, middles of lids and axis of a cylinder along y.
fn of_cylinder(radius: f64, half: f64, within: &Aabb, spacing: f64, into: &mut Vec<Probe>) {
    let count = (std::f64::consts::TAU * radius / spacing)
        .ceil()
        .clamp(AROUND, MOST_OF_EDGE);
    for y in [-half, half] {
        let middle = [0.0, y, 0.0];
        if within.contains_local_point(middle.into()) {
            into.push(Probe {
                x: middle,
                radius: 0.0,
                normal: None,
            });
        }
        for n in 0..count as u32 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(n) / count).sin_cos();
            let x = [radius * cos, y, radius * sin];
            if within.contains_local_point(x.into()) {
                into.push(Probe {
                    x,
                    radius: 0.0,
                    normal: None,
                });
            }
        }
    }
    // What is round about the axis ends with it.
    if half > radius {
        of_axis(radius, half - radius, within, spacing, into);
    }
}

/// The axis of what is round about it and at its ends, unless that is so thick that points of the other meet it: a field is known near its
/// surface.
fn of_axis(radius: f64, half: f64, within: &Aabb, spacing: f64, into: &mut Vec<Probe>) {
    if radius <= 2.0 * spacing {
        let ends = [[0.0, -half, 0.0], [0.0, half, 0.0]];
        of_edge(ends, &within.loosened(radius), spacing, radius, into);
    }
}

fn of_mesh(mesh: &TriMesh, within: &Aabb, spacing: f64, into: &mut Vec<Probe>) {
    let mut numbers: Vec<u32> = mesh.bvh().intersect_aabb(within).collect();
    numbers.sort_unstable();
    for n in numbers {
        let corners = [mesh.triangle(n).a, mesh.triangle(n).b, mesh.triangle(n).c];
        let [a, b, c] = corners.map(Vec3::from);
        for edge in [[a, b], [b, c], [c, a]] {
            of_edge(edge, within, spacing, 0.0, into);
        }
    }
}

/// What of a shape sticks out between points that are `spacing` apart, or stands for all of it, within a box of its frame.
pub(super) fn probes(shape: &dyn Shape, within: &Aabb, spacing: f64) -> Vec<Probe> {
    let mut found = vec![];
    match shape.as_typed_shape() {
        TypedShape::Cuboid(cuboid) => {
            of_box(cuboid.half_extents.into(), within, spacing, &mut found);
        }
        TypedShape::RoundCuboid(round) => {
            let half: Vec3 = round.inner_shape.half_extents.into();
            of_box(
                half.map(|h| h + round.border_radius),
                within,
                spacing,
                &mut found,
            );
        }
        TypedShape::Cylinder(inner) => {
            of_cylinder(inner.radius, inner.half_height, within, spacing, &mut found);
        }
        TypedShape::RoundCylinder(round) => {
            let (inner, border) = (&round.inner_shape, round.border_radius);
            let (radius, half) = (inner.radius + border, inner.half_height + border);
            of_cylinder(radius, half, within, spacing, &mut found);
        }
        TypedShape::Capsule(capsule) => {
            of_axis(
                capsule.radius,
                capsule.half_height(),
                within,
                spacing,
                &mut found,
            );
        }
        TypedShape::Ball(ball) => found.push(Probe {
            x: [0.0; 3],
            radius: ball.radius,
            normal: None,
        }),
        TypedShape::TriMesh(mesh) => of_mesh(mesh, within, spacing, &mut found),
        _ => {}
    }
    found
}
