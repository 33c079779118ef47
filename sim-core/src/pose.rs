//! How Gaussians follow the particles: once per published frame, written where the caller wants them.

mod lanes;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use crate::{
    mat3::Mat3,
    materials::svd::svd,
    num::Real,
    scene::{Fidelity, Scene},
    simd::{F32x16, Isa, LANES},
};
use lanes::{RestGroup, Shared, follow};

/// Largest ratio of principal stretches that a Gaussian's shape follows; beyond it, it would become a needle.
pub const MAX_ASPECT: f32 = 30.0;
/// Groups per task.
const TASK: usize = 64;
/// Particles per task.
const CHUNK: usize = 1024;
/// Bytes of a frame from which on it is written past the caches. Nobody reads a large frame before the solver needs its
/// caches again, and a slot is too old to be in them: without this, all of it is read before it is written.
const STREAMED: usize = 1 << 20;

/// One Gaussian in motion, in a cache line that has room for three labels of the caller's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct GaussianPose {
    /// Centre [m], world frame.
    pub position: [f32; 3],
    /// First of the labels given to [`Poses::new`].
    pub label: u32,
    /// Covariance xx xy xz yy yz zz [m^2], world frame.
    pub covariance: [f32; 6],
    /// The other labels.
    pub labels: [u32; 2],
    /// World-from-asset rotation, unit quaternion xyzw.
    pub rotation: [f32; 4],
}

/// Everything about a scene's Gaussians that does not change from frame to frame.
#[derive(Clone, Debug)]
pub struct Poses {
    isa: Isa,
    groups: Vec<RestGroup>,
    /// World-from-asset rotations of sixteen Gaussians, xyzw, each once.
    placements: Vec<[F32x16; 4]>,
    /// Poses at rest, read for those that never leave them.
    rest: Vec<GaussianPose>,
    /// Rest position of every particle relative to its object's anchor [m]: what is interpolated stays small,
    /// and keeps its digits far from the origin.
    particle_offset: Vec<[f32; 3]>,
}

impl Poses {
    /// Prepares a scene, for the best instruction set of this processor; `labels` is asked once for every Gaussian.
    pub fn new(scene: &Scene, labels: impl Fn(usize) -> [u32; 3]) -> Poses {
        Poses::with_isa(scene, labels, Isa::detect())
    }

    /// Like [`new`](Self::new) on a chosen instruction set that the processor has; results are the same.
    fn with_isa(scene: &Scene, labels: impl Fn(usize) -> [u32; 3], isa: Isa) -> Poses {
        let count = scene.gaussians.len();
        let mut poses = Poses {
            isa,
            groups: vec![RestGroup::EMPTY; count.div_ceil(LANES)],
            placements: vec![],
            rest: vec![GaussianPose::default(); count],
            particle_offset: vec![[0.0; 3]; scene.particles.position.len()],
        };
        let mut placements = vec![[F32x16::ZERO; 4]; poses.groups.len()];
        for object in &scene.objects {
            let positions = &scene.particles.position[object.particles.clone()];
            let anchor = mean(positions);
            for p in object.particles.clone() {
                let x = scene.particles.position[p];
                poses.particle_offset[p] = [0, 1, 2].map(|a| (x[a] - anchor[a]) as f32);
            }
            let moves = object.fidelity != Fidelity::Static && !positions.is_empty();
            for g in object.gaussians.clone() {
                for (vector, value) in placements[g / LANES]
                    .iter_mut()
                    .zip(object.world_from_asset)
                {
                    vector.0[g % LANES] = value;
                }
                poses.set_rest(scene, g, anchor, object.world_from_asset, labels(g));
                if moves {
                    poses.set_moving(scene, g);
                }
            }
        }
        for (group, placement) in poses.groups.iter_mut().zip(placements) {
            if poses.placements.last() != Some(&placement) {
                poses.placements.push(placement);
            }
            group.placement = poses.placements.len() - 1;
        }
        poses
    }

    fn set_rest(
        &mut self,
        scene: &Scene,
        g: usize,
        anchor: [f64; 3],
        world_from_asset: [f32; 4],
        labels: [u32; 3],
    ) {
        let gaussians = &scene.gaussians;
        let r = Mat3::from_quaternion(gaussians.rotation[g]);
        let axes = r.mul(&Mat3::diagonal(gaussians.scale[g]));
        let position = gaussians.position[g];
        let (group, lane) = (&mut self.groups[g / LANES], g % LANES);
        for a in 0..3 {
            group.offset[a].0[lane] = (f64::from(position[a]) - anchor[a]) as f32;
            group.labels[a].0[lane] = f32::from_bits(labels[a]);
        }
        for (vector, value) in group.axes.iter_mut().zip(axes.0.as_flattened()) {
            vector.0[lane] = *value;
        }
        self.rest[g] = GaussianPose {
            position,
            label: labels[0],
            covariance: axes.mul_transposed_sym(&axes),
            labels: [labels[1], labels[2]],
            rotation: world_from_asset,
        };
    }

    fn set_moving(&mut self, scene: &Scene, g: usize) {
        let (group, lane) = (&mut self.groups[g / LANES], g % LANES);
        group.moving |= 1 << lane;
        group.particle[lane] = scene.binding.particle[g];
        group.weight[lane] = scene.binding.weight[g];
    }

    /// Writes every Gaussian into its place in `out`, and nothing into places beyond the scene's Gaussians.
    ///
    /// `position` [m] and `deformation` (row-major `F`) are those of the particles in scene order. Runs on the
    /// current rayon pool; the result does not depend on it. `out` is not read, and large ones are written past the
    /// caches.
    ///
    /// Centre `sum w (x_p + F_p (X - X_p))`, `F = sum w F_p`, covariance `F Sigma0 F^T` with the stretches of `F`
    /// limited to [`MAX_ASPECT`], rotation `polar(F) world_from_asset`.
    pub fn write(&self, position: &[[f32; 3]], deformation: &[[f32; 9]], out: &mut [GaussianPose]) {
        let count = out.len().min(self.rest.len());
        self.write_part(0..count, 0, position, deformation, &mut out[..count]);
    }

    /// Like [`write`](Self::write), for `gaussians` alone, which are bound to no particles but those given: `position` and
    /// `deformation` begin with the particle `first` of the scene. The same Gaussians get the same bits.
    ///
    /// # Panics
    /// When `out` is not as long as `gaussians`, or a range is beyond the scene.
    pub fn write_part(
        &self,
        gaussians: Range<usize>,
        first: usize,
        position: &[[f32; 3]],
        deformation: &[[f32; 9]],
        out: &mut [GaussianPose],
    ) {
        assert_eq!(gaussians.len(), out.len(), "Gaussians and their places");
        let carriers: Vec<F32x16> = self.particle_offset[first..]
            .par_iter()
            .zip(position)
            .zip(deformation)
            .with_min_len(CHUNK)
            .map(|((offset, x), f)| carrier(offset, x, f))
            .collect();
        let shared = Shared {
            carriers: &carriers,
            first: first as u32,
            placements: &self.placements,
            streamed: size_of_val(&self.rest[..]) >= STREAMED,
        };
        // A group that begins before the range is made whole, and what belongs to others left out.
        let head = (gaussians.start.next_multiple_of(LANES) - gaussians.start).min(out.len());
        let (begin, rest) = out.split_at_mut(head);
        if head > 0 {
            let group = gaussians.start / LANES;
            let mut whole = [GaussianPose::default(); LANES];
            let at_rest = &self.rest[group * LANES..self.rest.len().min((group + 1) * LANES)];
            let shared = Shared {
                streamed: false,
                ..shared
            };
            let groups = &self.groups[group..=group];
            follow(self.isa, &shared, groups, at_rest, &mut whole);
            let lane = gaussians.start % LANES;
            begin.copy_from_slice(&whole[lane..lane + head]);
        }
        let aligned = gaussians.start + head..gaussians.end;
        let groups = aligned.start / LANES..aligned.end.div_ceil(LANES);
        rest.par_chunks_mut(TASK * LANES)
            .zip(self.rest[aligned].par_chunks(TASK * LANES))
            .zip(self.groups[groups].par_chunks(TASK))
            .for_each(|((out, rest), groups)| follow(self.isa, &shared, groups, rest, out));
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
