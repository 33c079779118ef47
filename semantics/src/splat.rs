//! What lifting needs of a splat: where its Gaussians are, how they are drawn and how they look.

use cosplat_raster::{Camera, Projection, Splats};
use cosplat_scene::assets::{Gaussians, SH_C0};
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;

/// Gaussians of an asset, in its order and units.
#[derive(Clone, Debug, Default)]
pub struct Splat {
    /// Centres [asset unit].
    pub position: Vec<Vec3>,
    /// Covariances xx xy xz yy yz zz [asset unit^2].
    pub covariance: Vec<[f32; 6]>,
    /// Opacities, 0..=1.
    pub opacity: Vec<f32>,
    /// Colours without view dependence, RGB, 0..=1 for what can be shown.
    pub color: Vec<Vec3>,
    /// Unit axes of least extent; their sign says nothing.
    pub normal: Vec<Vec3>,
}

impl From<&Gaussians> for Splat {
    fn from(g: &Gaussians) -> Self {
        let axes: Vec<(Mat3, Vec3)> = (0..g.len())
            .into_par_iter()
            .map(|n| {
                let turn = Mat3::from_quat(Quat::from_array(g.rotation[n]));
                (turn, Vec3::from_array(g.scale[n]))
            })
            .collect();
        let covariance = |(turn, scale): &(Mat3, Vec3)| {
            let half = *turn * Mat3::from_diagonal(*scale);
            let s = half * half.transpose();
            [
                s.x_axis.x, s.x_axis.y, s.x_axis.z, s.y_axis.y, s.y_axis.z, s.z_axis.z,
            ]
        };
        let normal = |(turn, scale): &(Mat3, Vec3)| {
            let thin = (0..3).min_by(|&a, &b| scale[a].total_cmp(&scale[b]));
            turn.col(thin.unwrap_or(0))
        };
        let stride = g.sh_stride();
        let color = |n: usize| 0.5 + SH_C0 * Vec3::from_slice(&g.sh[n * stride..n * stride + 3]);
        Self {
            position: g.position.iter().copied().map(Vec3::from_array).collect(),
            covariance: axes.iter().map(covariance).collect(),
            opacity: g.opacity.clone(),
            color: (0..g.len()).map(color).collect(),
            normal: axes.iter().map(normal).collect(),
        }
    }
}

impl Splat {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// What shows in `camera`, each Gaussian by its index.
    pub fn project(&self, camera: &Camera) -> Splats<u32> {
        let projection = Projection::new(camera);
        Splats::new(self.len(), camera, |n| {
            projection.ellipse(
                self.position[n].to_array(),
                self.covariance[n],
                self.opacity[n],
                |_| n as u32,
            )
        })
    }

    /// Box of all centres but the outermost hundredth at either end of each axis [asset unit]; the unit cube about the
    /// origin without any.
    pub fn bounds(&self) -> [Vec3; 2] {
        if self.is_empty() {
            return [Vec3::splat(-0.5), Vec3::splat(0.5)];
        }
        let mut corners = [Vec3::ZERO; 2];
        for axis in 0..3 {
            let mut values: Vec<f32> = self.position.iter().map(|p| p[axis]).collect();
            values.sort_unstable_by(f32::total_cmp);
            let cut = values.len() / 100;
            corners[0][axis] = values[cut];
            corners[1][axis] = values[values.len() - 1 - cut];
        }
        corners
    }
}
