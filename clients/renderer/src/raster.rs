//! The picture: colours summed by the weights of the rasteriser, over a background.

use cosplat_ipc::schema::{GaussianState, SceneHeader};
use cosplat_raster::{Ellipse, Projection, Row, SIZE, Sink, Splats};
use rayon::prelude::*;

use crate::shade::Shade;
use crate::{Camera, Harmonics, Image};

/// Picture of `gaussians` as `camera` sees them before `background` (sRGB, 0..=1).
///
/// Colours come from `sh` where it has one for the Gaussian's index, else from `GaussianState::color`. Gaussians that
/// cannot be drawn (not finite, behind the camera, covariance not positive) are left out. Equal input gives equal
/// bytes for any number of threads and any instruction set.
pub fn picture(
    gaussians: &[GaussianState],
    sh: Option<Harmonics>,
    camera: &Camera,
    background: [f32; 3],
) -> Image {
    Projected::new(gaussians, sh, camera).draw(background)
}

/// What is seen at a point of a picture.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Picked {
    /// Object id.
    pub object: u32,
    /// Index of the Gaussian.
    pub gaussian: u32,
    /// The point of the view at the Gaussian's depth [m], world frame.
    pub point: [f32; 3],
}

/// The first Gaussian, front to back, at which less than half of the light behind passes; `at` is in pixels, whose centres are
/// at half-integers. None where the background shows.
pub fn pick(gaussians: &[GaussianState], camera: &Camera, at: [f32; 2]) -> Option<Picked> {
    let projection = Projection::new(camera);
    let splats = Splats::new(gaussians.len(), camera, |n| {
        let g = &gaussians[n];
        let opacity = f32::from(g.color[3]) / 255.0;
        projection.ellipse(g.position, g.covariance, opacity, |_| n)
    });
    let seen = splats.pick(at)?;
    let g = &gaussians[seen.payload];
    Some(Picked {
        object: g.object,
        gaussian: g.index,
        point: camera.point_at(at, seen.depth).to_array(),
    })
}

/// What `camera` sees of a frame of `scene`, whose block `scene/sh` is `sh`.
pub fn project(
    gaussians: &[GaussianState],
    scene: &SceneHeader,
    sh: &[f32],
    camera: &Camera,
) -> Projected {
    Projected::new(gaussians, harmonics(scene, sh), camera)
}

/// Colours that depend on the direction; without directional coefficients the frame's own colour says it all.
pub(crate) fn harmonics<'a>(scene: &SceneHeader, sh: &'a [f32]) -> Option<Harmonics<'a>> {
    match scene.sh_degree {
        0 => None,
        degree => Harmonics::new(degree, sh),
    }
}

/// A frame as seen by a camera, not drawn yet: all that a picture needs of the frame's memory, which can be given back.
#[derive(Clone, Debug)]
pub struct Projected(Splats<[f32; 3]>);

impl Projected {
    /// First half of [`picture`].
    pub fn new(gaussians: &[GaussianState], sh: Option<Harmonics>, camera: &Camera) -> Self {
        Self::shaded(gaussians, sh, camera, None)
    }

    /// The same with colours darkened by `shade`.
    pub(crate) fn shaded(
        gaussians: &[GaussianState],
        sh: Option<Harmonics>,
        camera: &Camera,
        shade: Option<&Shade>,
    ) -> Self {
        let projection = Projection::new(camera);
        Self(Splats::new(gaussians.len(), camera, |n| {
            let g = &gaussians[n];
            let [red, green, blue, opacity] = g.color.map(|level| f32::from(level) / 255.0);
            projection.ellipse(g.position, g.covariance, opacity, |offset| {
                let color = sh
                    .and_then(|sh| sh.color(g.index, offset.normalize(), g.rotation))
                    .map_or([red, green, blue], |color| color.to_array());
                match shade {
                    Some(shade) => color.map(|level| level * shade.light(g)),
                    None => color,
                }
            })
        }))
    }

    /// Second half of [`picture`].
    pub fn draw(&self, background: [f32; 3]) -> Image {
        let [width, height] = self.0.size();
        let mut rgb = vec![0; 3 * width * height];
        // `max(1)`: chunks of zero bytes are not allowed, and a picture without pixels has none.
        let strips = rgb.par_chunks_mut((3 * width * SIZE).max(1));
        self.0.blend(strips.map(|pixels| Strip {
            background,
            width,
            pixels,
            left: 0,
            light: Default::default(),
        }));
        Image {
            width: width as u32,
            height: height as u32,
            rgb,
        }
    }
}

/// A strip of the picture while it is drawn.
struct Strip<'a> {
    background: [f32; 3],
    width: usize,
    /// `[row][pixel][rgb]`.
    pixels: &'a mut [u8],
    /// First column of the tile at hand.
    left: usize,
    /// Light gathered so far in it, `[row][rgb][pixel]`.
    light: [[Row; 3]; SIZE],
}

impl Sink<[f32; 3]> for Strip<'_> {
    fn begin_strip(&mut self, _: &[Ellipse<[f32; 3]>]) {}

    fn begin_tile(&mut self, left: usize, _: usize) {
        self.left = left;
        self.light = Default::default();
    }

    #[inline(always)]
    fn row(&mut self, _: usize, color: [f32; 3], row: usize, weight: &Row) {
        for (light, color) in self.light[row].iter_mut().zip(color) {
            for lane in 0..SIZE {
                light[lane] += color * weight[lane];
            }
        }
    }

    fn end_tile(&mut self, transmittance: &[Row; SIZE]) {
        let columns = SIZE.min(self.width - self.left);
        for (row, line) in self.pixels.chunks_exact_mut(3 * self.width).enumerate() {
            let line = &mut line[3 * self.left..3 * (self.left + columns)];
            for (column, pixel) in line.chunks_exact_mut(3).enumerate() {
                for channel in 0..3 {
                    let behind = self.background[channel] * transmittance[row][column];
                    let value = self.light[row][channel][column] + behind;
                    // The cast saturates: brighter than white is white.
                    pixel[channel] = (value * 255.0 + 0.5) as u8;
                }
            }
        }
    }
}
