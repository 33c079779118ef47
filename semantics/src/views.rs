//! Where the pictures were taken from.

use cosplat_raster::{Camera, camera::Orbit};
use glam::Vec3;

/// A picture's name and camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name of the picture, as its files have it, without the extension.
    pub name: String,
    /// Its camera, in the frame and unit of the asset.
    pub camera: Camera,
}

/// Lowest and highest elevation of a spiral [rad].
const ELEVATION: [f32; 2] = [0.12, 1.15];

/// `count` views on a spiral around the box `bounds` (smallest, largest corner), from near the horizon to near the top.
///
/// `up` is a signed coordinate axis.
pub fn spiral(bounds: [Vec3; 2], up: Vec3, count: usize, width: u32, height: u32) -> Vec<View> {
    // The golden angle: no two views share an azimuth, whatever their number.
    let turn = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    let view = |n: usize| {
        let share = (n as f32 + 0.5) / count as f32;
        let orbit = Orbit {
            azimuth: (turn * n as f32) % std::f32::consts::TAU,
            elevation: ELEVATION[0] + (ELEVATION[1] - ELEVATION[0]) * share,
            distance: None,
            target: None,
        };
        View {
            name: format!("view_{n:04}"),
            camera: Camera::orbit(bounds, up, orbit, width, height),
        }
    };
    (0..count).map(view).collect()
}

/// Nearest distance along the view axis at which a Gaussian is drawn, over the distance at which a picture is as wide as
/// its focal length: only what sits in the camera is left out.
const NEAR: f32 = 1e-3;

/// Numbers of a pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pinhole {
    pub width: u32,
    pub height: u32,
    pub focal: [f32; 2],
    pub center: [f32; 2],
}

impl Pinhole {
    /// What is wrong with it, in words.
    pub fn fault(&self) -> Option<String> {
        let sizes = 1..=16_384;
        if !sizes.contains(&self.width) || !sizes.contains(&self.height) {
            return Some(format!(
                "a picture has {} x {} pixels, expected 1 to 16384 each",
                self.width, self.height
            ));
        }
        let is_good = |f: f32| f.is_finite() && f > 0.0;
        if !self.focal.into_iter().all(is_good) || !self.center.into_iter().all(f32::is_finite) {
            return Some(format!(
                "focal lengths {:?} and centre {:?} [pixel], expected finite ones, the first more than 0",
                self.focal, self.center
            ));
        }
        None
    }

    /// The camera at `position` whose axes right, down, forward are the columns of `world_from_camera`.
    pub fn camera(&self, position: Vec3, world_from_camera: glam::Mat3) -> Camera {
        Camera {
            position,
            world_from_camera,
            focal: self.focal,
            center: self.center,
            width: self.width,
            height: self.height,
            near: NEAR,
        }
    }
}

/// A picture's name without folders and extension, as masks are named.
pub(crate) fn stem(name: &str) -> String {
    let file = name.rsplit(['/', '\\']).next().unwrap_or(name);
    file.rsplit_once('.')
        .map_or(file, |(stem, _)| stem)
        .to_owned()
}
