//! G2P: velocity and its gradient from the velocity tile.

use super::stencil::{Stencil, Weights, quarter_of, stored, z_offsets};
use crate::{
    grid::{TILE, Tile},
    mat3::Mat3,
    simd::{F32x16, LANES, Lanes},
};

/// Velocity `v = sum w v_i` [cells/s] and `C = 4 sum w v_i (x_i - x_p)^T` [1/s] of 16 particles (APIC with
/// quadratic splines, Jiang et al. 2015).
///
/// Rows of four nodes along z fill one vector, so sums run over y, then x, then z.
#[inline(always)]
pub(crate) fn gather<V: Lanes>(tile: &Tile, stencil: &Stencil<V>) -> ([V; 3], Mat3<V>) {
    let Weights { first, z } = stencil.weights();
    let wx = stencil.w[0].map(stored);
    let wy = stencil.w[1].map(stored);
    let k = z_offsets::<V>();
    let mut rows = [F32x16::ZERO; LANES];
    for (lane, out) in rows.iter_mut().enumerate() {
        let at = first[lane] as usize;
        let row = |i: usize, j: usize| {
            // SAFETY: cells are clamped to -1..=4, so the stencil's rows start inside the tile and end at most
            // one node behind it, where it is padded.
            unsafe { V::load_at(tile.floats.as_ptr().add(at + 4 * TILE * (TILE * i + j))) }
        };
        let [y0, y1, y2] = [0, 1, 2].map(|j| V::broadcast(wy[j].0[lane]));
        // Per x-slab: sum and first moment along y.
        let slab = |i: usize| {
            let (low, high) = (y0 * row(i, 0), y2 * row(i, 2));
            (y1.mul_add(row(i, 1), low + high), high - low)
        };
        let [s0, s1, s2] = [slab(0), slab(1), slab(2)];
        let [x0, x1, x2] = [0, 1, 2].map(|i| V::broadcast(wx[i].0[lane]));
        let (low, high) = (x0 * s0.0, x2 * s2.0);
        let sum = x1.mul_add(s1.0, low + high);
        let moment_x = high - low;
        let moment_y = x2.mul_add(s2.1, x1.mul_add(s1.1, x0 * s0.1));
        // SAFETY: `quarter_of` stays below 61 of the 64 floats.
        let wz = unsafe { V::repeat_quarter(z.as_ptr().cast::<f32>().add(quarter_of(lane))) };
        let wz = wz.spread();
        V::sum_quarters([sum * wz, moment_x * wz, moment_y * wz, sum * (wz * k)]).store(out);
    }
    let m = V::transpose(&rows);
    let v = [m[0], m[1], m[2]];
    // Moments are about the nearest node: shift to the particle.
    let four = V::splat(4.0);
    let entry = |i: usize, j: usize| four * (-v[i]).mul_add(stencil.d[j], m[4 + 4 * j + i]);
    let c = Mat3(std::array::from_fn(|i| {
        std::array::from_fn(|j| entry(i, j))
    }));
    (v, c)
}
