//! Gaussians as bounded ellipsoids in voxel units, and the opacity density that they add up to.

use glam::{Mat3, Quat, Vec3};

use super::{FillReport, grid::Grid};
use crate::{assets::Gaussians, floaters::floaters};

/// Gaussians with less opacity are invisible.
const MIN_OPACITY: f32 = 0.02;
/// Kernels end at this many standard deviations.
const REACH: f32 = 3.0;
/// Smallest standard deviation [voxels]: thinner discs would slip between voxel centres.
const MIN_SIGMA: f32 = 0.6;
/// Largest standard deviation [voxels]: bounds the cost of one Gaussian.
const MAX_SIGMA: f32 = 12.0;
/// Most voxels of a grid; coarser voxels are used for objects that would need more.
const MAX_VOXELS: f64 = 4.0e6;
/// Fewest voxels along the longest side.
const MIN_SIDE: f64 = 32.0;
/// Fewest particle sites along the longest side.
const MIN_SITES: f64 = 4.0;
/// Widest hole that may be closed, as a fraction of the longest side; the grid is padded by as much.
pub const MAX_HOLE: f64 = 0.08;

/// A Gaussian on the grid.
pub struct Surfel {
    /// Centre [voxels].
    pub center: Vec3,
    /// Unit vector along the shortest axis; which of the two is open until it is oriented.
    pub normal: Vec3,
    /// Longer axes: unit vectors and standard deviations [voxels].
    pub tangents: [(Vec3, f32); 2],
    /// Standard deviation along the normal [voxels].
    pub thickness: f32,
    /// Opacity.
    pub opacity: f32,
}

/// Bounds the object, chooses the voxel size and bounds the Gaussians; `None` when there is nothing to fill.
pub fn voxelize(
    gaussians: &Gaussians,
    spacing: f64,
    report: &mut FillReport,
) -> Option<(Grid, Vec<Surfel>)> {
    if !(spacing > 0.0 && spacing.is_finite()) {
        return None;
    }
    let usable = (0..gaussians.len())
        .filter(|&i| is_usable(gaussians, i))
        .collect::<Vec<_>>();
    report.skipped = gaussians.len() - usable.len();
    if usable.is_empty() {
        return None;
    }
    let centers: Vec<[f64; 3]> = usable
        .iter()
        .map(|&i| gaussians.position[i].map(f64::from))
        .collect();
    let floating = floaters(&centers);
    report.outliers = floating.len();
    let mut left = floating.iter().peekable();
    let near: Vec<usize> = (0..usable.len())
        .filter(|n| left.next_if_eq(&n).is_none())
        .map(|n| usable[n])
        .collect();
    let grid = choose_grid(gaussians, &near, spacing);
    report.voxel = grid.voxel;
    report.voxels = grid.len();
    let surfels = near
        .iter()
        .map(|&i| surfel(gaussians, i, &grid, report))
        .collect();
    Some((grid, surfels))
}

fn is_usable(g: &Gaussians, i: usize) -> bool {
    let finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
    finite(&g.position[i])
        && finite(&g.scale[i])
        && finite(&g.rotation[i])
        && Quat::from_array(g.rotation[i]).length_squared() > 1e-12
        && g.opacity[i] >= MIN_OPACITY
}

fn choose_grid(g: &Gaussians, near: &[usize], spacing: f64) -> Grid {
    let mut min = [f64::MAX; 3];
    let mut max = [f64::MIN; 3];
    let mut middle = Vec::with_capacity(near.len());
    for &i in near {
        for a in 0..3 {
            min[a] = min[a].min(f64::from(g.position[i][a]));
            max[a] = max[a].max(f64::from(g.position[i][a]));
        }
        let mut s = g.scale[i];
        s.sort_unstable_by(f32::total_cmp);
        middle.push(s[1]);
    }
    middle.sort_unstable_by(f32::total_cmp);
    let typical = f64::from(middle[middle.len() / 2]);
    let farthest = (0..3)
        .map(|a| min[a].abs().max(max[a].abs()))
        .fold(0.0, f64::max);
    // Never smaller than what f32 coordinates can tell apart.
    let least = (1e-6 * farthest).max(1e-9).max(2.0 * typical);
    let longest = (0..3).map(|a| max[a] - min[a]).fold(least, f64::max);
    // An object smaller than a few sites gets smaller ones: it must be able to turn.
    let spacing = spacing.min(longest / MIN_SITES);
    // A whole number of voxels per particle site, about as large as a typical Gaussian.
    let wanted = typical
        .clamp(spacing / 4.0, spacing)
        .min(longest / MIN_SIDE);
    let mut site = (spacing / wanted).ceil().clamp(1.0, 16.0);
    let mut edge = spacing;
    loop {
        let voxel = edge / site;
        // At least one site, so that no solid touches the border of the lattice of sites.
        let pad = MAX_HOLE / 2.0 * longest + site.max(6.0) * voxel;
        // The lattice is aligned with the simulation grid, whose nodes are multiples of dx.
        let low = min.map(|x| ((x - pad) / edge).floor());
        let high = max.map(|x| ((x + pad) / edge).ceil());
        let size: [f64; 3] = std::array::from_fn(|a| (high[a] - low[a]) * site);
        if size.iter().product::<f64>() <= MAX_VOXELS {
            return Grid {
                origin: low.map(|l| l * edge),
                voxel,
                size: size.map(|s| s as usize),
                site: site as usize,
            };
        }
        if site > 1.0 {
            site -= 1.0;
        } else {
            edge *= 1.25;
        }
    }
}

fn surfel(g: &Gaussians, i: usize, grid: &Grid, report: &mut FillReport) -> Surfel {
    let mut axes = [0, 1, 2];
    let scale = g.scale[i];
    axes.sort_by(|&a, &b| scale[a].total_cmp(&scale[b]));
    let rotation = Mat3::from_quat(Quat::from_array(g.rotation[i]).normalize());
    let sigma = axes.map(|a| (f64::from(scale[a]) / grid.voxel) as f32);
    report.limited += usize::from(sigma[2] > MAX_SIGMA);
    let sigma = sigma.map(|s| s.clamp(MIN_SIGMA, MAX_SIGMA));
    let center: [f64; 3] =
        std::array::from_fn(|a| (f64::from(g.position[i][a]) - grid.origin[a]) / grid.voxel);
    Surfel {
        center: Vec3::from_array(center.map(|x| x as f32)),
        normal: rotation.col(axes[0]),
        tangents: [
            (rotation.col(axes[1]), sigma[1]),
            (rotation.col(axes[2]), sigma[2]),
        ],
        thickness: sigma[0],
        opacity: g.opacity[i].min(1.0),
    }
}

impl Surfel {
    /// Calls `visit(voxel index, kernel, voxel centre - own centre)` for every voxel centre within reach. The
    /// kernel `(1 - q/9)^3` of the squared distance `q` in standard deviations stands for `exp(-q/2)`: bounded,
    /// and the same bits on every machine. Returns the number of voxels looked at.
    pub fn visit(
        &self,
        grid: &Grid,
        thickness: f32,
        mut visit: impl FnMut(usize, f32, Vec3),
    ) -> u64 {
        let reach2 = REACH * REACH;
        let spread = |v: Vec3, sigma: f32| {
            let column = v / sigma;
            Mat3::from_cols(column * column.x, column * column.y, column * column.z)
        };
        let [(t0, s0), (t1, s1)] = self.tangents;
        let precision = spread(t0, s0) + spread(t1, s1) + spread(self.normal, thickness);
        let extent: Vec3 = {
            let square = |v: Vec3, sigma: f32| v * v * sigma * sigma;
            let sum = square(t0, s0) + square(t1, s1) + square(self.normal, thickness);
            Vec3::new(sum.x.sqrt(), sum.y.sqrt(), sum.z.sqrt()) * REACH
        };
        // Columns run along the axis that the disc faces most, where they are shortest.
        let n = self.normal.abs().to_array();
        let k = if n[0] >= n[1] && n[0] >= n[2] {
            0
        } else if n[1] >= n[2] {
            1
        } else {
            2
        };
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let p = |a: usize, b: usize| precision.col(a)[b];
        let range = |a: usize, low: f32, high: f32| {
            let first = (low - 0.5).ceil().max(0.0) as usize;
            let end = ((high - 0.5).floor() + 1.0).clamp(0.0, grid.size[a] as f32) as usize;
            first..end
        };
        let around = |a: usize| range(a, self.center[a] - extent[a], self.center[a] + extent[a]);
        let mut looked = 0;
        for u in around(i) {
            let du = u as f32 + 0.5 - self.center[i];
            for v in around(j) {
                let dv = v as f32 + 0.5 - self.center[j];
                // q along the column is a t^2 + 2 b t + c.
                let a = p(k, k);
                let b = p(k, i) * du + p(k, j) * dv;
                let c = p(i, i) * du * du + 2.0 * p(i, j) * du * dv + p(j, j) * dv * dv;
                let root = b * b - a * (c - reach2);
                looked += 1;
                if root <= 0.0 {
                    continue;
                }
                let (middle, half) = (-b / a, root.sqrt() / a);
                let from = self.center[k] + middle - half;
                for w in range(k, from, from + 2.0 * half) {
                    let t = w as f32 + 0.5 - self.center[k];
                    let q = (a * t + 2.0 * b) * t + c;
                    let rest = (1.0 - q / reach2).max(0.0);
                    let mut d = Vec3::ZERO;
                    (d[i], d[j], d[k]) = (du, dv, t);
                    let mut at = [0; 3];
                    (at[i], at[j], at[k]) = (u, v, w);
                    visit(grid.index(at), rest * rest * rest, d);
                    looked += 1;
                }
            }
        }
        looked
    }
}

/// Sum of opacity times kernel at every voxel centre.
pub fn density(grid: &Grid, surfels: &[Surfel], report: &mut FillReport) -> Vec<f32> {
    let mut density = vec![0.0; grid.len()];
    for surfel in surfels {
        report.operations += surfel.visit(grid, surfel.thickness, |i, kernel, _| {
            density[i] += surfel.opacity * kernel
        });
    }
    density
}
