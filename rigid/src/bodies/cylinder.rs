//! Circular cylinders: how they are recognised, their distance, where their axis is.

use super::{
    grain::Grain,
    vector::{Vec3, along, length, scaled, unit},
};
use crate::{
    colliders::primitives::{Distance, cylinder_distance},
    mat3::{Mat3, cross, dot},
};

/// Particles that a cylinder is made of at least.
const FEWEST: usize = 27;
/// Largest relative difference of its second moments from those that its volume and length give.
const ROUND: f64 = 0.03;
/// How much farther out than the surface its particles may be, and how much farther in the outermost, in spacings:
/// on a lattice along the axis the outermost layer is half a spacing inside, on a turned one about none.
const OUTSIDE: f64 = 0.3;
const INSIDE: f64 = 0.9;

/// A circular cylinder about the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cylinder {
    /// The axis of the frame that is its own.
    pub axis: usize,
    /// [m]
    pub radius: f64,
    /// Half its length [m].
    pub half: f64,
}

impl Cylinder {
    /// The cylinder along an axis of the frame, where volume, second moments, middle and extent are those of one.
    pub fn of(points: &[Vec3], volumes: &[f64]) -> Option<Self> {
        (0..3).find_map(|axis| {
            let mut direction = [0.0; 3];
            direction[axis] = 1.0;
            let pairs = || points.iter().copied().zip(volumes.iter().copied());
            let (radius, half) = fit(pairs, direction)?;
            Some(Self { axis, radius, half })
        })
    }

    /// Signed distance [m] and outward normal at a point of the frame.
    pub fn distance(&self, x: Vec3) -> Distance {
        let others = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        // The collider's stands along y.
        let standing = [x[others[0]], x[self.axis], x[others[1]]];
        let found = cylinder_distance(self.radius, self.half, standing);
        let mut normal = [0.0; 3];
        normal[others[0]] = found.normal[0];
        normal[self.axis] = found.normal[1];
        normal[others[1]] = found.normal[2];
        Distance { normal, ..found }
    }
}

/// Radius and half the length [m] of the cylinder along a direction that points with their volumes are, if they are.
fn fit<I: Iterator<Item = (Vec3, f64)>>(
    points: impl Fn() -> I,
    direction: Vec3,
) -> Option<(f64, f64)> {
    let across = perpendicular(direction);
    let frame = [direction, across, cross(direction, across)];
    let (mut count, mut volume, mut farthest) = (0_usize, 0.0, [0.0_f64; 2]);
    let (mut middle, mut square) = ([0.0; 3], [0.0; 3]);
    let mut product = 0.0;
    for (x, v) in points() {
        let r = frame.map(|axis| dot(axis, x));
        for a in 0..3 {
            middle[a] += v * r[a];
            // A particle is a cube, whatever its attitude.
            square[a] += v * (r[a] * r[a] + v.cbrt().powi(2) / 12.0);
        }
        product += v * r[1] * r[2];
        farthest = [
            farthest[0].max(r[0].abs()),
            farthest[1].max(r[1].hypot(r[2])),
        ];
        volume += v;
        count += 1;
    }
    if count < FEWEST || volume.is_nan() || volume <= 0.0 {
        return None;
    }
    let half = (3.0 * square[0] / volume).sqrt();
    let radius = (volume / (2.0 * std::f64::consts::PI * half)).sqrt();
    let spacing = (volume / count as f64).cbrt();
    // With several densities the origin, the centre of mass, need not be the middle.
    let is_central = length(middle) <= 1e-3 * volume * radius.min(half);
    let expected = 0.25 * volume * radius * radius;
    let is_round = (square[1] / expected - 1.0).abs() < ROUND
        && (square[2] / expected - 1.0).abs() < ROUND
        && (product / expected).abs() < ROUND;
    let beyond = [farthest[0] - half, farthest[1] - radius].map(|x| x / spacing);
    let is_full = beyond.iter().all(|x| (-INSIDE..OUTSIDE).contains(x));
    (is_central && is_round && is_full).then_some((radius, half))
}

/// A unit vector across a unit vector.
fn perpendicular(to: Vec3) -> Vec3 {
    let least = (0..3).fold(0, |m, a| if to[a].abs() < to[m].abs() { a } else { m });
    let mut other = [0.0; 3];
    other[least] = 1.0;
    unit(cross(to, other), other)
}

/// Axes of a frame, the last along the axis of the cylinder that these particles about the origin are, where they are
/// one and no axis of the present frame is along it. Second moments do not tell the axis of a cylinder that is
/// `sqrt(3)` times as long as its radius; fourth moments do, which are least along it.
pub(super) fn upright(grains: &[Grain]) -> Option<Mat3<f64>> {
    let pairs = || grains.iter().map(|g| (g.x, g.volume));
    let mut axis = [0.0; 3];
    for a in 0..3 {
        axis = [0.0; 3];
        axis[a] = 1.0;
        if fit(pairs, axis).is_some() {
            return None;
        }
    }
    // (r . n)^4 as a square of the six products of components.
    let mut fourth = [[0.0; 6]; 6];
    for g in grains {
        let [x, y, z] = g.x;
        let products = [x * x, y * y, z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z];
        for (row, p) in fourth.iter_mut().zip(products) {
            for (sum, q) in row.iter_mut().zip(products) {
                *sum += g.volume * p * q;
            }
        }
    }
    let of = |n: Vec3| -> f64 {
        let [x, y, z] = n;
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        let row = |row: &[f64; 6]| -> f64 { row.iter().zip(products).map(|(a, b)| a * b).sum() };
        fourth.iter().zip(products).map(|(r, p)| p * row(r)).sum()
    };
    let mut least = of(axis);
    // Directions about a fifth of a radian apart, half of them enough: n and -n are alike.
    let steps = 16;
    for i in 0..=steps {
        for j in 0..2 * steps {
            let up = f64::from(i) / f64::from(steps);
            let (sin, cos) = (std::f64::consts::PI * f64::from(j) / f64::from(steps)).sin_cos();
            let out = (1.0 - up * up).max(0.0).sqrt();
            let n = [out * cos, out * sin, up];
            let value = of(n);
            if value < least {
                (least, axis) = (value, n);
            }
        }
    }
    let mut step = 0.2;
    while step > 1e-12 {
        let one = perpendicular(axis);
        let two = cross(axis, one);
        let ways = [one, scaled(one, -1.0), two, scaled(two, -1.0)];
        let nearby = ways.map(|way| unit(along(axis, step, way), axis));
        let better = nearby.into_iter().find(|n| of(*n) < least);
        match better {
            Some(n) => (least, axis) = (of(n), n),
            None => step *= 0.5,
        }
    }
    fit(pairs, axis)?;
    let across = perpendicular(axis);
    Some(Mat3::from_columns(across, cross(axis, across), axis))
}
