//! Vectors and matrices of 16 particles between memory and registers, and the cells that particles are in.

use crate::{
    grid::Cells,
    mat3::Mat3,
    simd::{F32x16, LANES, Lanes},
};

#[inline(always)]
pub(super) fn load3<V: Lanes>(from: &[F32x16; 3]) -> [V; 3] {
    [V::load(&from[0]), V::load(&from[1]), V::load(&from[2])]
}

#[inline(always)]
pub(super) fn load9<V: Lanes>(m: &[F32x16; 9]) -> Mat3<V> {
    Mat3([
        [V::load(&m[0]), V::load(&m[1]), V::load(&m[2])],
        [V::load(&m[3]), V::load(&m[4]), V::load(&m[5])],
        [V::load(&m[6]), V::load(&m[7]), V::load(&m[8])],
    ])
}

#[inline(always)]
pub(super) fn store3<V: Lanes>(v: [V; 3], to: &mut [F32x16; 3]) {
    for a in 0..3 {
        v[a].store(&mut to[a]);
    }
}

#[inline(always)]
pub(super) fn store9<V: Lanes>(m: &Mat3<V>, to: &mut [F32x16; 9]) {
    for i in 0..3 {
        for j in 0..3 {
            m.0[i][j].store(&mut to[3 * i + j]);
        }
    }
}

/// The cells in use, smallest and largest along each axis, from those of every lane.
#[inline(always)]
pub(super) fn cells_in_use<V: Lanes>(cells: [(V, V); 3]) -> Cells {
    let mut used = [(0, 0); 3];
    for a in 0..3 {
        let (mut low, mut high) = (F32x16::ZERO, F32x16::ZERO);
        cells[a].0.store(&mut low);
        cells[a].1.store(&mut high);
        let (mut least, mut most) = (low.0[0], high.0[0]);
        for lane in 1..LANES {
            least = least.min(low.0[lane]);
            most = most.max(high.0[lane]);
        }
        used[a] = (least as i32, most as i32);
    }
    used
}
