//! Picking: which Gaussian is seen at a point of a picture.
//!
//! Front to back, the first one at which less than half of the light behind still passes. A weighted depth would lie behind the
//! surface wherever it is translucent.

use crate::ellipse::{ALPHA_MAX, ALPHA_MIN, Ellipse};
use crate::splats::Splats;

/// Light that passes in front of what is seen.
const HALF: f64 = 0.5;

impl<T: Copy> Ellipse<T> {
    /// Opacity at a point of the picture [pixel], as pictures are blended with.
    pub fn opacity_at(&self, at: [f32; 2]) -> f64 {
        let [xx, xy, yy] = self.conic.map(f64::from);
        let [x, y] = [0, 1].map(|a| f64::from(at[a]) - f64::from(self.center[a]));
        let squared = xx * x * x + 2.0 * xy * x * y + yy * y * y;
        let opacity = f64::from(self.opacity) * (-0.5 * squared).exp();
        match opacity >= f64::from(ALPHA_MIN) {
            true => opacity.min(ALPHA_MAX.into()),
            false => 0.0,
        }
    }
}

impl<T: Copy + Send + Sync> Splats<T> {
    /// What is seen at a point of the picture [pixel]; pixel centres are at half-integers. None where half of the light
    /// behind all Gaussians passes.
    pub fn pick(&self, at: [f32; 2]) -> Option<Ellipse<T>> {
        let mut met: Vec<(Ellipse<T>, f64)> = self
            .ellipses()
            .filter(|ellipse| (0..2).all(|a| (at[a] - ellipse.center[a]).abs() <= ellipse.reach[a]))
            .map(|ellipse| (*ellipse, ellipse.opacity_at(at)))
            .filter(|(_, opacity)| *opacity > 0.0)
            .collect();
        // Equal depths stay in the order of the scene.
        met.sort_by(|(one, _), (other, _)| one.depth.total_cmp(&other.depth));
        let mut passes = 1.0;
        met.into_iter().find_map(|(ellipse, opacity)| {
            passes *= 1.0 - opacity;
            (passes < HALF).then_some(ellipse)
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};

    use crate::{Camera, Projection, Splats};

    /// Looks along +z from the origin.
    fn camera() -> Camera {
        Camera {
            position: Vec3::ZERO,
            world_from_camera: Mat3::IDENTITY,
            focal: [100.0; 2],
            center: [32.0, 24.0],
            width: 64,
            height: 48,
            near: 0.01,
        }
    }

    /// Index and depth of what is seen at the middle of the picture of round Gaussians on its axis.
    fn seen(balls: &[(f32, f32)]) -> Option<(usize, f32)> {
        let camera = camera();
        let projection = Projection::new(&camera);
        let splats = Splats::new(balls.len(), &camera, |n| {
            let (depth, opacity) = balls[n];
            let covariance = [0.01, 0.0, 0.0, 0.01, 0.0, 0.01];
            projection.ellipse([0.0, 0.0, depth], covariance, opacity, |_| n)
        });
        let found = splats.pick(camera.center)?;
        let point = camera.point_at(camera.center, found.depth);
        assert!((point - Vec3::Z * found.depth).length() < 1e-6, "{point}");
        Some((found.payload, found.depth))
    }

    #[test]
    fn the_first_that_hides_half_of_what_is_behind_is_seen() {
        assert_eq!(seen(&[(3.0, 0.9), (1.0, 0.9), (2.0, 0.9)]), Some((1, 1.0)));
        // 0.8, 0.64, 0.512, 0.41
        let veil: Vec<(f32, f32)> = (1..6).map(|n| (n as f32, 0.2)).collect();
        assert_eq!(seen(&veil), Some((3, 4.0)));
        assert_eq!(seen(&veil[..3]), None);
        assert_eq!(seen(&[]), None);
        // Behind the camera.
        assert_eq!(seen(&[(-1.0, 0.9)]), None);
    }

    #[test]
    fn a_point_of_a_pixel_is_projected_back_to_it() {
        let camera = camera();
        let point = camera.point_at([10.5, 40.25], 2.5);
        let (x, y, depth) = camera.project(point);
        assert!(
            (x - 10.5).abs() < 1e-4 && (y - 40.25).abs() < 1e-4,
            "{x} {y}"
        );
        assert!((depth - 2.5).abs() < 1e-6);
    }
}
