//! Gradients of what [`composite`](crate::composite()) draws: from pixels back to the values, opacity and ellipse of each
//! Gaussian, and from an ellipse back to position, scale and rotation.
//!
//! With `g` the gradient at a pixel, `s_i = g . value_i` and `T_i` what reaches Gaussian `i`, the gradient by its opacity
//! there is `T_i s_i - (rest behind i) / (1 - alpha_i)`. The rest is the sum over all, known from the picture, less that of
//! what is nearer. So one more walk from front to back gives all of it, over the same tiles as the picture.

use glam::{DVec3, Mat3, Vec3};
use rayon::prelude::*;

use crate::{Ellipse, Projection, Row, SIZE, Sink, Splats, composite::Picture, ellipse::ALPHA_MAX};

/// Gradient by what the rasteriser blends of one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScreenGradient {
    /// By the centre [1/pixel].
    pub center: [f32; 2],
    /// By the inverse covariance xx xy yy [pixel^2].
    pub conic: [f32; 3],
    /// By the opacity at the centre.
    pub opacity: f32,
}

/// Gradient by where a Gaussian is in space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialGradient {
    /// By its position [1/m]. What it shows depends on the direction it is seen from; that direction is held fixed.
    pub position: DVec3,
    /// By its standard deviations [1/m].
    pub scale: DVec3,
    /// By the vector of a small rotation in the frame of the world [1/rad].
    pub rotation: DVec3,
}

/// Gradients of all Gaussians by one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adjoint {
    /// By the values, `[gaussians][channels]`.
    pub values: Vec<f32>,
    /// By the ellipse of each Gaussian.
    pub screen: Vec<ScreenGradient>,
    /// Sum over pixels of opacity times transmittance [pixel].
    pub weight: Vec<f32>,
}

/// Gradients of a function of a picture by the `count` Gaussians that `picture` was composited of.
///
/// `gradient` is that function's gradient by the planes of the picture, in their layout. Sums have a fixed order: any
/// number of threads gives the same bits.
pub fn adjoint(
    splats: &Splats<u32>,
    count: usize,
    values: &[f32],
    picture: &Picture,
    gradient: &[f32],
) -> Adjoint {
    let channels = picture.channels;
    let strips = (0..picture.height.div_ceil(SIZE)).into_par_iter();
    let strips = splats.blend(strips.map(|_| Pull {
        values,
        picture,
        gradient,
        corner: [0; 2],
        slopes: vec![[0.0; SIZE]; channels * SIZE],
        rest: [[0.0; SIZE]; SIZE],
        passes: [[1.0; SIZE]; SIZE],
        place: None,
        lanes: vec![[0.0; SIZE]; channels],
        moments: [[0.0; SIZE]; MOMENTS],
        shapes: Vec::new(),
        of_values: Vec::new(),
        of_screen: Vec::new(),
        of_weight: Vec::new(),
    }));
    let mut sum = Adjoint {
        values: vec![0.0; count * channels],
        screen: vec![ScreenGradient::default(); count],
        weight: vec![0.0; count],
    };
    for strip in &strips {
        for (place, shape) in strip.shapes.iter().enumerate() {
            let n = shape.gaussian as usize;
            sum.screen[n].add(&strip.of_screen[place]);
            sum.weight[n] += strip.of_weight[place];
            let from = &strip.of_values[place * channels..(place + 1) * channels];
            let to = &mut sum.values[n * channels..(n + 1) * channels];
            for (to, from) in to.iter_mut().zip(from) {
                *to += from;
            }
        }
    }
    sum
}

impl ScreenGradient {
    fn add(&mut self, other: &Self) {
        for axis in 0..2 {
            self.center[axis] += other.center[axis];
        }
        for axis in 0..3 {
            self.conic[axis] += other.conic[axis];
        }
        self.opacity += other.opacity;
    }
}

/// Sums over the pixels of an ellipse: of `h = alpha dL/dalpha` times 1, x, y, xx, xy, yy, and of the weight.
const MOMENTS: usize = 7;
/// Opacities at a pixel above this are capped ones, which no parameter moves; the margin is for rounding.
const CAPPED: f32 = ALPHA_MAX * (1.0 - 1e-6);

/// What the gradient needs of an ellipse.
struct Shape {
    gaussian: u32,
    center: [f32; 2],
    conic: [f32; 3],
    opacity: f32,
}

/// The walk over one strip of tiles.
struct Pull<'a> {
    values: &'a [f32],
    picture: &'a Picture,
    gradient: &'a [f32],
    /// First pixel of the tile at hand.
    corner: [usize; 2],
    /// Gradient at its pixels, `[channel][row]`; 0 outside the picture.
    slopes: Vec<Row>,
    /// Of its pixels, what the Gaussians not yet met and the light that passes add to `g . picture`.
    rest: [Row; SIZE],
    /// Light that reaches the Gaussian at hand.
    passes: [Row; SIZE],
    /// The ellipse at hand, and its sums lane by lane.
    place: Option<usize>,
    lanes: Vec<Row>,
    moments: [Row; MOMENTS],
    shapes: Vec<Shape>,
    /// `[ellipses][channels]`.
    of_values: Vec<f32>,
    of_screen: Vec<ScreenGradient>,
    of_weight: Vec<f32>,
}

/// Sum of a row's lanes, in halves.
#[inline(always)]
fn sum(row: &Row) -> f32 {
    let mut lanes = *row;
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            lanes[lane] += lanes[lane + half];
        }
    }
    lanes[0]
}

impl Pull<'_> {
    /// Adds the sums of the ellipse at hand to its gradient, and begins anew.
    #[inline(always)]
    fn flush(&mut self) {
        let Some(place) = self.place.take() else {
            return;
        };
        let channels = self.lanes.len();
        let values = &mut self.of_values[place * channels..(place + 1) * channels];
        for (value, lanes) in values.iter_mut().zip(&mut self.lanes) {
            *value += sum(lanes);
            *lanes = [0.0; SIZE];
        }
        let [h, x, y, xx, xy, yy, weight] = std::array::from_fn(|k| sum(&self.moments[k]));
        self.moments = [[0.0; SIZE]; MOMENTS];
        let Shape { conic, opacity, .. } = self.shapes[place];
        let [a, b, c] = conic;
        self.of_weight[place] += weight;
        // alpha = opacity exp(-q / 2), q = a x^2 + 2 b x y + c y^2 at the pixel's offset (x, y) from the centre.
        self.of_screen[place].add(&ScreenGradient {
            center: [a * x + b * y, b * x + c * y],
            conic: [-0.5 * xx, -xy, -0.5 * yy],
            opacity: h / opacity,
        });
    }
}

impl Sink<u32> for Pull<'_> {
    fn begin_strip(&mut self, ellipses: &[Ellipse<u32>]) {
        let shape = |e: &Ellipse<u32>| Shape {
            gaussian: e.payload,
            center: e.center,
            conic: e.conic,
            opacity: e.opacity,
        };
        self.shapes = ellipses.iter().map(shape).collect();
        self.of_values = vec![0.0; ellipses.len() * self.lanes.len()];
        self.of_screen = vec![ScreenGradient::default(); ellipses.len()];
        self.of_weight = vec![0.0; ellipses.len()];
    }

    fn begin_tile(&mut self, left: usize, top: usize) {
        self.corner = [left, top];
        self.passes = [[1.0; SIZE]; SIZE];
        self.rest = [[0.0; SIZE]; SIZE];
        self.slopes.fill([0.0; SIZE]);
        let (width, height) = (self.picture.width, self.picture.height);
        let channels = self.lanes.len();
        let columns = SIZE.min(width - left);
        for row in 0..SIZE.min(height - top) {
            let line = (top + row) * width + left;
            for channel in 0..=channels {
                let at = channel * width * height + line;
                let gradient = &self.gradient[at..at + columns];
                let value = &self.picture.planes[at..at + columns];
                for (lane, (g, v)) in gradient.iter().zip(value).enumerate() {
                    self.rest[row][lane] += g * v;
                }
                if channel < channels {
                    self.slopes[channel * SIZE + row][..columns].copy_from_slice(gradient);
                }
            }
        }
    }

    #[inline(always)]
    fn row(&mut self, place: usize, _: u32, row: usize, weight: &Row) {
        if weight.iter().all(|w| *w == 0.0) {
            return;
        }
        if self.place != Some(place) {
            self.flush();
            self.place = Some(place);
        }
        let shape = &self.shapes[place];
        let channels = self.lanes.len();
        let first = shape.gaussian as usize * channels;
        let values = &self.values[first..first + channels];
        let mut along = [0.0; SIZE];
        for (channel, value) in values.iter().enumerate() {
            let slope = &self.slopes[channel * SIZE + row];
            let sums = &mut self.lanes[channel];
            for lane in 0..SIZE {
                along[lane] += value * slope[lane];
                sums[lane] += weight[lane] * slope[lane];
            }
        }
        let left = self.corner[0] as f32 + 0.5 - shape.center[0];
        let y = (self.corner[1] + row) as f32 + 0.5 - shape.center[1];
        let (passes, rest) = (&mut self.passes[row], &mut self.rest[row]);
        for lane in 0..SIZE {
            let (w, t) = (weight[lane], passes[lane]);
            let seen = w > 0.0;
            let alpha = if seen { w / t } else { 0.0 };
            rest[lane] -= w * along[lane];
            let slope = t * along[lane] - rest[lane] / (1.0 - alpha);
            let moves = seen && alpha < CAPPED;
            let h = if moves { alpha * slope } else { 0.0 };
            passes[lane] = t - w;
            let x = left + lane as f32;
            let moments = [h, h * x, h * y, h * x * x, h * x * y, h * y * y, w];
            for (sum, moment) in self.moments.iter_mut().zip(moments) {
                sum[lane] += moment;
            }
        }
    }

    fn end_tile(&mut self, _: &[Row; SIZE]) {
        self.flush();
    }
}

impl Projection<'_> {
    /// Gradient by position [m], scale [m] and rotation of a Gaussian with these columns of its rotation, from the one by its
    /// ellipse; meaningful where [`Projection::ellipse`] gives one.
    pub fn adjoint(
        &self,
        position: Vec3,
        scale: Vec3,
        axes: Mat3,
        screen: &ScreenGradient,
    ) -> SpatialGradient {
        let camera = self.camera;
        let world_from_camera = camera.world_from_camera.as_dmat3();
        let view = world_from_camera.transpose() * (position - camera.position).as_dvec3();
        let slope = [view.x / view.z, view.y / view.z];
        let [row_x, row_y] = self.linearised(slope.map(|s| s as f32), view.z as f32);
        let (scale, axes) = (scale.as_dvec3(), axes.as_dmat3());
        let half = axes * glam::DMat3::from_diagonal(scale);
        let covariance = half * half.transpose();
        let (along_x, along_y) = (covariance * row_x, covariance * row_y);

        // By the covariance on the screen: d(V^-1) = -V^-1 dV V^-1.
        let low_pass = crate::ellipse::LOW_PASS;
        let [vx, vxy, vy] = [
            row_x.dot(along_x) + low_pass,
            row_y.dot(along_x),
            row_y.dot(along_y) + low_pass,
        ];
        let inverse = 1.0 / (vx * vy - vxy * vxy);
        let (a, b, c) = (vy * inverse, -vxy * inverse, vx * inverse);
        let [ga, gb, gc] = screen.conic.map(f64::from);
        let gb = 0.5 * gb;
        let hx = -(a * (ga * a + gb * b) + b * (gb * a + gc * b));
        let hxy = -(a * (ga * b + gb * c) + b * (gb * b + gc * c));
        let hy = -(b * (ga * b + gb * c) + c * (gb * b + gc * c));

        // By the rows of the projection, and through them by slope and depth.
        let by_x = (along_x * hx + along_y * hxy) * 2.0;
        let by_y = (along_x * hxy + along_y * hy) * 2.0;
        let focal = camera.focal.map(f64::from);
        let forward = world_from_camera.z_axis;
        let mut by_slope = [0, 1].map(|axis| f64::from(screen.center[axis]) * focal[axis]);
        for (axis, by_row) in [by_x, by_y].into_iter().enumerate() {
            if slope[axis].abs() < f64::from(self.slope_limit[axis]) {
                by_slope[axis] -= by_row.dot(forward) * focal[axis] / view.z;
            }
        }
        let by_depth = -(by_x.dot(row_x) + by_y.dot(row_y)) / view.z;
        let by_view = DVec3::new(
            by_slope[0] / view.z,
            by_slope[1] / view.z,
            by_depth - (by_slope[0] * slope[0] + by_slope[1] * slope[1]) / view.z,
        );

        // By the covariance in space, tr(S dSigma), and through it by the axes.
        let apply = |v: DVec3| {
            let (x, y) = (row_x.dot(v), row_y.dot(v));
            row_x * (hx * x + hxy * y) + row_y * (hxy * x + hy * y)
        };
        let mut by_scale = DVec3::ZERO;
        let mut by_rotation = DVec3::ZERO;
        for k in 0..3 {
            let axis = axes.col(k);
            let pulled = apply(axis);
            by_scale[k] = 2.0 * scale[k] * axis.dot(pulled);
            by_rotation += axis.cross(pulled * (2.0 * scale[k] * scale[k]));
        }
        SpatialGradient {
            position: world_from_camera * by_view,
            scale: by_scale,
            rotation: by_rotation,
        }
    }
}
