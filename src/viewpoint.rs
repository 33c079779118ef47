//! Where a picture of a scene is taken from: options of whoever draws or looks.

use cosplat_console::size::size;
use cosplat_renderer::{camera::Orbit, drawing::Look};

/// The camera, and the size of its picture.
#[derive(clap::Args)]
pub struct Viewpoint {
    /// Size of the picture in pixels.
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = size)]
    size: (u32, u32),
    /// Camera's angle around the up axis, anticlockwise from above [degrees].
    #[arg(long, default_value_t = 35.0, allow_negative_numbers = true)]
    azimuth: f32,
    /// Camera's angle above the horizon [degrees].
    #[arg(long, default_value_t = 20.0, allow_negative_numbers = true)]
    elevation: f32,
    /// Camera's distance from the target [m; default: the whole scene is seen].
    #[arg(long)]
    distance: Option<f32>,
    /// Point X Y Z looked at [m; default: centre of the scene].
    #[arg(long, num_args = 3, allow_negative_numbers = true)]
    target: Option<Vec<f32>>,
}

impl Viewpoint {
    /// Pictures from there that go nowhere.
    pub fn look(&self) -> Look {
        let target = self.target.as_deref();
        let target = target.and_then(|point| <[f32; 3]>::try_from(point).ok());
        Look {
            width: self.size.0,
            height: self.size.1,
            orbit: Orbit {
                azimuth: self.azimuth.to_radians(),
                elevation: self.elevation.to_radians(),
                distance: self.distance,
                target: target.map(Into::into),
            },
            turning: 0.0,
            follow: None,
            path: None,
            is_shaded: false,
            png: None,
            every: 0,
            mp4: None,
            fps: 30.0,
        }
    }
}
