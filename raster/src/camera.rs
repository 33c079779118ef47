//! Pinhole camera: where the picture is taken from, and framing of a box by itself.

use glam::{Mat3, Vec3};

/// Room left around the framed box, as a fraction of the picture.
const MARGIN: f32 = 0.08;

/// Pinhole camera. Camera axes are x right, y down, z forward (the convention of splat training tools).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Centre of projection [m], world frame.
    pub position: Vec3,
    /// World-from-camera rotation; columns are right, down, forward.
    pub world_from_camera: Mat3,
    /// Focal lengths along x and y [pixel], > 0.
    pub focal: [f32; 2],
    /// Where the optical axis meets the picture [pixel]; half its size for a centred one.
    pub center: [f32; 2],
    /// Pixels per row, 1..=16384.
    pub width: u32,
    /// Rows, 1..=16384.
    pub height: u32,
    /// Gaussians whose centre is nearer than this along the view axis are left out [m], > 0.
    pub near: f32,
}

/// How a camera circles a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Angle around the up axis, anticlockwise from above [rad]; at 0 the picture's right is +x for up = z or y.
    pub azimuth: f32,
    /// Angle above the horizon [rad], kept within 89.9 degrees of it.
    pub elevation: f32,
    /// From the target to the camera [m]; `None` = as near as shows the whole box.
    pub distance: Option<f32>,
    /// Point looked at [m]; `None` = centre of the box.
    pub target: Option<Vec3>,
}

impl Default for Orbit {
    fn default() -> Self {
        Self {
            azimuth: 0.6,
            elevation: 0.35,
            distance: None,
            target: None,
        }
    }
}

/// Signed coordinate axis nearest to "against gravity"; +z when there is no gravity to speak of.
pub fn up_from_gravity(gravity: [f64; 3]) -> Vec3 {
    let (mut up, mut largest) = (Vec3::Z, 0.0);
    for axis in [2, 1, 0] {
        let size = gravity[axis].abs();
        if size.is_finite() && size > largest {
            largest = size;
            up = Vec3::ZERO;
            up[axis] = if gravity[axis] < 0.0 { 1.0 } else { -1.0 };
        }
    }
    up
}

impl Camera {
    /// Camera on a sphere around the box `bounds` (smallest, largest corner [m]), looking at it.
    ///
    /// `up` is a signed coordinate axis, see [`up_from_gravity`]. A box that is not finite or inside out is
    /// replaced by the unit cube around the origin.
    pub fn orbit(bounds: [Vec3; 2], up: Vec3, orbit: Orbit, width: u32, height: u32) -> Self {
        let [low, high] = bounds;
        let usable = low.is_finite()
            && high.is_finite()
            && (high - low).is_finite()
            && low.cmple(high).all();
        let [low, high] = if usable {
            [low, high]
        } else {
            [Vec3::splat(-0.5), Vec3::splat(0.5)]
        };
        let half = ((high - low) * 0.5).max(Vec3::splat(1e-6));
        let centre = low + (high - low) * 0.5;
        let target = orbit.target.filter(|t| t.is_finite()).unwrap_or(centre);
        let (width, height) = (width.clamp(1, 16_384), height.clamp(1, 16_384));
        let tan_y = (0.5 * 40f32.to_radians()).tan();
        let tan_x = tan_y * width as f32 / height as f32;

        // At azimuth 0 the camera stands at `front`, so that the picture's right is `front` turned by +90 degrees
        // around `up`: -y for z up and +z for y up both put +x to the right.
        let front = if up.x != 0.0 {
            Vec3::Z
        } else if up.y != 0.0 {
            Vec3::Z * up.y
        } else {
            -Vec3::Y * up.z
        };
        let side = up.cross(front);
        let limit = 89.9f32.to_radians();
        let elevation = finite_or(orbit.elevation, 0.0).clamp(-limit, limit);
        let azimuth = finite_or(orbit.azimuth, 0.0);
        let level = front * azimuth.cos() + side * azimuth.sin();
        let away = level * elevation.cos() + up * elevation.sin();
        let forward = -away;
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let world_from_camera = Mat3::from_cols(right, down, forward);

        // Every corner of the box within the picture: |x| <= tan z and |y| <= tan z, z = distance + depth.
        let fit = (0..8)
            .map(|corner| {
                let sign = |bit: u32| if corner & (1 << bit) == 0 { -1.0 } else { 1.0 };
                let point = centre + half * Vec3::new(sign(0), sign(1), sign(2)) - target;
                let view = world_from_camera.transpose() * point;
                let (x, y) = (view.x.abs() / tan_x, view.y.abs() / tan_y);
                x.max(y) / (1.0 - MARGIN) - view.z
            })
            .fold(0.0, f32::max);
        let distance = orbit
            .distance
            .filter(|d| d.is_finite() && *d > 0.0)
            .unwrap_or(fit);
        Self {
            position: target + away * distance,
            world_from_camera,
            focal: [0.5 * height as f32 / tan_y; 2],
            center: [0.5 * width as f32, 0.5 * height as f32],
            width,
            height,
            near: (0.01 * distance).max(f32::MIN_POSITIVE),
        }
    }

    /// The world point at a place of the picture [pixel] and a depth [m].
    pub fn point_at(&self, at: [f32; 2], depth: f32) -> Vec3 {
        let [x, y] = [0, 1].map(|a| depth * (at[a] - self.center[a]) / self.focal[a]);
        self.position + self.world_from_camera * Vec3::new(x, y, depth)
    }

    /// Pixel position and depth [m] of a world point; pixel centres are at half-integers. Meaningless for depth <= 0.
    pub fn project(&self, point: Vec3) -> (f32, f32, f32) {
        let view = self.world_from_camera.transpose() * (point - self.position);
        (
            self.center[0] + self.focal[0] * view.x / view.z,
            self.center[1] + self.focal[1] * view.y / view.z,
            view.z,
        )
    }
}

fn finite_or(value: f32, otherwise: f32) -> f32 {
    if value.is_finite() { value } else { otherwise }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_opposes_gravity_and_falls_back_to_z() {
        assert_eq!(up_from_gravity([0.0, 0.0, -9.81]), Vec3::Z);
        assert_eq!(up_from_gravity([0.0, -9.81, 0.1]), Vec3::Y);
        assert_eq!(up_from_gravity([0.0, 9.81, 0.0]), -Vec3::Y);
        assert_eq!(up_from_gravity([0.0; 3]), Vec3::Z);
        assert_eq!(up_from_gravity([f64::NAN, f64::INFINITY, -1.0]), Vec3::Z);
    }

    #[test]
    fn orbit_shows_the_whole_box_and_touches_the_margin() {
        let bounds = [Vec3::new(-1.0, 2.0, 0.0), Vec3::new(3.0, 2.5, 1.0)];
        for up in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z] {
            for azimuth in [0.0, 1.0, 2.5, 4.0] {
                let orbit = Orbit {
                    azimuth,
                    elevation: 0.4,
                    ..Orbit::default()
                };
                let camera = Camera::orbit(bounds, up, orbit, 320, 200);
                let mut reach = 0f32;
                for corner in 0..8 {
                    let pick = |axis: usize| bounds[(corner >> axis) & 1][axis];
                    let (x, y, depth) = camera.project(Vec3::new(pick(0), pick(1), pick(2)));
                    assert!(depth > camera.near);
                    reach = reach
                        .max((x / 160.0 - 1.0).abs())
                        .max((y / 100.0 - 1.0).abs());
                }
                assert!((reach - (1.0 - MARGIN)).abs() < 1e-4, "{reach}");
            }
        }
    }

    #[test]
    fn up_is_up_and_right_is_right_in_the_picture() {
        let bounds = [Vec3::splat(-1.0), Vec3::splat(1.0)];
        let level = Orbit {
            azimuth: 0.0,
            elevation: 0.0,
            ..Orbit::default()
        };
        for up in [Vec3::Y, Vec3::Z] {
            let camera = Camera::orbit(bounds, up, level, 100, 100);
            assert!(camera.project(up * 0.5).1 < 45.0);
            assert!(camera.project(Vec3::X * 0.5).0 > 55.0);
            let determinant = camera.world_from_camera.determinant();
            assert!((determinant - 1.0).abs() < 1e-5, "{determinant}");
        }
    }

    #[test]
    fn hopeless_bounds_and_angles_still_give_a_finite_camera() {
        let orbit = Orbit {
            azimuth: f32::NAN,
            elevation: f32::INFINITY,
            distance: Some(-1.0),
            target: Some(Vec3::NAN),
        };
        for bounds in [
            [Vec3::splat(1.0), Vec3::splat(-1.0)],
            [Vec3::NAN, Vec3::ONE],
            [Vec3::splat(-f32::MAX), Vec3::splat(f32::MAX)],
            [Vec3::ONE, Vec3::ONE],
        ] {
            let camera = Camera::orbit(bounds, Vec3::Z, orbit, 0, 0);
            assert!(camera.position.is_finite() && camera.world_from_camera.is_finite());
            assert!(camera.near > 0.0 && camera.focal[1] > 0.0);
        }
    }
}
