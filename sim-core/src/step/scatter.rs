//! P2G: mass and momentum into the block's private tile.

use super::stencil::{Stencil, Weights, quarter_of, stored, z_offsets};
use crate::{
    grid::{TILE, Tile},
    mat3::Mat3,
    simd::{F32x16, LANES, Lanes},
};

/// Sums of particles that share a stencil, held in registers until the stencil changes.
pub(crate) struct Accumulator<V> {
    rows: [V; 9],
    /// First float of the stencil the sums belong to.
    first: u32,
}

impl<V: Lanes> Accumulator<V> {
    /// Nothing yet; the first node of the tile gets the first, empty, flush.
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            rows: [V::broadcast(0.0); 9],
            first: Tile::at(0, 0, 0) as u32,
        }
    }

    /// Adds the sums to the tile.
    #[inline(always)]
    pub fn flush(&mut self, tile: &mut Tile) {
        for (n, row) in self.rows.iter_mut().enumerate() {
            let at = self.first as usize + 4 * TILE * (TILE * (n / 3) + n % 3);
            // SAFETY: cells are clamped to -1..=4, so the stencil's rows start inside the tile and end at most
            // one node behind it, where it is padded.
            unsafe {
                let to = tile.floats.as_mut_ptr().add(at);
                (V::load_at(to) + *row).store_at(to);
            }
            *row = V::broadcast(0.0);
        }
    }

    /// Adds `w (m v + m A (x_i - x_p))` and `w m` of 16 particles, `A` the affine matrix [1/s] that carries
    /// `C` and the stress.
    ///
    /// `m (v + A (x_i - x_p)) = a0 + i a1 + j a2 + k a3` with node offsets `i, j, k` in -1..=1 and the mass as
    /// fourth component of `a0`.
    #[inline(always)]
    pub fn scatter(
        &mut self,
        tile: &mut Tile,
        stencil: &Stencil<V>,
        mass: V,
        v: [V; 3],
        affine: &Mat3<V>,
    ) {
        let Weights { first, z } = stencil.weights();
        let mut wxy = [F32x16::ZERO; 9];
        for (n, w) in wxy.iter_mut().enumerate() {
            *w = stored(stencil.w[0][n / 3] * stencil.w[1][n % 3]);
        }
        let d = stencil.d;
        let a = affine.0;
        let a0: [V; 3] = std::array::from_fn(|r| {
            let at_node = (-a[r][0]).mul_add(
                d[0],
                (-a[r][1]).mul_add(d[1], (-a[r][2]).mul_add(d[2], v[r])),
            );
            mass * at_node
        });
        let zero = V::broadcast(0.0);
        let quarters = |rows: [V; 4]| V::transpose_quarters(rows).map(stored);
        let a0 = quarters([a0[0], a0[1], a0[2], mass]);
        let column = |j: usize| quarters([mass * a[0][j], mass * a[1][j], mass * a[2][j], zero]);
        let (a1, a2, a3) = (column(0), column(1), column(2));
        let k = z_offsets::<V>();
        for lane in 0..LANES {
            if first[lane] != self.first {
                self.flush(tile);
                self.first = first[lane];
            }
            let read = |from: &[F32x16; 4]| {
                // SAFETY: `quarter_of` stays below 61 of the 64 floats.
                unsafe { V::repeat_quarter(from.as_ptr().cast::<f32>().add(quarter_of(lane))) }
            };
            let wz = read(&z).spread();
            let q0 = read(&a3).mul_add(wz * k, read(&a0) * wz);
            let q1 = read(&a1) * wz;
            let q2 = read(&a2) * wz;
            let slabs = [q0 - q1, q0, q0 + q1];
            for (i, slab) in slabs.into_iter().enumerate() {
                for (j, row) in [slab - q2, slab, slab + q2].into_iter().enumerate() {
                    let n = 3 * i + j;
                    self.rows[n] = row.mul_add(V::broadcast(wxy[n].0[lane]), self.rows[n]);
                }
            }
        }
    }
}
