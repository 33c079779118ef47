//! Shade on what stands still, below what moves: so that what rests looks as if it rests.
//!
//! Light comes from above, from all over the sky. What moves is counted into layers of cells, by the area that it covers seen
//! from above. Layer by layer downwards the cover fades, as more and more of the sky is seen past it, and spreads. It is the
//! shade of a picture, not of a lamp: no light is traced.

use cosplat_ipc::schema::GaussianState;
use glam::Vec3;

use crate::camera::up_from_gravity;
use crate::drawing::Scene;

/// Cells along the longer side.
const CELLS: usize = 160;
/// Layers at most.
const LAYERS: usize = 64;
/// Height over which cover fades to its e-th part, of the size of what moves at first.
const FADING: f32 = 0.06;
/// Layers per such height.
const LAYERS_PER_FADING: f32 = 4.0;
/// What is left of the light at the darkest places.
const DARKEST: f32 = 0.4;
/// Share of a cell's cover that each of its four neighbours has in the layer below.
const SPREADING: f32 = 0.15;

/// How what moves shades a frame.
pub(crate) struct Shade {
    /// Right, forward and up.
    axes: [Vec3; 3],
    /// Lowest corner, along the axes [m].
    low: Vec3,
    /// Side of a cell, and height of a layer [m].
    cell: f32,
    layer: f32,
    /// Cells along each axis.
    size: [usize; 3],
    /// Cover `[layer][forward][right]`, what comes from above it included.
    cover: Vec<f32>,
    /// By object id.
    stands_still: Vec<bool>,
}

impl Shade {
    /// The shade of a frame of `scene`.
    pub fn new(gaussians: &[GaussianState], scene: &Scene) -> Self {
        let up = up_from_gravity(scene.header.gravity);
        let right = up.any_orthonormal_vector();
        let last = scene.objects.iter().map(|info| info.id).max();
        let mut stands_still = vec![false; last.map_or(0, |id| id as usize + 1)];
        for info in &scene.objects {
            stands_still[info.id as usize] = info.fidelity == 1;
        }
        let [low, high] = [scene.header.bounds_min, scene.header.bounds_max].map(Vec3::from);
        let fading = (FADING * (high - low).length()).max(f32::MIN_POSITIVE);
        let mut shade = Self {
            axes: [right, up.cross(right), up],
            low: Vec3::ZERO,
            cell: 1.0,
            layer: fading / LAYERS_PER_FADING,
            size: [1; 3],
            cover: Vec::new(),
            stands_still,
        };
        shade.fit(gaussians, fading);
        shade.count(gaussians);
        shade.spread();
        shade
    }

    fn moves(&self, gaussian: &GaussianState) -> bool {
        let still = self.stands_still.get(gaussian.object as usize);
        still == Some(&false) && Vec3::from(gaussian.position).is_finite()
    }

    fn along_axes(&self, gaussian: &GaussianState) -> Vec3 {
        let position = Vec3::from(gaussian.position);
        Vec3::from(self.axes.map(|axis| axis.dot(position)))
    }

    /// Lays the cells around what moves, down to where its cover has faded.
    fn fit(&mut self, gaussians: &[GaussianState], fading: f32) {
        let places = gaussians.iter().filter(|g| self.moves(g));
        let ends = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let [low, high] = places
            .map(|g| self.along_axes(g))
            .fold(ends, |[low, high], p| [low.min(p), high.max(p)]);
        if !(high - low).is_finite() {
            return;
        }
        let margin = Vec3::new(2.0, 2.0, 3.0) * fading;
        self.low = low - margin;
        let extent = high + Vec3::new(margin.x, margin.y, 0.0) - self.low;
        self.cell = (extent.x.max(extent.y) / CELLS as f32).max(f32::MIN_POSITIVE);
        self.layer = self.layer.max(extent.z / LAYERS as f32);
        let counts = extent / Vec3::new(self.cell, self.cell, self.layer);
        self.size = counts.to_array().map(|count| count as usize + 1);
    }

    /// The place among the cells of a point along the axes, and its cell where it is within them.
    fn cell_of(&self, place: Vec3) -> Option<usize> {
        let cell = (place - self.low) / Vec3::new(self.cell, self.cell, self.layer);
        let [x, y, z] = cell.floor().to_array();
        let within = |value: f32, count: usize| value >= 0.0 && value < count as f32;
        let [columns, rows, layers] = self.size;
        (within(x, columns) && within(y, rows) && within(z, layers))
            .then(|| (z as usize * rows + y as usize) * columns + x as usize)
    }

    fn count(&mut self, gaussians: &[GaussianState]) {
        let mut cover = vec![0.0; self.size.iter().product()];
        let [right, forward, _] = self.axes;
        for gaussian in gaussians.iter().filter(|g| self.moves(g)) {
            let [xx, xy, xz, yy, yz, zz] = gaussian.covariance;
            let times = |v: Vec3| {
                Vec3::new(
                    xx * v.x + xy * v.y + xz * v.z,
                    xy * v.x + yy * v.y + yz * v.z,
                    xz * v.x + yz * v.y + zz * v.z,
                )
            };
            let (a, b) = (times(right), times(forward));
            let squared = right.dot(a) * forward.dot(b) - right.dot(b) * forward.dot(a);
            // The integral of a Gaussian seen from above.
            let area = std::f32::consts::TAU * squared.max(0.0).sqrt();
            let opacity = f32::from(gaussian.color[3]) / 255.0;
            let share = opacity * area / (self.cell * self.cell);
            if let Some(cell) = self.cell_of(self.along_axes(gaussian))
                && share.is_finite()
            {
                cover[cell] += share;
            }
        }
        self.cover = cover;
    }

    /// Lets cover fade and spread downwards.
    fn spread(&mut self) {
        let [columns, rows, layers] = self.size;
        let count = columns * rows;
        let kept = (-1.0 / LAYERS_PER_FADING).exp();
        for layer in (1..layers).rev() {
            let (below, above) = self.cover.split_at_mut(layer * count);
            let (below, above) = (&mut below[(layer - 1) * count..], &above[..count]);
            let at = |x: usize, y: usize| above[y * columns + x];
            for y in 0..rows {
                for x in 0..columns {
                    let beside = at(x.saturating_sub(1), y)
                        + at((x + 1).min(columns - 1), y)
                        + at(x, y.saturating_sub(1))
                        + at(x, (y + 1).min(rows - 1));
                    let own = (1.0 - 4.0 * SPREADING) * at(x, y);
                    below[y * columns + x] += kept * (own + SPREADING * beside);
                }
            }
        }
    }

    /// What of the light reaches a Gaussian.
    pub fn light(&self, gaussian: &GaussianState) -> f32 {
        let still = self.stands_still.get(gaussian.object as usize);
        if still != Some(&true) {
            return 1.0;
        }
        // One layer up: what is beside it in its own layer does not cover it.
        let place = self.along_axes(gaussian) + Vec3::new(0.0, 0.0, self.layer);
        let cover = self.cell_of(place).map_or(0.0, |cell| self.cover[cell]);
        DARKEST + (1.0 - DARKEST) * (-cover).exp()
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use cosplat_ipc::schema::{ObjectInfo, SceneHeader};

    use super::*;

    fn scene() -> Scene {
        let object = |id, fidelity| ObjectInfo {
            id,
            fidelity,
            ..ObjectInfo::zeroed()
        };
        Scene {
            header: SceneHeader {
                gravity: [0.0, 0.0, -9.81],
                bounds_min: [-0.5; 3],
                bounds_max: [0.5; 3],
                ..SceneHeader::default()
            },
            objects: vec![object(0, 1), object(1, 2)],
            sh: Vec::new(),
        }
    }

    fn gaussian(object: u32, position: [f32; 3]) -> GaussianState {
        let variance = 0.01;
        GaussianState {
            position,
            object,
            color: [255; 4],
            covariance: [variance, 0.0, 0.0, variance, 0.0, variance],
            ..GaussianState::default()
        }
    }

    /// A block of 0.4 m that hovers at a height.
    fn block(height: f32) -> Vec<GaussianState> {
        let along = |n: usize| n as f32 * 0.02 - 0.2;
        let bottom = (0..400).map(|n| [along(n % 20), along(n / 20), height]);
        bottom.map(|p| gaussian(1, p)).collect()
    }

    #[test]
    fn the_ground_is_dark_below_what_rests_and_light_beside_it() {
        let light = |height: f32, place: [f32; 3]| {
            Shade::new(&block(height), &scene()).light(&gaussian(0, place))
        };
        let ground = [0.0, 0.0, -0.01];
        let resting = light(0.01, ground);
        assert!(resting < 0.45, "{resting}");
        // It gets lighter as the block rises, and is as if nothing were there in the end.
        let heights = [0.01, 0.5, 0.8, 3.0].map(|height| light(height, ground));
        assert!(heights.is_sorted() && heights[3] == 1.0, "{heights:?}");
        assert_eq!(light(0.01, [2.0, 0.0, 0.0]), 1.0);
        assert_eq!(light(0.01, [0.0, 0.0, 0.5]), 1.0, "above it");
    }

    #[test]
    fn what_moves_is_as_it_was_and_nonsense_is_left_out() {
        let mut gaussians = block(0.1);
        gaussians.push(gaussian(1, [f32::NAN; 3]));
        gaussians.push(gaussian(7, [0.0; 3]));
        gaussians[3].covariance = [f32::INFINITY; 6];
        let shade = Shade::new(&gaussians, &scene());
        assert!(gaussians.iter().all(|g| shade.light(g) == 1.0));
        let light = shade.light(&gaussian(0, [0.0; 3]));
        assert!((DARKEST..1.0).contains(&light), "{light}");
        let empty = Shade::new(&[], &scene());
        assert_eq!(empty.light(&gaussian(0, [0.0; 3])), 1.0);
    }
}
