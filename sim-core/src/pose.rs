//! How Gaussians follow the particles: once per published frame, written where the caller wants them.

use rayon::prelude::*;

use crate::{
    mat3::Mat3,
    materials::{polar::rotation, svd::svd},
    scene::{BINDING_NEIGHBORS, Fidelity, Scene},
};

/// Largest ratio of principal stretches that a Gaussian's shape follows; beyond it, it would become a needle.
pub const MAX_ASPECT: f32 = 30.0;
/// Gaussians per task.
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
    rest: Vec<Rest>,
    binding: Vec<[u32; BINDING_NEIGHBORS]>,
    weight: Vec<[f32; BINDING_NEIGHBORS]>,
    /// Rest position of every particle relative to its object's anchor [m].
    particle_offset: Vec<[f32; 3]>,
    objects: Vec<Anchor>,
}

/// A Gaussian at rest.
#[derive(Clone, Copy, Debug)]
struct Rest {
    /// Centre relative to its object's anchor [m].
    offset: [f32; 3],
    /// `R diag(scale)`: columns are the axes of the ellipsoid [m].
    axes: Mat3<f32>,
    object: u32,
    pose: GaussianPose,
}

/// A point near an object: what is interpolated stays small, and keeps its digits far from the origin.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    world_from_asset: [f32; 4],
    moves: bool,
}

/// A particle's share in the Gaussians that follow it: `x_p - F_p X_p`, and `F_p`.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Carrier([f32; 12]);

impl Poses {
    /// Prepares a scene.
    pub fn new(scene: &Scene) -> Poses {
        let mut rest = Vec::with_capacity(scene.gaussians.len());
        let mut particle_offset = vec![[0.0; 3]; scene.particles.position.len()];
        let mut objects = Vec::with_capacity(scene.objects.len());
        for (id, object) in scene.objects.iter().enumerate() {
            let positions = &scene.particles.position[object.particles.clone()];
            let anchor = mean(positions);
            for (offset, x) in particle_offset[object.particles.clone()]
                .iter_mut()
                .zip(positions)
            {
                *offset = [0, 1, 2].map(|a| (x[a] - anchor[a]) as f32);
            }
            for g in object.gaussians.clone() {
                rest.push(rest_of(scene, g, id, anchor, object.world_from_asset));
            }
            objects.push(Anchor {
                world_from_asset: object.world_from_asset,
                moves: object.fidelity != Fidelity::Static && !positions.is_empty(),
            });
        }
        Poses {
            rest,
            binding: scene.binding.particle.clone(),
            weight: scene.binding.weight.clone(),
            particle_offset,
            objects,
        }
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
        let carriers: Vec<Carrier> = self
            .particle_offset
            .par_iter()
            .zip(position)
            .zip(deformation)
            .with_min_len(CHUNK)
            .map(|((offset, x), f)| carrier(offset, x, f))
            .collect();
        out.par_chunks_mut(CHUNK)
            .zip(self.rest.par_chunks(CHUNK))
            .enumerate()
            .for_each(|(chunk, (out, rest))| {
                let first = chunk * CHUNK;
                let mut poses = [GaussianPose::default(); CHUNK];
                self.poses(first, rest, &carriers, &mut poses);
                for (i, (slot, pose)) in out.iter_mut().zip(&poses).enumerate() {
                    *slot = make(first + i, pose);
                }
            });
    }

    /// Poses of one chunk, with the processor's fused multiply-add where it has one: same bits, much faster than
    /// the library routine that stands in for it elsewhere.
    fn poses(&self, first: usize, rest: &[Rest], carriers: &[Carrier], out: &mut [GaussianPose]) {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,fma")]
            fn with_fma(
                poses: &Poses,
                first: usize,
                rest: &[Rest],
                carriers: &[Carrier],
                out: &mut [GaussianPose],
            ) {
                poses.poses_inline(first, rest, carriers, out);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                // SAFETY: the features that `with_fma` is compiled for were just detected.
                return unsafe { with_fma(self, first, rest, carriers, out) };
            }
        }
        self.poses_inline(first, rest, carriers, out);
    }

    #[inline(always)]
    fn poses_inline(
        &self,
        first: usize,
        rest: &[Rest],
        carriers: &[Carrier],
        out: &mut [GaussianPose],
    ) {
        for (i, (rest, out)) in rest.iter().zip(out).enumerate() {
            let object = &self.objects[rest.object as usize];
            *out = if object.moves {
                let g = first + i;
                follow(rest, object, &self.binding[g], &self.weight[g], carriers)
            } else {
                rest.pose
            };
        }
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

fn rest_of(
    scene: &Scene,
    g: usize,
    object: usize,
    anchor: [f64; 3],
    world_from_asset: [f32; 4],
) -> Rest {
    let gaussians = &scene.gaussians;
    let r = matrix_from_quaternion(gaussians.rotation[g]);
    let axes = r.mul(&Mat3::diagonal(gaussians.scale[g]));
    let position = gaussians.position[g];
    Rest {
        offset: [0, 1, 2].map(|a| (f64::from(position[a]) - anchor[a]) as f32),
        axes,
        object: object as u32,
        pose: GaussianPose {
            position,
            covariance: axes.mul_transposed_sym(&axes),
            rotation: world_from_asset,
        },
    }
}

fn carrier(offset: &[f32; 3], x: &[f32; 3], f: &[f32; 9]) -> Carrier {
    let mut out = [0.0; 12];
    for a in 0..3 {
        let moved = f[3 * a] * offset[0] + f[3 * a + 1] * offset[1] + f[3 * a + 2] * offset[2];
        out[a] = x[a] - moved;
    }
    out[3..].copy_from_slice(f);
    Carrier(out)
}

#[inline(always)]
fn follow(
    rest: &Rest,
    object: &Anchor,
    binding: &[u32; BINDING_NEIGHBORS],
    weight: &[f32; BINDING_NEIGHBORS],
    carriers: &[Carrier],
) -> GaussianPose {
    let mut sum = [0.0_f32; 12];
    for (particle, weight) in binding.iter().zip(weight) {
        let Carrier(values) = &carriers[*particle as usize];
        for (sum, value) in sum.iter_mut().zip(values) {
            *sum = value.mul_add(*weight, *sum);
        }
    }
    let f = Mat3([
        [sum[3], sum[4], sum[5]],
        [sum[6], sum[7], sum[8]],
        [sum[9], sum[10], sum[11]],
    ]);
    let moved = f.mul_vec(rest.offset);
    let (r, shape) = rotation_and_shape(&f);
    let axes = shape.mul(&rest.axes);
    GaussianPose {
        position: [sum[0] + moved[0], sum[1] + moved[1], sum[2] + moved[2]],
        covariance: axes.mul_transposed_sym(&axes),
        rotation: multiply(quaternion_from_matrix(&r), object.world_from_asset),
    }
}

/// Polar rotation of `f`, and `f` with its stretches limited.
#[inline(always)]
fn rotation_and_shape(f: &Mat3<f32>) -> (Mat3<f32>, Mat3<f32>) {
    let j = f.det();
    let norm_squared = f.norm_squared();
    // s1 s2 <= |F|^2 / 2 gives s3 >= 2 J / |F|^2, and s1 <= |F|: a cheap bound of s1 / s3, 2.6 at rest.
    if 2.0 * MAX_ASPECT * j > norm_squared * norm_squared.sqrt() {
        return (rotation(f), *f);
    }
    limited(f)
}

/// The rare case: strongly deformed, flat or inside out.
#[cold]
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

fn matrix_from_quaternion([x, y, z, w]: [f32; 4]) -> Mat3<f32> {
    Mat3([
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ])
}

/// Quaternion of a rotation matrix: the largest of four equivalent forms (Shepperd 1978).
#[inline(always)]
fn quaternion_from_matrix(m: &Mat3<f32>) -> [f32; 4] {
    let [[a, b, c], [d, e, f], [g, h, i]] = m.0;
    let trace = a + e + i;
    let q = if trace > 0.0 {
        [h - f, c - g, d - b, 1.0 + trace]
    } else if a > e && a > i {
        [1.0 + a - e - i, b + d, c + g, h - f]
    } else if e > i {
        [b + d, 1.0 + e - a - i, f + h, c - g]
    } else {
        [c + g, f + h, 1.0 + i - a - e, d - b]
    };
    let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    q.map(|v| v / norm)
}

/// Product of quaternions: first `b`, then `a`.
#[inline(always)]
fn multiply([ax, ay, az, aw]: [f32; 4], [bx, by, bz, bw]: [f32; 4]) -> [f32; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

#[cfg(test)]
mod tests;
