//! What refinement changes of a splat, and how gradients of a view move it.

use cosplat_raster::{Adjoint, Camera, Harmonics, Picture, Projection, Splats, adjoint, composite};
use cosplat_scene::assets::{Gaussians, SH_C0};
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;

/// Parameters of a Gaussian but its feature: position, logarithm of scale, small rotation, logit of opacity, colour.
const GEOMETRY: usize = 13;
/// Moments of Adam (Kingma and Ba 2015), as in the training of splats.
const BETA: [f32; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-15;
/// Opacities stay off the ends, where the logit has no slope.
const OPACITY: [f32; 2] = [1e-4, 0.9999];

/// Steps of the parameters per update: of the position [asset unit], of the others without unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rates {
    pub position: f32,
    pub scale: f32,
    pub rotation: f32,
    pub opacity: f32,
    pub color: f32,
    pub feature: f32,
}

impl Rates {
    /// These over the extent of the cameras, after some decay.
    pub fn at(&self, decay: f32, extent: f32) -> Self {
        Self {
            position: self.position * decay * extent,
            scale: self.scale * decay,
            rotation: self.rotation * decay,
            opacity: self.opacity * decay,
            color: self.color * decay,
            feature: self.feature * decay,
        }
    }

    /// The rate of one parameter of a row.
    fn of(&self, k: usize) -> f32 {
        match k {
            0..3 => self.position,
            3..6 => self.scale,
            6..9 => self.rotation,
            9 => self.opacity,
            10..13 => self.color,
            _ => self.feature,
        }
    }
}

/// A splat with a feature for every Gaussian.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub gaussians: Gaussians,
    /// Values per feature.
    pub channels: usize,
    /// `[gaussians][channels]`.
    pub feature: Vec<f32>,
    /// Where refinement draws the features to: the closed form, in the same layout.
    pub prior: Vec<f32>,
}

/// What Adam keeps, `[gaussians][GEOMETRY + channels]`.
#[derive(Clone, Debug, Default)]
pub(super) struct Moments {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: i32,
}

/// A view of a model: what it shows, and what its gradients need.
pub(super) struct Drawn {
    pub splats: Splats<u32>,
    /// `[gaussians][3 + channels]`: colour in this direction, feature.
    pub values: Vec<f32>,
    pub picture: Picture,
}

impl Model {
    pub fn len(&self) -> usize {
        self.gaussians.len()
    }

    pub fn position(&self, n: usize) -> Vec3 {
        Vec3::from_array(self.gaussians.position[n])
    }

    /// Rotation and standard deviations of a Gaussian.
    pub fn shape(&self, n: usize) -> (Mat3, Vec3) {
        let turn = Mat3::from_quat(Quat::from_array(self.gaussians.rotation[n]));
        (turn, Vec3::from_array(self.gaussians.scale[n]))
    }

    /// What shows in a camera.
    pub fn splats(&self, camera: &Camera) -> Splats<u32> {
        let projection = Projection::new(camera);
        Splats::new(self.len(), camera, |n| {
            let (turn, scale) = self.shape(n);
            let half = turn * Mat3::from_diagonal(scale);
            let s = half * half.transpose();
            let covariance = [
                s.x_axis.x, s.x_axis.y, s.x_axis.z, s.y_axis.y, s.y_axis.z, s.z_axis.z,
            ];
            let g = &self.gaussians;
            projection.ellipse(g.position[n], covariance, g.opacity[n], |_| n as u32)
        })
    }

    /// Colours and features composited in a camera.
    pub fn draw(&self, camera: &Camera) -> Drawn {
        let splats = self.splats(camera);
        let channels = 3 + self.channels;
        let mut values = vec![0.0; self.len() * channels];
        let sh = Harmonics::new(self.gaussians.sh_degree.into(), &self.gaussians.sh);
        let rows = values.par_chunks_mut(channels).enumerate();
        rows.for_each(|(n, row)| {
            let direction = (self.position(n) - camera.position).normalize_or_zero();
            let color = sh.and_then(|sh| sh.color(n as u32, direction, [0.0, 0.0, 0.0, 1.0]));
            row[..3].copy_from_slice(&color.unwrap_or_default().to_array());
            row[3..].copy_from_slice(&self.feature[n * self.channels..(n + 1) * self.channels]);
        });
        let picture = composite(&splats, &values, channels);
        Drawn {
            splats,
            values,
            picture,
        }
    }

    /// Sums of weight times what `planes`, `[channels][height][width]`, say at a pixel: `[gaussians][channels]`, and of the
    /// weight alone.
    pub fn gather(&self, camera: &Camera, planes: &[f32], channels: usize) -> Adjoint {
        let splats = self.splats(camera);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut gradient = planes.to_vec();
        gradient.resize((channels + 1) * width * height, 0.0);
        let picture = Picture {
            width,
            height,
            channels,
            planes: vec![0.0; gradient.len()],
        };
        let values = vec![0.0; self.len() * channels];
        adjoint(&splats, self.len(), &values, &picture, &gradient)
    }

    /// Gradient by the parameters, `[gaussians][GEOMETRY + channels]`, from the one by the planes of what was drawn. That of
    /// the features reaches the features alone: masks that are off by some pixels must not move matter.
    pub fn gradient(&self, camera: &Camera, mut drawn: Drawn, planes: &[f32]) -> Vec<f32> {
        let pixels = drawn.picture.width * drawn.picture.height;
        // Features of 0 add nothing to what opacities and ellipses are moved by.
        drawn.picture.planes[3 * pixels..(3 + self.channels) * pixels].fill(0.0);
        let rows = drawn.values.par_chunks_mut(3 + self.channels);
        rows.for_each(|row| row[3..].fill(0.0));
        let Drawn {
            splats,
            values,
            picture,
        } = &drawn;
        let found = adjoint(splats, self.len(), values, picture, planes);
        let projection = Projection::new(camera);
        let (of_values, of_row) = (3 + self.channels, GEOMETRY + self.channels);
        let mut gradient = vec![0.0; self.len() * of_row];
        let rows = gradient.par_chunks_mut(of_row).enumerate();
        rows.for_each(|(n, row)| {
            if found.weight[n] == 0.0 {
                return;
            }
            let (turn, scale) = self.shape(n);
            let screen = &found.screen[n];
            let spatial = projection.adjoint(self.position(n), scale, turn, screen);
            let by_scale = spatial.scale.as_vec3() * scale;
            row[..3].copy_from_slice(&spatial.position.as_vec3().to_array());
            row[3..6].copy_from_slice(&by_scale.to_array());
            row[6..9].copy_from_slice(&spatial.rotation.as_vec3().to_array());
            let opacity = self.gaussians.opacity[n];
            row[9] = screen.opacity * opacity * (1.0 - opacity);
            let by_values = &found.values[n * of_values..(n + 1) * of_values];
            for channel in 0..3 {
                // A colour below 0 is shown as 0.
                let shown = values[n * of_values + channel] > 0.0;
                row[10 + channel] = if shown {
                    SH_C0 * by_values[channel]
                } else {
                    0.0
                };
            }
            row[GEOMETRY..].copy_from_slice(&by_values[3..]);
            if row.iter().any(|g| !g.is_finite()) {
                row.fill(0.0);
            }
        });
        gradient
    }

    /// One step of Adam against `gradient`. A feature is drawn to its prior by `pull` times the difference, where the
    /// Gaussian has a gradient at all.
    pub fn step(&mut self, moments: &mut Moments, gradient: &[f32], rates: &Rates, pull: f32) {
        let stride = GEOMETRY + self.channels;
        moments.first.resize(gradient.len(), 0.0);
        moments.second.resize(gradient.len(), 0.0);
        moments.steps += 1;
        let unbiased = BETA.map(|b| 1.0 / (1.0 - b.powi(moments.steps)));
        let mut change = vec![0.0; gradient.len()];
        let rows = change
            .par_chunks_mut(stride)
            .zip(gradient.par_chunks(stride));
        let kept = moments.first.par_chunks_mut(stride);
        let kept = kept.zip(moments.second.par_chunks_mut(stride));
        let features = self.feature.par_chunks(self.channels.max(1));
        let features = features.zip(self.prior.par_chunks(self.channels.max(1)));
        rows.zip(kept).zip(features).for_each(
            |(((change, gradient), (first, second)), (feature, prior))| {
                let seen = gradient.iter().any(|g| *g != 0.0);
                for k in 0..stride {
                    let mut g = gradient[k];
                    if seen && k >= GEOMETRY {
                        g += pull * (feature[k - GEOMETRY] - prior[k - GEOMETRY]);
                    }
                    first[k] += (1.0 - BETA[0]) * (g - first[k]);
                    second[k] += (1.0 - BETA[1]) * (g * g - second[k]);
                    let size = (second[k] * unbiased[1]).sqrt() + EPSILON;
                    change[k] = -rates.of(k) * first[k] * unbiased[0] / size;
                }
            },
        );
        self.apply(&change);
    }

    fn apply(&mut self, change: &[f32]) {
        let sh_stride = self.gaussians.sh_stride();
        let channels = self.channels;
        let g = &mut self.gaussians;
        for (n, row) in change.chunks(GEOMETRY + channels).enumerate() {
            for axis in 0..3 {
                g.position[n][axis] += row[axis];
                // A logarithm of hundreds is no splat any more.
                let scale = g.scale[n][axis] * row[3 + axis].clamp(-1.0, 1.0).exp();
                g.scale[n][axis] = scale.max(f32::MIN_POSITIVE);
                g.sh[n * sh_stride + axis] += row[10 + axis];
            }
            let turn = Vec3::from_slice(&row[6..9]);
            if turn != Vec3::ZERO {
                let turned = Quat::from_scaled_axis(turn) * Quat::from_array(g.rotation[n]);
                g.rotation[n] = turned.normalize().to_array();
            }
            let opacity = g.opacity[n].clamp(OPACITY[0], OPACITY[1]);
            let logit = (opacity / (1.0 - opacity)).ln() + row[9];
            if row[9] != 0.0 {
                g.opacity[n] = (1.0 / (1.0 + (-logit).exp())).clamp(OPACITY[0], OPACITY[1]);
            }
            let feature = &mut self.feature[n * channels..(n + 1) * channels];
            for (value, change) in feature.iter_mut().zip(&row[GEOMETRY..]) {
                *value += change;
            }
        }
    }
}
