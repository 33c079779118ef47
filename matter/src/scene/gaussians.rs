//! Activated Gaussians in memory.

/// Gaussians as structure of arrays, activated: linear scales, opacity in 0..=1, unit rotations.
///
/// All vectors have the same length, but for [`sh`](Self::sh) and [`feature`](Self::feature), whose strides
/// are [`sh_stride`](Self::sh_stride) and [`feature_dim`](Self::feature_dim).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Centre, asset units (metres once placed in a scene), shape `[n]`.
    pub position: Vec<[f32; 3]>,
    /// Standard deviation along the local axes, same unit as `position`, > 0.
    pub scale: Vec<[f32; 3]>,
    /// World-from-local unit quaternion, xyzw.
    pub rotation: Vec<[f32; 4]>,
    /// Opacity, 0..=1.
    pub opacity: Vec<f32>,
    /// Spherical-harmonics coefficients, per Gaussian coefficient-major `[(degree+1)^2][rgb]`.
    /// Colour = 0.5 + 0.28209479 * coefficient 0 for degree 0.
    pub sh: Vec<f32>,
    /// Degree of `sh`, 0..=3.
    pub sh_degree: u8,
    /// Semantic feature vectors, `[n][feature_dim]`; empty when the asset carries none.
    pub feature: Vec<f32>,
    /// Length of one semantic feature; 0 when there are none.
    pub feature_dim: u32,
}

impl Gaussians {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Floats of `sh` per Gaussian: 3, 12, 27 or 48.
    pub fn sh_stride(&self) -> usize {
        let bands = usize::from(self.sh_degree) + 1;
        3 * bands * bands
    }
}
