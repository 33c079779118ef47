//! EWA projection: from a Gaussian in space to an ellipse in pixels (Zwicker et al. 2001, Kerbl et al. 2023).

use glam::{DVec3, Vec3};

use crate::Camera;

/// Variance added to both axes of every ellipse [pixel^2], so that a splat never slips between pixels.
pub const LOW_PASS: f64 = 0.3;
/// Below this opacity a splat does not count at a pixel: less than one level of 255.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Opacity of one splat at a pixel is capped here, as in the training of splats.
pub const ALPHA_MAX: f32 = 0.99;
/// The slope of the projection is frozen this far outside the picture (in half widths): linearised further out, it
/// would smear splats over the picture.
const SLOPE_LIMIT: f32 = 1.3;

/// A Gaussian as the rasteriser blends it, with what its user needs of it: a colour, an index.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse<T> {
    /// Centre [pixel].
    pub center: [f32; 2],
    /// Inverse covariance xx xy yy [1/pixel^2].
    pub conic: [f32; 3],
    /// Half extents of the region where the opacity is at least [`ALPHA_MIN`] [pixel].
    pub reach: [f32; 2],
    /// Squared Mahalanobis radius of that region.
    pub cutoff: f32,
    /// Opacity at the centre, 0..=1.
    pub opacity: f32,
    /// Distance along the view axis [m].
    pub depth: f32,
    /// What the user of the weights needs.
    pub payload: T,
}

/// Per-picture constants of the projection.
pub struct Projection<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) slope_limit: [f32; 2],
}

impl<'a> Projection<'a> {
    /// Projection into `camera`.
    pub fn new(camera: &'a Camera) -> Self {
        let limit = |axis: usize, size: u32| {
            let center = camera.center[axis];
            SLOPE_LIMIT * center.max(size as f32 - center) / camera.focal[axis]
        };
        Self {
            camera,
            slope_limit: [limit(0, camera.width), limit(1, camera.height)],
        }
    }

    /// The ellipse of a Gaussian at `position` [m], of `covariance` xx xy xz yy yz zz [m^2] and `opacity` 0..=1, with the
    /// payload that `payload` makes of its offset from the camera [m].
    ///
    /// `None` when nothing of it shows: behind the near plane, outside the picture, transparent, not finite, or of a
    /// covariance that is not positive.
    pub fn ellipse<T>(
        &self,
        position: [f32; 3],
        covariance: [f32; 6],
        opacity: f32,
        payload: impl FnOnce(Vec3) -> T,
    ) -> Option<Ellipse<T>> {
        let camera = self.camera;
        if opacity.is_nan() || opacity <= ALPHA_MIN {
            return None;
        }
        // Squared radius at which opacity * exp(-r^2 / 2) falls to ALPHA_MIN.
        let cutoff = 2.0 * (opacity / ALPHA_MIN).ln();
        let offset = Vec3::from_array(position) - camera.position;
        let view = camera.world_from_camera.transpose() * offset;
        // Written so that a NaN depth is left out, too.
        if !(view.z >= camera.near && view.z.is_finite()) {
            return None;
        }
        let (slope_x, slope_y) = (view.x / view.z, view.y / view.z);
        let center = [
            camera.center[0] + camera.focal[0] * slope_x,
            camera.center[1] + camera.focal[1] * slope_y,
        ];

        let rows = self.linearised([slope_x, slope_y], view.z);
        let [variance_x, covariance, variance_y] = on_screen(covariance, rows)?;
        let determinant = variance_x * variance_y - covariance * covariance;
        if !(variance_x > 0.0 && variance_y > 0.0 && determinant > 0.0 && determinant.is_finite()) {
            return None;
        }
        let reach = [
            (f64::from(cutoff) * variance_x).sqrt() as f32,
            (f64::from(cutoff) * variance_y).sqrt() as f32,
        ];
        let inside = |axis: usize, size: u32| {
            center[axis] + reach[axis] >= 0.0 && center[axis] - reach[axis] <= size as f32
        };
        if !(inside(0, camera.width) && inside(1, camera.height)) {
            return None;
        }
        let conic = [
            (variance_y / determinant) as f32,
            (-covariance / determinant) as f32,
            (variance_x / determinant) as f32,
        ];
        // A conic this flat or this far away has left the range of f32.
        if !(conic[0] > 0.0 && conic[2] > 0.0 && reach[0].is_finite() && reach[1].is_finite()) {
            return None;
        }
        Some(Ellipse {
            center,
            conic,
            reach,
            cutoff,
            opacity,
            depth: view.z,
            payload: payload(offset),
        })
    }

    /// Rows of (pixel from camera) * (camera from world) for what is seen along these slopes at this depth. In double
    /// precision, because the thin axis of a wide splat is a small difference of large numbers.
    #[inline]
    pub(crate) fn linearised(&self, [slope_x, slope_y]: [f32; 2], depth: f32) -> [DVec3; 2] {
        // `max` and `min`, because `clamp` panics when a broken camera makes the limits NaN.
        let [limit_x, limit_y] = self.slope_limit;
        let world_from_camera = &self.camera.world_from_camera;
        let [right, down, forward] = [
            world_from_camera.x_axis.as_dvec3(),
            world_from_camera.y_axis.as_dvec3(),
            world_from_camera.z_axis.as_dvec3(),
        ];
        let scale = self.camera.focal.map(|f| f64::from(f) / f64::from(depth));
        [
            (right - forward * f64::from(slope_x.max(-limit_x).min(limit_x))) * scale[0],
            (down - forward * f64::from(slope_y.max(-limit_y).min(limit_y))) * scale[1],
        ]
    }
}

/// A covariance xx xy xz yy yz zz as the rows of a projection show it, xx xy yy [pixel^2], widened by [`LOW_PASS`]; `None`
/// where it is the covariance of no Gaussian.
#[inline]
fn on_screen(covariance: [f32; 6], [row_x, row_y]: [DVec3; 2]) -> Option<[f64; 3]> {
    let [xx, xy, xz, yy, yz, zz] = covariance.map(f64::from);
    // Correlations above 1 belong to no Gaussian, even where their projection looks like one. The margin is for the
    // rounding of thin shapes to f32; written so that NaN is left out, too.
    let correlates = |a: f64, b: f64, ab: f64| a >= 0.0 && b >= 0.0 && ab * ab <= 1.0001 * a * b;
    if !(correlates(xx, yy, xy) && correlates(xx, zz, xz) && correlates(yy, zz, yz)) {
        return None;
    }
    let apply = |v: DVec3| {
        DVec3::new(
            xx * v.x + xy * v.y + xz * v.z,
            xy * v.x + yy * v.y + yz * v.z,
            xz * v.x + yz * v.y + zz * v.z,
        )
    };
    let (along_x, along_y) = (apply(row_x), apply(row_y));
    Some([
        row_x.dot(along_x) + LOW_PASS,
        row_y.dot(along_x),
        row_y.dot(along_y) + LOW_PASS,
    ])
}

impl<T> Ellipse<T> {
    /// Smallest and largest x [pixel] that the ellipse reaches between the lines `low` and `high` [pixel]; `None` when
    /// it does not come that far.
    pub fn span(&self, low: f32, high: f32) -> Option<[f32; 2]> {
        let [a, b, c] = self.conic;
        let (low, high) = (low - self.center[1], high - self.center[1]);
        if low > self.reach[1] || high < -self.reach[1] {
            return None;
        }
        // Line at which the ellipse is widest to the right; to the left it is the opposite one.
        let widest = -self.reach[0] * b / c;
        let half = |y: f32| {
            let height = y / self.reach[1];
            (self.cutoff * (1.0 - height * height) / a).max(0.0).sqrt()
        };
        let (left, right) = ((-widest).max(low).min(high), widest.max(low).min(high));
        Some([
            self.center[0] + -b * left / a - half(left),
            self.center[0] + -b * right / a + half(right),
        ])
    }
}
