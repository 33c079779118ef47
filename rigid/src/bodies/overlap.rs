//! Bodies that overlap: which points of their surfaces say where to go, and where to go when none does.
//!
//! Inside a body the nearest of its faces need not be the one that another came in by: points of two faces that lie
//! on each other, both looking the same way, would clamp the pair from both sides, and friction would hold it.

use super::{
    actor::TOUCH,
    feature::{Feature, Solid, Spot, place},
    shape::Form,
    vector::{Vec3, add, along, length, scaled, sub, unit},
};
use crate::{mat3::dot, rotation::rotate};

/// Depth from which on only points count whose surfaces face each other [cells]: twice what bodies at rest may overlap by.
const DEEP: f64 = 4e-3;
/// Least component of a point's outward normal against that of the other body: more than round-off has, less than an
/// edge or a smoothed corner that meets a face.
pub(super) const FACING: f64 = 0.3;
/// Share of the surfaces that lie inside of each other below which what they look to cancels.
const CANCELS: f64 = 0.1;

/// Of two bodies that overlap, leaves the spots where surfaces face each other; where there is none, the one that
/// stands for all, if the two overlap at all. `near` are features with their gaps, `dx` is the cell size [m].
pub(super) fn only_facing(
    a: &Solid<'_>,
    b: &Solid<'_>,
    near: &[(Feature, f64)],
    spots: &mut Vec<Spot>,
    dx: f64,
) {
    let (Solid::Body(..), Solid::Body(..)) = (a, b) else {
        return;
    };
    if near.iter().all(|(_, gap)| *gap >= -DEEP * dx) {
        return;
    }
    spots.retain(|spot| {
        let (of, against) = match spot.feature.second {
            true => (b, spot.normal),
            false => (a, scaled(spot.normal, -1.0)),
        };
        of.looks(spot, against) > FACING
    });
    if spots.is_empty() {
        spots.extend(way_out(a, b, near, dx));
    }
}

/// Where two bodies press on each other as wholes: the normal is the direction in which the first loses most of the
/// overlap, by the parts of both surfaces that lie inside of the other.
fn way_out(a: &Solid<'_>, b: &Solid<'_>, near: &[(Feature, f64)], dx: f64) -> Option<Spot> {
    let (mut normal, mut middle, mut count) = ([0.0; 3], [0.0; 3], 0.0);
    let mut deepest: Option<(Feature, f64)> = None;
    for &(feature, gap) in near.iter().filter(|(_, gap)| *gap < -TOUCH * dx) {
        let (of, sign) = match feature.second {
            true => (b, 1.0),
            false => (a, -1.0),
        };
        // Points that move stand for no part of a surface.
        if of.computed(feature.point).is_some() {
            continue;
        }
        normal = along(normal, sign, of.outward(feature.point));
        middle = add(middle, place(of, feature.point));
        count += 1.0;
        if deepest.is_none_or(|(_, most)| gap < most) {
            deepest = Some((feature, gap));
        }
    }
    let (feature, gap) = deepest?;
    if length(normal) < CANCELS * count {
        // One is inside of the other.
        normal = sub(a.center(), b.center());
    }
    let normal = unit(normal, [0.0; 3]);
    (normal != [0.0; 3]).then(|| Spot {
        feature,
        x: scaled(middle, 1.0 / count),
        normal,
        gap,
    })
}

impl Solid<'_> {
    /// How much a point of its surface looks in a direction: the largest component of the outward normals there.
    pub fn looks(&self, spot: &Spot, direction: Vec3) -> f64 {
        let n = spot.feature.point;
        let Self::Body(shape, body) = self else {
            return 1.0;
        };
        if let Some(k) = self.computed(n) {
            return self.computed_looks(k, spot.x, direction);
        }
        match &shape.form {
            Form::Ball(_) => 1.0,
            Form::Cuboid(_) => {
                // On an edge or a corner, all directions between the normals of its faces.
                let normals = self.faces(n).into_iter().flatten();
                let parts = normals.map(|normal| dot(normal, direction).max(0.0).powi(2));
                parts.sum::<f64>().sqrt()
            }
            Form::Cylinder(cylinder) => {
                let normals = cylinder.normals(shape.points[n as usize]);
                let normals = normals.into_iter().flatten();
                let parts = normals.map(|normal| {
                    dot(rotate(body.rotation, normal), direction)
                        .max(0.0)
                        .powi(2)
                });
                parts.sum::<f64>().sqrt()
            }
            Form::Field(_) => {
                let normal = shape.normal(shape.points[n as usize]);
                dot(rotate(body.rotation, normal), direction)
            }
        }
    }

    /// Outward normal at a point of its surface, times the part of it that the point stands for.
    fn outward(&self, n: u32) -> Vec3 {
        let Self::Body(shape, body) = self else {
            return [0.0; 3];
        };
        match &shape.form {
            Form::Ball(_) => [0.0; 3],
            Form::Cuboid(_) => {
                let normals = self.faces(n);
                // Points of an edge stand for half as much of each of two faces, those of corners for a quarter of three.
                let faces = normals.iter().flatten().count() as i32;
                let share = 0.5_f64.powi(faces - 1);
                let sum = |sum, normal: &Vec3| along(sum, share, *normal);
                normals.iter().flatten().fold([0.0; 3], sum)
            }
            Form::Cylinder(cylinder) => {
                let normals = cylinder.normals(shape.points[n as usize]);
                // Points of a rim stand for half as much of the lid and of the side.
                let share = if normals.iter().all(Option::is_some) {
                    0.5
                } else {
                    1.0
                };
                let sum = |sum, normal: &Vec3| along(sum, share, *normal);
                let sum = normals.iter().flatten().fold([0.0; 3], sum);
                rotate(body.rotation, sum)
            }
            Form::Field(_) => {
                let normal = shape.normal(shape.points[n as usize]);
                rotate(body.rotation, normal)
            }
        }
    }

    /// Outward normals of the faces of a cuboid that one of its points is on.
    fn faces(&self, n: u32) -> [Option<Vec3>; 3] {
        let Self::Body(shape, body) = self else {
            return [None; 3];
        };
        let Form::Cuboid(half) = shape.form else {
            return [None; 3];
        };
        let x = shape.points[n as usize];
        [0, 1, 2].map(|a| {
            // Points are placed at exactly the half edges but for round-off.
            let mut normal = [0.0; 3];
            normal[a] = x[a].signum();
            (x[a].abs() >= (1.0 - 1e-9) * half[a]).then(|| rotate(body.rotation, normal))
        })
    }

    fn center(&self) -> Vec3 {
        match self {
            Self::Body(_, body) => body.com,
            Self::Wall(_) => [0.0; 3],
        }
    }
}
