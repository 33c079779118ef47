//! The plane that a splat stands on, by sampling (RANSAC; M. A. Fischler and R. C. Bolles, 1981), and which way is up.

use glam::{Mat3, Vec3};

use crate::Splat;

/// Planes that are tried.
const TRIES: u64 = 3000;
/// Gaussians that planes are judged by.
const SAMPLE: usize = 4000;
/// Half of the thickness of a plane over the mean distance of neighbours in a surface.
const TOLERANCE: f32 = 3.0;
/// Share of the Gaussians in the plane at which their number no longer lowers the confidence.
const ENOUGH: f32 = 0.1;

/// A plane that things stand on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Unit normal, towards what stands on it: up.
    pub up: Vec3,
    /// Distance of the plane from the origin along `up` [asset unit].
    pub offset: f32,
    /// Half of its thickness [asset unit].
    pub tolerance: f32,
    /// How sure it is, 0..=1: product of how much of the rest lies on one side, how far the plane reaches under it, and
    /// whether a tenth of the Gaussians lies in it.
    pub confidence: f32,
}

impl Ground {
    /// Height of a point above the plane [asset unit].
    pub fn height(&self, point: Vec3) -> f32 {
        self.up.dot(point) - self.offset
    }

    /// Whether a point lies in it.
    pub fn holds(&self, point: Vec3) -> bool {
        self.height(point).abs() <= self.tolerance
    }

    /// The signed axis nearest to up, and the angle between them [rad].
    pub fn axis(&self) -> (Vec3, f32) {
        let most = self.up.abs().max_position();
        let axis = Vec3::AXES[most] * self.up[most].signum();
        (axis, axis.dot(self.up).clamp(-1.0, 1.0).acos())
    }
}

/// Numbers that look random, the same in every run.
fn noise(n: u64) -> u64 {
    let mut x = n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x ^ (x >> 31)
}

/// Points in a plane and on its two sides.
fn sides(points: &[Vec3], up: Vec3, offset: f32, tolerance: f32) -> [usize; 3] {
    let mut count = [0; 3];
    for point in points {
        let height = up.dot(*point) - offset;
        let side = usize::from(height > tolerance) + 2 * usize::from(height < -tolerance);
        count[side] += 1;
    }
    count
}

/// How much of what is outside lies on one side more than on the other, 0..=1.
fn one_sided([_, above, below]: [usize; 3]) -> f32 {
    above.abs_diff(below) as f32 / (above + below).max(1) as f32
}

/// Least squares through the points within `tolerance`.
fn fitted(points: &[Vec3], up: Vec3, offset: f32, tolerance: f32) -> (Vec3, f32) {
    let side = up.any_orthonormal_vector();
    let frame = Mat3::from_cols(side, up.cross(side), up);
    let near: Vec<Vec3> = points
        .iter()
        .map(|p| frame.transpose() * *p)
        .filter(|p| (p.z - offset).abs() <= tolerance)
        .collect();
    if near.len() < 3 {
        return (up, offset);
    }
    let mean = near.iter().sum::<Vec3>() / near.len() as f32;
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for p in &near {
        let d = (*p - mean).as_dvec3();
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
        xz += d.x * d.z;
        yz += d.y * d.z;
    }
    let det = xx * yy - xy * xy;
    if det <= 1e-12 * xx * yy {
        return (up, offset);
    }
    let (a, b) = ((xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det);
    let tilted = frame * Vec3::new(-a as f32, -b as f32, 1.0).normalize();
    (tilted, tilted.dot(frame * mean))
}

/// The plane that most Gaussians lie in and that most others lie on one side of; `spacing` is the distance of neighbours
/// in a surface [asset unit]. None of fewer than a hundred Gaussians.
pub fn ground(splat: &Splat, spacing: f32) -> Option<Ground> {
    let count = splat.len();
    if count < 100 || spacing <= 0.0 {
        return None;
    }
    let tolerance = TOLERANCE * spacing;
    let at = |n: u64| splat.position[(noise(n) % count as u64) as usize];
    let sample: Vec<Vec3> = (0..SAMPLE as u64).map(|n| at(n << 20)).collect();
    let score = |up: Vec3, offset: f32| {
        let found = sides(&sample, up, offset, tolerance);
        found[0] as f32 * one_sided(found)
    };
    let plane = |n: u64| {
        let [a, b, c] = [3 * n, 3 * n + 1, 3 * n + 2].map(at);
        let up = (b - a).cross(c - a).try_normalize()?;
        Some((score(up, up.dot(a)), up, up.dot(a)))
    };
    let planes = (0..TRIES).filter_map(plane);
    let (_, mut up, mut offset) = planes.max_by(|a, b| a.0.total_cmp(&b.0))?;
    for _ in 0..3 {
        (up, offset) = fitted(&sample, up, offset, tolerance);
    }
    let found = sides(&splat.position, up, offset, tolerance);
    if found[2] > found[1] {
        (up, offset) = (-up, -offset);
    }
    let reach = |inside: bool| {
        let mut extent: Vec<f32> = Vec::new();
        for side in [
            up.any_orthonormal_vector(),
            up.cross(up.any_orthonormal_vector()),
        ] {
            let of = |p: &&Vec3| ((up.dot(**p) - offset).abs() <= tolerance) == inside;
            let mut along: Vec<f32> = sample.iter().filter(of).map(|p| side.dot(*p)).collect();
            along.sort_unstable_by(f32::total_cmp);
            let cut = along.len() / 50;
            let width = |a: &[f32]| a[a.len() - 1 - cut] - a[cut];
            extent.push(if along.is_empty() { 0.0 } else { width(&along) });
        }
        extent[0] * extent[1]
    };
    let under = (reach(true) / reach(false).max(f32::MIN_POSITIVE)).min(1.0);
    let share = found[0] as f32 / count as f32;
    Some(Ground {
        up,
        offset,
        tolerance,
        confidence: one_sided(found) * under * (share / ENOUGH).min(1.0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splat(points: Vec<Vec3>) -> Splat {
        Splat {
            position: points,
            ..Splat::default()
        }
    }

    /// A tilted plate with a heap on it, and floaters.
    fn plate() -> (Vec<Vec3>, Vec3) {
        let up = Vec3::new(0.2, -1.0, 0.1).normalize();
        let side = up.any_orthonormal_vector();
        let other = up.cross(side);
        let unit = |n: u64| (noise(n) % 10_000) as f32 / 10_000.0 - 0.5;
        let on = |n: u64| 2.0 * unit(3 * n) * side + 2.0 * unit(3 * n + 1) * other;
        let plate = (0..3000).map(|n| on(n) + 0.004 * unit(n + 70_000) * up);
        let heap = (3000..6000).map(|n| 0.3 * on(n) + (0.25 + 0.4 * unit(n + 90_000)) * up);
        let floaters = (6000..6020).map(|n| 40.0 * (on(n) - up * unit(n)));
        (plate.chain(heap).chain(floaters).collect(), up)
    }

    #[test]
    fn the_plate_under_a_heap_is_the_ground_and_up_is_the_heap() {
        let (points, up) = plate();
        let found = ground(&splat(points), 0.01).expect("a plane");
        assert!(found.up.dot(up) > 0.9999, "{found:?}");
        assert!(found.offset.abs() < 0.01, "{found:?}");
        assert!(found.confidence > 0.9, "{found:?}");
        let (axis, tilt) = found.axis();
        assert_eq!(axis, Vec3::NEG_Y);
        assert!((tilt - up.dot(axis).acos()).abs() < 0.01, "{tilt}");
    }

    #[test]
    fn a_ball_stands_on_nothing() {
        let unit = |n: u64| (noise(n) % 10_000) as f32 / 10_000.0 - 0.5;
        let ball = (0..3000u64).map(|n| Vec3::new(unit(3 * n), unit(3 * n + 1), unit(3 * n + 2)));
        let ball: Vec<Vec3> = ball.filter_map(Vec3::try_normalize).collect();
        let found = ground(&splat(ball), 0.01);
        assert!(found.is_none_or(|g| g.confidence < 0.2), "{found:?}");
        assert!(ground(&splat(vec![Vec3::ONE; 50]), 0.1).is_none());
        assert!(ground(&splat(vec![Vec3::ONE; 500]), 0.1).is_none());
    }
}
