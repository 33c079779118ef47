//! What never changes of a body: mass, inertia, the distance from its surface, points of the surface.

use std::sync::Arc;

use rapier3d_f64::parry::{
    math::{Pose, Rotation, Vector},
    shape::SharedShape,
};

use super::{
    ball::Ball,
    body::{Body, Inertia},
    cylinder::{Cylinder, upright},
    field::Field,
    grain::Grain,
    points::cluster,
    sampled::{Sampled, Source},
    surface::Surface,
    vector::{Vec3, add, along, length, scaled, solve, sub},
};
use crate::{
    colliders::primitives::box_distance,
    mat3::Mat3,
    rotation::{conjugate, product, quaternion, rotate},
};

/// Largest relative difference between the volume of a cuboid and what its moments say about it.
const FILLED: f64 = 0.015;
/// Radius by which edges of bodies are rounded [m], and the most of it in parts of the least half length: what edges meet has a normal then
/// that does not jump.
const ROUNDING: f64 = 5e-4;
const MOST_ROUNDING: f64 = 0.05;
/// Difference of two second moments, in units of their sum, up to which their axes mean nothing.
const ALIKE: f64 = 5e-3;

/// Mass, inertia and surface of a body, in its own frame.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Mass and moments of inertia.
    pub inertia: Inertia,
    /// Radius of the ball about the centre of mass that holds it [m].
    pub radius: f64,
    /// Depth of the point that is deepest inside [m].
    pub depth: f64,
    pub(super) form: Form,
    /// The same as contact knows it, and where it is in the frame.
    pub(super) contact: (SharedShape, Pose),
}

/// Where the surface is.
#[derive(Clone, Debug)]
pub(super) enum Form {
    /// By its spheres.
    Ball(Ball),
    /// Along the axes of the frame, by half its edges.
    Cuboid(Vec3),
    /// Along an axis of the frame.
    Cylinder(Cylinder),
    Field(Arc<Sampled>),
}

/// Edges rounded by a part of the least half length [m].
fn rounding(least: f64) -> f64 {
    ROUNDING.min(MOST_ROUNDING * least)
}

impl Form {
    /// The shape that contact knows, and where it is in the frame.
    fn contact(&self) -> (SharedShape, Pose) {
        match self {
            Self::Ball(ball) if ball.cavity.is_some() => {
                let sampled = Sampled::new(Source::Hollow(*ball), vec![], vec![]);
                (SharedShape(Arc::new(sampled)), Pose::IDENTITY)
            }
            Self::Ball(ball) => {
                let at = Pose::from_parts(ball.outer.center.into(), Rotation::IDENTITY);
                (SharedShape::ball(ball.outer.radius), at)
            }
            Self::Cuboid(half) => {
                let round = rounding(half.iter().copied().fold(f64::INFINITY, f64::min));
                let [x, y, z] = half.map(|h| h - round);
                (SharedShape::round_cuboid(x, y, z, round), Pose::IDENTITY)
            }
            Self::Cylinder(Cylinder { axis, radius, half }) => {
                let round = rounding(radius.min(*half));
                let mut along = Vector::ZERO;
                along[*axis] = 1.0;
                let turn = Rotation::from_rotation_arc(Vector::Y, along);
                let shape = SharedShape::round_cylinder(half - round, radius - round, round);
                (shape, Pose::from_parts(Vector::ZERO, turn))
            }
            Self::Field(sampled) => (SharedShape(sampled.clone()), Pose::IDENTITY),
        }
    }
}

/// A body at rest where these particles are: its origin is their centre of mass, its axes those of inertia; where an
/// axis is as good as another, that of `attitude`. None where there is no mass.
pub fn frame(grains: &[Grain], attitude: [f64; 4]) -> Option<Body> {
    let mass: f64 = grains.iter().map(|g| g.mass).sum();
    if mass.is_nan() || mass <= 0.0 {
        return None;
    }
    let mut com = [0.0; 3];
    for g in grains {
        com = along(com, g.mass / mass, sub(g.x, grains[0].x));
    }
    let com = add(grains[0].x, com);
    let mut second = [[0.0; 3]; 3];
    for g in grains {
        let r = rotate(conjugate(attitude), sub(g.x, com));
        for a in 0..3 {
            for b in 0..3 {
                second[a][b] += g.mass * r[a] * r[b];
            }
        }
    }
    let size = second[0][0] + second[1][1] + second[2][2];
    let second = Mat3(second);
    let mut axes = principal_axes(second, size);
    if [(0, 1), (0, 2), (1, 2)].map(|(p, q)| apart(&second, p, q) < ALIKE * size) == [true; 3] {
        let inside = |g: &Grain| Grain {
            x: rotate(conjugate(attitude), sub(g.x, com)),
            ..*g
        };
        let grains: Vec<Grain> = grains.iter().map(inside).collect();
        axes = upright(&grains).unwrap_or(axes);
    }
    Some(Body {
        com,
        rotation: product(attitude, quaternion(&axes)),
        velocity: [0.0; 3],
        angular_momentum: [0.0; 3],
    })
}

impl Shape {
    /// Of particles in the body's [`frame`]. Its inertia is `sum m (|r|^2 1 - r r^T)` and `own` per mass [m^2]: that of
    /// the cubes that particles stand for, or `2 D_p = dx^2 / 2` for the affine part of APIC.
    pub fn new(grains: &[Grain], own: f64) -> Self {
        let inertia = Self::inertia(grains, own);
        let local: Vec<Vec3> = grains.iter().map(|g| g.x).collect();
        let volumes: Vec<f64> = grains.iter().map(|g| g.volume).collect();
        let spacing = (volumes.iter().sum::<f64>() / volumes.len() as f64).cbrt();
        let form = if let Some(ball) = Ball::of_particles(&local, &volumes) {
            Form::Ball(ball)
        } else if let Some(half) = cuboid(&local, &volumes) {
            Form::Cuboid(half)
        } else if let Some(cylinder) = Cylinder::of(&local, &volumes) {
            Form::Cylinder(cylinder)
        } else {
            let surface = Surface::of(&local, &volumes);
            match Ball::of_surface(&surface.triangles, &local, &volumes) {
                Some(ball) => Form::Ball(ball),
                None => {
                    let (field, points) = Field::new(surface);
                    let (points, clusters) = cluster(&points, spacing);
                    let sampled = Sampled::new(Source::Field(field), points, clusters);
                    Form::Field(Arc::new(sampled))
                }
            }
        };
        let (radius, depth) = match &form {
            Form::Ball(ball) => (ball.reach(), ball.depth()),
            Form::Cuboid(half) => (
                length(*half),
                half.iter().copied().fold(f64::INFINITY, f64::min),
            ),
            Form::Cylinder(Cylinder { radius, half, .. }) => {
                (radius.hypot(*half), radius.min(*half))
            }
            Form::Field(sampled) => (sampled.reach(), sampled.depth()),
        };
        Self {
            inertia,
            radius,
            depth,
            contact: form.contact(),
            form,
        }
    }

    /// Mass and moments of particles in the body's frame.
    pub fn inertia(grains: &[Grain], own: f64) -> Inertia {
        let (mut mass, mut square) = (0.0, [0.0; 3]);
        for g in grains {
            mass += g.mass;
            for a in 0..3 {
                square[a] += g.mass * g.x[a] * g.x[a];
            }
        }
        let trace = square[0] + square[1] + square[2] + own * mass;
        Inertia {
            mass,
            moments: square.map(|s| trace - s),
        }
    }

    /// Angular velocity [rad/s] at which particles in the body's frame carry an angular momentum [kg m^2/s]; `own` as in
    /// [`Shape::new`]. Unlike the moments it knows the products of inertia that [`frame`] leaves between axes that are
    /// as good as each other.
    pub fn spin(grains: &[Grain], own: f64, momentum: Vec3) -> Vec3 {
        let Inertia { mass, moments } = Self::inertia(grains, own);
        if mass.is_nan() || mass <= 0.0 {
            return [0.0; 3];
        }
        let mut inertia = Mat3::diagonal(moments);
        for g in grains {
            for (a, b) in [(0, 1), (0, 2), (1, 2)] {
                inertia.0[a][b] -= g.mass * g.x[a] * g.x[b];
                inertia.0[b][a] = inertia.0[a][b];
            }
        }
        solve(&inertia, momentum)
    }

    /// Signed distance of a point of the body's frame [m].
    pub fn distance(&self, x: Vec3) -> f64 {
        match &self.form {
            Form::Ball(ball) => ball.distance(x),
            Form::Cuboid(half) => box_distance(*half, x).value,
            Form::Cylinder(cylinder) => cylinder.distance(x).value,
            Form::Field(sampled) => sampled.distance(x),
        }
    }

    /// Outward unit normal at a point of the body's frame.
    pub fn normal(&self, x: Vec3) -> Vec3 {
        match &self.form {
            Form::Ball(ball) => ball.normal(x),
            Form::Cuboid(half) => box_distance(*half, x).normal,
            Form::Cylinder(cylinder) => cylinder.distance(x).normal,
            Form::Field(sampled) => sampled.normal(x),
        }
    }
}

/// Half the edges, where volume, second moments and extent are those of a cuboid along the axes: then it has edges and
/// flat faces.
fn cuboid(points: &[Vec3], volumes: &[f64]) -> Option<Vec3> {
    let volume: f64 = volumes.iter().sum();
    let (mut square, mut farthest) = ([0.0; 3], [0.0_f64; 3]);
    for (x, v) in points.iter().zip(volumes) {
        for a in 0..3 {
            square[a] += v * (x[a] * x[a] + v.cbrt().powi(2) / 12.0) / volume;
            farthest[a] = farthest[a].max(x[a].abs());
        }
    }
    let half = square.map(|s| (3.0 * s).sqrt());
    let spacing = (volume / points.len() as f64).cbrt();
    let fits = (0..3).all(|a| (half[a] - farthest[a] - 0.5 * spacing).abs() < 0.3 * spacing);
    let filled = volume / (8.0 * half[0] * half[1] * half[2]);
    // To the volume, which is exact.
    let scale = filled.cbrt();
    (fits && (filled - 1.0).abs() < FILLED).then(|| half.map(|x| scale * x))
}

/// Difference of the two eigenvalues of a symmetric matrix between two axes alone.
fn apart(m: &Mat3<f64>, p: usize, q: usize) -> f64 {
    (m.0[q][q] - m.0[p][p]).hypot(2.0 * m.0[p][q])
}

/// Eigenvectors of a symmetric matrix of this size as columns, right-handed (Jacobi); where two eigenvalues are as good
/// as equal, those of the identity.
fn principal_axes(mut m: Mat3<f64>, size: f64) -> Mat3<f64> {
    let mut axes = Mat3::identity();
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = m.0[p][q];
            if off.abs() <= 1e-15 * size || apart(&m, p, q) < ALIKE * size {
                continue;
            }
            let angle = 0.5 * (2.0 * off).atan2(m.0[q][q] - m.0[p][p]);
            let (s, c) = angle.sin_cos();
            let mut turn = Mat3::identity();
            (turn.0[p][p], turn.0[p][q]) = (c, s);
            (turn.0[q][p], turn.0[q][q]) = (-s, c);
            m = turn.transpose().mul(&m).mul(&turn);
            axes = axes.mul(&turn);
        }
    }
    if axes.det() < 0.0 {
        let last = scaled(axes.column(2), -1.0);
        return Mat3::from_columns(axes.column(0), axes.column(1), last);
    }
    axes
}
