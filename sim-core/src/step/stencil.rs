//! Quadratic B-spline weights of 16 particles at once.

use crate::{
    grid::Tile,
    simd::{F32x16, LANES, Lanes},
};

/// Adding 1.5 * 2^23 rounds a float to the nearest integer and leaves that integer in the low mantissa bits.
const ROUNDER: f32 = 12_582_912.0;

/// Where 16 particles sit among the nodes of a tile, and how they weigh them.
pub(crate) struct Stencil<V> {
    /// Index of the cell (nearest node) along each axis, -1..=4.
    pub cell: [V; 3],
    /// Distance from the nearest node [cells], within 1/2.
    pub d: [V; 3],
    /// Weights of the nodes -1, 0, 1 along each axis.
    pub w: [[V; 3]; 3],
}

/// Memory form of what a loop over the lanes of a [`Stencil`] reads.
pub(crate) struct Weights {
    /// Index of the stencil's first float in the tile.
    pub first: [u32; LANES],
    /// Per quarter-transposed particle: weights of the nodes -1, 0, 1 along z and a zero.
    pub z: [F32x16; 4],
}

impl<V: Lanes> Stencil<V> {
    /// Stencils of particles at `x` relative to the block's centre.
    #[inline(always)]
    pub fn new(x: [V; 3]) -> Self {
        let half = V::splat(0.5);
        let rounder = V::broadcast(ROUNDER);
        let zero = V::broadcast(0.0);
        let (mut cell, mut d, mut w) = ([zero; 3], [zero; 3], [[zero; 3]; 3]);
        for a in 0..3 {
            // The clamp never acts on particles within the drift margin; it keeps NaN inside the tile.
            cell[a] = ((x[a] + V::splat(1.5)) + rounder - rounder)
                .max(V::splat(-1.0))
                .min(V::splat(4.0));
            d[a] = x[a] - (cell[a] - V::splat(1.5));
            let (low, high) = (half - d[a], half + d[a]);
            w[a] = [
                half * low * low,
                (-d[a]).mul_add(d[a], V::splat(0.75)),
                half * high * high,
            ];
        }
        Self { cell, d, w }
    }

    /// Writes out what loops over particles read.
    #[inline(always)]
    pub fn weights(&self) -> Weights {
        let [i, j, k] = self.cell;
        // First node of the stencil: cell - 1 in block terms, cell + 1 in the tile.
        let node = i
            .mul_add(V::splat(8.0), j)
            .mul_add(V::splat(8.0), k + V::broadcast(ROUNDER));
        let mut first = [0; LANES];
        node.store_bits(&mut first);
        let origin = Tile::at(1, 1, 1) as u32;
        for first in &mut first {
            *first = (*first)
                .wrapping_sub(ROUNDER.to_bits())
                .wrapping_mul(4)
                .wrapping_add(origin);
        }
        let [a, b, c] = self.w[2];
        let z = stored_all(V::transpose_quarters([a, b, c, V::broadcast(0.0)]));
        Weights { first, z }
    }
}

/// [`stored`] of several vectors.
#[inline(always)]
pub(crate) fn stored_all<V: Lanes, const N: usize>(v: [V; N]) -> [F32x16; N] {
    let mut out = [F32x16::ZERO; N];
    for n in 0..N {
        v[n].store(&mut out[n]);
    }
    out
}

/// Reads the quarter of particle `4 q + r` from four quarter-transposed vectors, into every quarter.
#[inline(always)]
pub(crate) fn read_quarter<V: Lanes>(from: &[F32x16; 4], q: usize, r: usize) -> V {
    let quarter = &from[r].0[4 * q..4 * q + 4];
    // SAFETY: the slice is 4 floats long.
    unsafe { V::repeat_quarter(quarter.as_ptr()) }
}

/// Node offset along z of each quarter: -1, 0, 1 and a fourth that no weight reaches.
#[inline(always)]
pub(crate) fn z_offsets<V: Lanes>() -> V {
    V::load(&F32x16([
        -1.0, -1.0, -1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0,
    ]))
}
