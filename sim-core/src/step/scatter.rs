//! P2G: mass and momentum into the block's private tile.

use super::stencil::{Stencil, Weights, read_quarter, stored_all, z_offsets};
use crate::{
    grid::{TILE, Tile},
    mat3::Mat3,
    simd::{F32x16, Lanes},
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
        for n in 0..9 {
            let at = self.first as usize + 4 * TILE * (TILE * (n / 3) + n % 3);
            // SAFETY: cells are clamped to -1..=4, so the stencil's rows start inside the tile and end at most
            // one node behind it, where it is padded.
            unsafe {
                let to = tile.0.as_mut_ptr().add(at);
                (V::load_at(to) + self.rows[n]).store_at(to);
            }
            self.rows[n] = V::broadcast(0.0);
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
        let Weights {
            first,
            z: z_weights,
        } = stencil.weights();
        let mut wxy = [F32x16::ZERO; 9];
        for n in 0..9 {
            (stencil.w[0][n / 3] * stencil.w[1][n % 3]).store(&mut wxy[n]);
        }
        let d = stencil.d;
        let a = affine.0;
        let zero = V::broadcast(0.0);
        let mut at_node = [zero; 3];
        for r in 0..3 {
            let z = (-a[r][2]).mul_add(d[2], v[r]);
            let y = (-a[r][1]).mul_add(d[1], z);
            at_node[r] = mass * (-a[r][0]).mul_add(d[0], y);
        }
        let [x, y, z] = at_node;
        let a0 = stored_all(V::transpose_quarters([x, y, z, mass]));
        let mut columns = [[F32x16::ZERO; 4]; 3];
        for j in 0..3 {
            columns[j] = stored_all(V::transpose_quarters([
                mass * a[0][j],
                mass * a[1][j],
                mass * a[2][j],
                zero,
            ]));
        }
        let k = z_offsets::<V>();
        for q in 0..4 {
            for r in 0..4 {
                let lane = 4 * q + r;
                if first[lane] != self.first {
                    self.flush(tile);
                    self.first = first[lane];
                }
                let wz = read_quarter::<V>(&z_weights, q, r).spread();
                let q0 = read_quarter::<V>(&a0, q, r) * wz;
                let q0 = read_quarter::<V>(&columns[2], q, r).mul_add(wz * k, q0);
                let q1 = read_quarter::<V>(&columns[0], q, r) * wz;
                let q2 = read_quarter::<V>(&columns[1], q, r) * wz;
                let slabs = [q0 - q1, q0, q0 + q1];
                for i in 0..3 {
                    let row = [slabs[i] - q2, slabs[i], slabs[i] + q2];
                    for j in 0..3 {
                        let n = 3 * i + j;
                        self.rows[n] = row[j].mul_add(V::broadcast(wxy[n].0[lane]), self.rows[n]);
                    }
                }
            }
        }
    }
}
