//! Balls, solid and hollow: how they are recognised, their distance.

use super::vector::{Vec3, add, along, length, scaled, solve, sub, unit};
use crate::mat3::{Mat3, cross, dot};

/// Particles that a ball is made of at least.
const FEWEST: usize = 27;
/// Largest relative difference between what a ball's volume and each of its second moments say about it.
const ROUND: f64 = 0.03;
/// How much farther out than the surface its particles may be, in spacings.
const OUTSIDE: f64 = 0.5;
/// How far surface may be off a sphere: at most and as root of the mean square, in spacings, as a lattice of particles
/// has terraces, and in radii, as what was captured has bumps.
const DEVIATION_MAX: [f64; 2] = [0.5, 0.07];
const MEAN: [f64; 2] = [0.15, 0.02];
/// Largest relative difference between the axes of what counts as round, and between the area of a surface and that of
/// its sphere.
const OVAL: f64 = 0.02;
const WHOLE: f64 = 0.2;

/// A sphere in the frame of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sphere {
    /// [m]
    pub center: Vec3,
    /// [m]
    pub radius: f64,
}

/// A ball. Its middle is not the centre of mass where it is heavier on one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    pub outer: Sphere,
    /// What is empty in it.
    pub cavity: Option<Sphere>,
}

impl Sphere {
    /// Signed distance [m].
    fn distance(&self, x: Vec3) -> f64 {
        length(sub(x, self.center)) - self.radius
    }

    fn normal(&self, x: Vec3) -> Vec3 {
        unit(sub(x, self.center), [0.0, 0.0, 1.0])
    }

    /// Of all spheres nearest to points with their weights, by `|x|^2 - 2 c x = R^2 - c^2`.
    fn fitted(points: &[(Vec3, f64)]) -> Self {
        let weight: f64 = points.iter().map(|p| p.1).sum();
        let mean = points
            .iter()
            .fold([0.0; 3], |sum, (x, w)| along(sum, w / weight, *x));
        let (mut square, mut third, mut size) = (Mat3::diagonal([0.0; 3]), [0.0; 3], 0.0);
        for (x, w) in points {
            let (u, w) = (sub(*x, mean), w / weight);
            for a in 0..3 {
                for b in 0..3 {
                    square.0[a][b] += w * u[a] * u[b];
                }
            }
            third = along(third, 0.5 * w * dot(u, u), u);
            size += w * dot(u, u);
        }
        let shift = solve(&square, third);
        Self {
            center: add(mean, shift),
            radius: (size + dot(shift, shift)).sqrt(),
        }
    }

    /// Whether a surface, given by points with the area that each stands for, is this sphere but for its roughness.
    fn is_surface(&self, points: &[(Vec3, f64)], spacing: f64) -> bool {
        let bound = |[spacings, radii]: [f64; 2]| spacings * spacing + radii * self.radius;
        let area: f64 = points.iter().map(|p| p.1).sum();
        let whole = 4.0 * std::f64::consts::PI * self.radius * self.radius;
        // Semi-axes R (1 + e_a), with a sum of e_a of 0, are off the sphere by R sum e_a n_a^2, whose mean times
        // n_a^2 - 1/3 is 2/15 R e_a.
        let (mut mean, mut oval) = (0.0, [[0.0; 3]; 3]);
        for (x, w) in points {
            let (off, n) = (self.distance(*x), self.normal(*x));
            if off.is_nan() || off.abs() > bound(DEVIATION_MAX) {
                return false;
            }
            mean += w / area * off * off;
            for a in 0..3 {
                for b in 0..3 {
                    let third = if a == b { 1.0 / 3.0 } else { 0.0 };
                    oval[a][b] += 7.5 * w / area * off / self.radius * (n[a] * n[b] - third);
                }
            }
        }
        let oval = Mat3(oval).norm_squared().sqrt();
        mean.sqrt() <= bound(MEAN) && oval <= OVAL && (area / whole - 1.0).abs() <= WHOLE
    }
}

impl Ball {
    /// Solid, of the volume of particles and about its middle: the surface that they have on average.
    fn full(points: &[Vec3], volumes: &[f64]) -> Self {
        let volume: f64 = volumes.iter().sum();
        let pairs = points.iter().zip(volumes);
        let outer = Sphere {
            center: pairs.fold([0.0; 3], |sum, (x, v)| along(sum, v / volume, *x)),
            radius: (0.75 * volume / std::f64::consts::PI).cbrt(),
        };
        let cavity = None;
        Self { outer, cavity }
    }

    /// The one that particles are whose volume, second moments and extent are those of a ball: its surface is smooth, and
    /// not that of the lattice they sit on.
    pub fn of_particles(points: &[Vec3], volumes: &[f64]) -> Option<Self> {
        if points.len() < FEWEST {
            return None;
        }
        let ball = Self::full(points, volumes);
        let Sphere { center, radius } = ball.outer;
        let volume: f64 = volumes.iter().sum();
        let (mut square, mut farthest) = ([0.0; 3], 0.0_f64);
        for (x, v) in points.iter().zip(volumes) {
            let r = sub(*x, center);
            for a in 0..3 {
                square[a] += v * (r[a] * r[a] + v.cbrt().powi(2) / 12.0) / volume;
            }
            farthest = farthest.max(length(r));
        }
        let expected = radius * radius / 5.0;
        let round = square.iter().all(|s| (s / expected - 1.0).abs() < ROUND);
        let spacing = (volume / points.len() as f64).cbrt();
        (round && farthest < radius + OUTSIDE * spacing).then_some(ball)
    }

    /// The one whose surface these triangles are, but for terraces and bumps; hollow where there are two spheres.
    pub fn of_surface(triangles: &[[Vec3; 3]], points: &[Vec3], volumes: &[f64]) -> Option<Self> {
        let spacing = (volumes.iter().sum::<f64>() / volumes.len() as f64).cbrt();
        let corners = triangles.iter().flat_map(|[a, b, c]| {
            let area = 0.5 * length(cross(sub(*b, *a), sub(*c, *a)));
            [*a, *b, *c].map(|x| (x, area / 3.0))
        });
        let corners: Vec<(Vec3, f64)> = corners.collect();
        let all = Sphere::fitted(&corners);
        let full = Self::full(points, volumes);
        if all.is_surface(&corners, spacing) {
            // Of what does not fill it, its surface says more.
            let differs = (full.outer.radius / all.radius - 1.0).abs();
            let outer = match differs < MEAN[1] + MEAN[0] * spacing / all.radius {
                true => full.outer,
                false => all,
            };
            return Some(Self { outer, ..full });
        }
        let away = |(x, _): &(Vec3, f64)| length(sub(*x, all.center));
        let least = corners.iter().map(away).fold(f64::INFINITY, f64::min);
        let most = corners.iter().map(away).fold(0.0, f64::max);
        let is_outer = |corner: &(Vec3, f64)| away(corner) > 0.5 * (least + most);
        let (out, inside): (Vec<_>, Vec<_>) = corners.into_iter().partition(is_outer);
        let (outer, cavity) = (Sphere::fitted(&out), Sphere::fitted(&inside));
        let both = outer.is_surface(&out, spacing) && cavity.is_surface(&inside, spacing);
        let ball = Self {
            outer,
            cavity: Some(cavity),
        };
        (both && ball.depth() > 0.0).then_some(ball)
    }

    /// Signed distance [m].
    pub fn distance(&self, x: Vec3) -> f64 {
        let outside = self.outer.distance(x);
        match &self.cavity {
            Some(cavity) => outside.max(-cavity.distance(x)),
            None => outside,
        }
    }

    /// Outward unit normal.
    pub fn normal(&self, x: Vec3) -> Vec3 {
        match &self.cavity {
            Some(cavity) if -cavity.distance(x) > self.outer.distance(x) => {
                scaled(cavity.normal(x), -1.0)
            }
            _ => self.outer.normal(x),
        }
    }

    /// Depth of the point that is deepest inside, where the wall is thinnest [m].
    pub fn depth(&self) -> f64 {
        let Self { outer, cavity } = self;
        cavity.map_or(outer.radius, |cavity| {
            let aside = length(sub(cavity.center, outer.center));
            0.5 * (outer.radius - cavity.radius - aside)
        })
    }

    /// Farthest that its surface is from the origin [m].
    pub fn reach(&self) -> f64 {
        self.outer.radius + length(self.outer.center)
    }

    /// Whether a ball of this radius about a point is in its cavity, or would be if it did not overlap the wall.
    pub fn holds(&self, x: Vec3, radius: f64) -> bool {
        self.cavity
            .is_some_and(|cavity| cavity.distance(x) < 0.0 && radius < cavity.radius)
    }
}
