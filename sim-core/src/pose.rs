//! How Gaussians follow the particles: once per published frame, written where the caller wants them.

mod lanes;

use rayon::prelude::*;

use crate::{
    mat3::Mat3,
    materials::svd::svd,
    num::Real,
    scene::{Fidelity, Scene},
    simd::{F32x16, Isa, LANES},
};
use lanes::{RestGroup, follow};

/// Largest ratio of principal stretches that a Gaussian's shape follows; beyond it, it would become a needle.
pub const MAX_ASPECT: f32 = 30.0;
/// Groups per task.
const TASK: usize = 64;
/// Particles per task.
const CHUNK: usize = 1024;

/// One Gaussian in motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianPose {
    /// Centre [m], world frame.
    pub position: [f32; 3],
    /// Covariance xx xy xz yy yz zz [m^2], world frame.
    pub covariance: [f32; 6],
    /// World-from-asset rotation, unit quaternion xyzw.
    pub rotation: [f32; 4],
}

/// Everything about a scene's Gaussians that does not change from frame to frame.
#[derive(Clone, Debug)]
pub struct Poses {
    isa: Isa,
    groups: Vec<RestGroup>,
    /// Pose at rest, and whether the Gaussian ever leaves it.
    rest: Vec<(GaussianPose, bool)>,
    /// Rest position of every particle relative to its object's anchor [m]: what is interpolated stays small,
    /// and keeps its digits far from the origin.
    particle_offset: Vec<[f32; 3]>,
}

impl Poses {
    /// Prepares a scene, for the best instruction set of this processor.
    pub fn new(scene: &Scene) -> Poses {
        Poses::with_isa(scene, Isa::detect())
    }

    /// Like [`new`](Self::new) on a chosen instruction set that the processor has; results are the same.
    fn with_isa(scene: &Scene, isa: Isa) -> Poses {
        let count = scene.gaussians.len();
        let mut poses = Poses {
            isa,
            groups: vec![RestGroup::EMPTY; count.div_ceil(LANES)],
            rest: vec![Default::default(); count],
            particle_offset: vec![[0.0; 3]; scene.particles.position.len()],
        };
        for object in &scene.objects {
            let positions = &scene.particles.position[object.particles.clone()];
            let anchor = mean(positions);
            for p in object.particles.clone() {
                let x = scene.particles.position[p];
                poses.particle_offset[p] = [0, 1, 2].map(|a| (x[a] - anchor[a]) as f32);
            }
            let moves = object.fidelity != Fidelity::Static && !positions.is_empty();
            for g in object.gaussians.clone() {
                poses.set_rest(scene, g, anchor, object.world_from_asset, moves);
            }
        }
        poses
    }

    fn set_rest(
        &mut self,
        scene: &Scene,
        g: usize,
        anchor: [f64; 3],
        world_from_asset: [f32; 4],
        moves: bool,
    ) {
        let gaussians = &scene.gaussians;
        let r = Mat3::from_quaternion(gaussians.rotation[g]);
        let axes = r.mul(&Mat3::diagonal(gaussians.scale[g]));
        let position = gaussians.position[g];
        let (group, lane) = (&mut self.groups[g / LANES], g % LANES);
        for a in 0..3 {
            group.offset[a].0[lane] = (f64::from(position[a]) - anchor[a]) as f32;
        }
        for (vector, value) in group.axes.iter_mut().zip(axes.0.as_flattened()) {
            vector.0[lane] = *value;
        }
        for (vector, value) in group.placement.iter_mut().zip(world_from_asset) {
            vector.0[lane] = value;
        }
        if moves {
            group.particle[lane] = scene.binding.particle[g];
            group.weight[lane] = scene.binding.weight[g];
        }
        let pose = GaussianPose {
            position,
            covariance: axes.mul_transposed_sym(&axes),
            rotation: world_from_asset,
        };
        self.rest[g] = (pose, moves);
    }

    /// Writes every Gaussian, made by `make` from its index and pose, into its place in `out`.
    ///
    /// `position` [m] and `deformation` (row-major `F`) are those of the particles in scene order. Runs on the
    /// current rayon pool; the result does not depend on it. Slots of `out` beyond the scene's Gaussians are
    /// left alone.
    ///
    /// Centre `sum w (x_p + F_p (X - X_p))`, `F = sum w F_p`, covariance `F Sigma0 F^T` with the stretches of `F`
    /// limited to [`MAX_ASPECT`], rotation `polar(F) world_from_asset`.
    pub fn write<T: Send>(
        &self,
        position: &[[f32; 3]],
        deformation: &[[f32; 9]],
        out: &mut [T],
        make: impl Fn(usize, &GaussianPose) -> T + Sync,
    ) {
        let carriers: Vec<F32x16> = self
            .particle_offset
            .par_iter()
            .zip(position)
            .zip(deformation)
            .with_min_len(CHUNK)
            .map(|((offset, x), f)| carrier(offset, x, f))
            .collect();
        out.par_chunks_mut(LANES)
            .zip(self.rest.par_chunks(LANES))
            .zip(&self.groups)
            .with_min_len(TASK)
            .enumerate()
            .for_each(|(index, ((out, rest), group))| {
                let mut poses = [GaussianPose::default(); LANES];
                if rest.iter().any(|(_, moves)| *moves) {
                    follow(self.isa, group, &carriers, &mut poses);
                }
                for (lane, (slot, (at_rest, moves))) in out.iter_mut().zip(rest).enumerate() {
                    let pose = if *moves { &poses[lane] } else { at_rest };
                    *slot = make(LANES * index + lane, pose);
                }
            });
    }
}

fn mean(positions: &[[f64; 3]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for x in positions {
        for a in 0..3 {
            sum[a] += x[a];
        }
    }
    sum.map(|s| s / positions.len().max(1) as f64)
}

/// A particle's share in the Gaussians that follow it: `x_p - F_p X_p`, then `F_p`.
fn carrier(offset: &[f32; 3], x: &[f32; 3], f: &[f32; 9]) -> F32x16 {
    let mut out = [0.0; LANES];
    for a in 0..3 {
        let moved = f[3 * a] * offset[0] + f[3 * a + 1] * offset[1] + f[3 * a + 2] * offset[2];
        out[a] = x[a] - moved;
    }
    out[3..12].copy_from_slice(f);
    F32x16(out)
}

/// Rotation of `f`, and `f` with its stretches limited to [`MAX_ASPECT`].
fn limited(f: &Mat3<f32>) -> (Mat3<f32>, Mat3<f32>) {
    let parts = svd(f);
    let largest = parts.sigma[0];
    let fine = largest.is_finite() && largest > 0.0;
    if !fine {
        return (Mat3::identity(), Mat3::identity());
    }
    // The smallest stretch is taken as it comes, in both directions of the middle one.
    let middle = parts.sigma[1].abs();
    let span = MAX_ASPECT.sqrt();
    let center = (largest * parts.sigma[2].abs().max(largest / MAX_ASPECT.powi(2))).sqrt();
    let (low, high) = (center / span, center * span);
    let sigma = [largest, middle, parts.sigma[2].abs()].map(|s| s.clamp(low, high));
    let shape = parts.u.mul(&Mat3::diagonal(sigma)).mul_transposed(&parts.v);
    (parts.u.mul_transposed(&parts.v), shape)
}

/// Quaternion of a rotation matrix: the form with the largest divisor of four equivalent ones (Shepperd 1978).
#[inline(always)]
fn quaternion_from_matrix<R: Real>(m: &Mat3<R>) -> [R; 4] {
    let [[a, b, c], [d, e, f], [g, h, i]] = m.0;
    let one = R::splat(1.0);
    let by_w = [h - f, c - g, d - b, one + a + e + i];
    let by_x = [one + a - e - i, b + d, c + g, h - f];
    let by_y = [b + d, one + e - a - i, f + h, c - g];
    let by_z = [c + g, f + h, one + i - a - e, d - b];
    let mut q = by_w;
    let mut largest = by_w[3];
    (q, largest) = larger(q, largest, by_x, by_x[0]);
    (q, largest) = larger(q, largest, by_y, by_y[1]);
    (q, _) = larger(q, largest, by_z, by_z[2]);
    let norm_squared = q[3].mul_add(q[3], q[2].mul_add(q[2], q[1].mul_add(q[1], q[0] * q[0])));
    let scale = one / norm_squared.sqrt();
    [q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale]
}

/// The quaternion with the larger measure, and that measure.
#[inline(always)]
fn larger<R: Real>(q: [R; 4], measure: R, other: [R; 4], its: R) -> ([R; 4], R) {
    let better = measure.lt(its);
    (
        [
            R::select(better, other[0], q[0]),
            R::select(better, other[1], q[1]),
            R::select(better, other[2], q[2]),
            R::select(better, other[3], q[3]),
        ],
        measure.max(its),
    )
}

/// Product of quaternions: first `b`, then `a`.
#[inline(always)]
fn multiply<R: Real>([ax, ay, az, aw]: [R; 4], [bx, by, bz, bw]: [R; 4]) -> [R; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

#[cfg(test)]
mod tests;
