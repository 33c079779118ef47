//! What stages hand on to each other, and gradients of displacements at the points of sixteen cells.

use super::{SolidLaw, rule::Rule};
use crate::{
    mat3::Mat3,
    simd::{F32x16, Lanes},
    volumes::{Filled, Volumes},
};

pub(super) const O: F32x16 = F32x16::ZERO;

/// A field summed along y and z: `[x plane][kind][2 y + z]`; kinds are the value, twice the slope along y, and that along z.
pub(super) type Summed = [[[F32x16; 4]; 3]; 6];

/// First Piola-Kirchhoff stress times volume [Pa cells^3]: `[2 y + z][x cell][component][axis][x]`.
pub(super) type Stresses = [[[[[F32x16; 2]; 3]; 3]; 4]; 4];

/// Tangent times volume [Pa cells^3]: `[2 y + z][x cell][x]`.
pub(super) type Tangents = [[[F32x16; 2]; 4]; 4];

#[inline(always)]
fn three<V: Lanes>(summed: &Summed, x: usize, kind: usize, q: usize) -> [V; 3] {
    [
        V::load(&summed[x][kind][q]),
        V::load(&summed[x + 1][kind][q]),
        V::load(&summed[x + 2][kind][q]),
    ]
}

/// What a block of points is made of: a law and its volumes, one after the other.
pub(super) struct Matter<'a> {
    pub law: &'a SolidLaw,
    pub volumes: &'a Volumes,
    pub filled: Filled,
}

/// Gradients at the points -S and +S along x of sixteen cells.
#[inline(always)]
pub(super) fn gradients<V: Lanes>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    x: usize,
    q: usize,
) -> [Mat3<V>; 2] {
    let zero = V::splat(0.0);
    let mut out = [Mat3([[zero; 3]; 3]); 2];
    for a in 0..3 {
        let along_x = rule.slopes(three(&summed[a], x, 0, q));
        let along_y = rule.values(three(&summed[a], x, 1, q));
        let along_z = rule.values(three(&summed[a], x, 2, q));
        for n in 0..2 {
            out[n].0[a] = [along_x[n], along_y[n], along_z[n]];
        }
    }
    out
}

/// The deformation gradient over the axes of the grid, of the gradient of displacements.
#[inline(always)]
pub(super) fn deformation<V: Lanes>(rule: &Rule<V>, mut h: Mat3<V>) -> Mat3<V> {
    for a in 0..3 {
        for b in 0..3 {
            h.0[a][b] = h.0[a][b] + rule.rest.0[a][b];
        }
    }
    h
}

/// Where there is no matter, nodes may be anywhere: no displacement there.
#[inline(always)]
pub(super) fn masked<V: Lanes>(h: Mat3<V>, volume: V) -> Mat3<V> {
    let zero = V::splat(0.0);
    Mat3::select(zero.lt(volume), &h, &Mat3([[zero; 3]; 3]))
}
