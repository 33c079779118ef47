//! What never changes of a body: mass, inertia, the distance from its surface, points of the surface.

use super::{
    ball::Ball,
    body::{Body, Inertia},
    cylinder::{Cylinder, upright},
    field::Field,
    grain::Grain,
    points::{Cluster, cluster, of_cuboid},
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
    /// Points of the surface, cluster after cluster; a ball needs none, a cylinder has more that move (`rims`).
    pub(super) points: Vec<Vec3>,
    pub(super) clusters: Vec<Cluster>,
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
    Field(Box<Field>),
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
        let (form, points) = if let Some(ball) = Ball::of_particles(&local, &volumes) {
            (Form::Ball(ball), vec![])
        } else if let Some(half) = cuboid(&local, &volumes) {
            (Form::Cuboid(half), of_cuboid(half, spacing))
        } else if let Some(cylinder) = Cylinder::of(&local, &volumes) {
            (Form::Cylinder(cylinder), cylinder.points(spacing))
        } else {
            let surface = Surface::of(&local, &volumes);
            match Ball::of_surface(&surface.triangles, &local, &volumes) {
                Some(ball) => (Form::Ball(ball), vec![]),
                None => {
                    let (field, points) = Field::new(surface);
                    (Form::Field(Box::new(field)), points)
                }
            }
        };
        let (points, clusters) = cluster(&points, spacing);
        let farthest = points.iter().map(|x| length(*x)).fold(0.0, f64::max);
        let (radius, depth) = match &form {
            Form::Ball(ball) => (ball.reach(), ball.depth()),
            Form::Cuboid(half) => (farthest, half.iter().copied().fold(f64::INFINITY, f64::min)),
            Form::Cylinder(Cylinder { radius, half, .. }) => {
                (radius.hypot(*half), radius.min(*half))
            }
            Form::Field(field) => (farthest, field.depth()),
        };
        Self {
            inertia,
            radius,
            depth,
            form,
            points,
            clusters,
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
            Form::Field(field) => field.distance(x),
        }
    }

    /// Outward unit normal at a point of the body's frame.
    pub fn normal(&self, x: Vec3) -> Vec3 {
        match &self.form {
            Form::Ball(ball) => ball.normal(x),
            Form::Cuboid(half) => box_distance(*half, x).normal,
            Form::Cylinder(cylinder) => cylinder.distance(x).normal,
            Form::Field(field) => field.normal(x),
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
