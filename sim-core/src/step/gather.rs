//! G2P: velocity and its gradient from the velocity tile.

use super::stencil::{Stencil, Weights, read_quarter, stored_all, z_offsets};
use crate::{
    grid::{TILE, Tile},
    mat3::Mat3,
    simd::{F32x16, LANES, Lanes},
};

/// What 16 particles find on the grid.
pub(crate) struct Gathered<V> {
    /// Velocity [cells/s].
    pub v: [V; 3],
    /// Velocity gradient [1/s].
    pub c: Mat3<V>,
    /// Mass per cell, in units of the heaviest particle.
    pub mass: V,
}

/// Velocity `v = sum w v_i` [cells/s] and `C = 4 sum w v_i (x_i - x_p)^T` [1/s] of 16 particles (APIC with
/// quadratic splines, Jiang et al. 2015), and the mass per cell.
///
/// Rows of four nodes along z fill one vector, so sums run over y, then x, then z.
#[inline(always)]
pub(crate) fn gather<V: Lanes>(tile: &Tile, stencil: &Stencil<V>) -> Gathered<V> {
    let Weights { first, z } = stencil.weights();
    let wx = stored_all(stencil.w[0]);
    let wy = stored_all(stencil.w[1]);
    let k = z_offsets::<V>();
    let mut rows = [F32x16::ZERO; LANES];
    for q in 0..4 {
        for r in 0..4 {
            let lane = 4 * q + r;
            let at = first[lane] as usize;
            // Per x-slab: sum and first moment along y.
            let (mut sum, mut moment) = ([k; 3], [k; 3]);
            for i in 0..3 {
                let low = V::broadcast(wy[0].0[lane]) * row(tile, at, i, 0);
                let high = V::broadcast(wy[2].0[lane]) * row(tile, at, i, 2);
                let middle = V::broadcast(wy[1].0[lane]);
                sum[i] = middle.mul_add(row(tile, at, i, 1), low + high);
                moment[i] = high - low;
            }
            let x0 = V::broadcast(wx[0].0[lane]);
            let x1 = V::broadcast(wx[1].0[lane]);
            let x2 = V::broadcast(wx[2].0[lane]);
            let (low, high) = (x0 * sum[0], x2 * sum[2]);
            let total = x1.mul_add(sum[1], low + high);
            let moment_x = high - low;
            let moment_y = x2.mul_add(moment[2], x1.mul_add(moment[1], x0 * moment[0]));
            let wz = read_quarter::<V>(&z, q, r).spread();
            V::sum_quarters([total * wz, moment_x * wz, moment_y * wz, total * (wz * k)])
                .store(&mut rows[lane]);
        }
    }
    let m = V::transpose(&rows);
    let v = [m[0], m[1], m[2]];
    // Moments are about the nearest node: shift to the particle.
    let mut c = Mat3([[k; 3]; 3]);
    for i in 0..3 {
        for j in 0..3 {
            c.0[i][j] = V::splat(4.0) * (-v[i]).mul_add(stencil.d[j], m[4 + 4 * j + i]);
        }
    }
    Gathered { v, c, mass: m[3] }
}

/// Four nodes along z at offsets `i`, `j` in 0..3 from the stencil's first float.
#[inline(always)]
fn row<V: Lanes>(tile: &Tile, first: usize, i: usize, j: usize) -> V {
    // SAFETY: cells are clamped to -1..=4, so the stencil's rows start inside the tile and end at most one node
    // behind it, where it is padded.
    unsafe { V::load_at(tile.0.as_ptr().add(first + 4 * TILE * (TILE * i + j))) }
}
