//! Grid pass: sum the tiles in fixed order, momentum to velocity, boundaries.

use rayon::prelude::*;

use super::{
    Grid, NONE, NodeBlock, Tile, Velocities,
    boundary::{corners, covers_block, near_block},
    topology::OFFSETS,
};
use crate::{
    colliders::NodeConditions,
    particles::BLOCK,
    simd::{F32x16, Isa, Lanes, Portable},
};

#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};

/// Nodes lighter than this share of the heaviest particle stay at rest: their weights are denormal noise.
const LIGHTEST: f32 = 1e-24;

/// Node blocks per task at least.
const TASK: usize = 16;

/// Largest speeds on the grid in one substep [cells/s].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fastest {
    /// Largest component before boundaries, relative to the carrier; NaN or infinite when a node is.
    pub relative: f32,
    /// Of boundaries that touch nodes.
    pub boundary: f32,
}

/// Turns tiles into node velocities. They are relative to the velocity `carrier` [cells/s], which holds all that
/// gravity adds. `moving` are those of `boundaries` that move, or come and go.
///
/// `keep` is what damping leaves of a velocity, 0..=1; the carrier's share of it is the caller's.
pub(crate) fn node_pass(
    isa: Isa,
    grid: &mut Grid,
    boundaries: &NodeConditions<'_>,
    moving: &NodeConditions<'_>,
    carrier: [f64; 3],
    keep: f32,
) -> Fastest {
    let Grid {
        tiles,
        nodes,
        velocities,
        ..
    } = grid;
    let tiles = tiles.as_slice();
    // Magnitudes are compared as integers: NaN is then the largest of all and cannot get lost.
    let largest = nodes
        .par_iter()
        .zip(velocities.par_iter_mut())
        .with_min_len(TASK)
        .map(|(block, out)| {
            let largest = match isa {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: a world is only made with an instruction set that the processor has.
                Isa::Avx512 => unsafe { node_block_avx512(block, tiles, keep, out) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: a world is only made with an instruction set that the processor has.
                Isa::Avx2 => unsafe { node_block_avx2(block, tiles, keep, out) },
                _ => node_block::<Portable>(block, tiles, keep, out),
            };
            let mut given = 0;
            if block.constrained || covers_block(moving, block.index) {
                let near = near_block(boundaries, block.index);
                if !near.is_empty() {
                    let [first, last] = corners(block.index);
                    given = (near.speed(first, last) as f32).to_bits();
                    constrain(block, &near, carrier, out);
                }
            }
            [largest, given]
        })
        .reduce(|| [0; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
    Fastest {
        relative: f32::from_bits(largest[0]),
        boundary: f32::from_bits(largest[1]),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,fma")]
unsafe fn node_block_avx512(
    block: &NodeBlock,
    tiles: &[Tile],
    keep: f32,
    out: &mut Velocities,
) -> u32 {
    node_block::<Avx512>(block, tiles, keep, out)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn node_block_avx2(
    block: &NodeBlock,
    tiles: &[Tile],
    keep: f32,
    out: &mut Velocities,
) -> u32 {
    node_block::<Avx2>(block, tiles, keep, out)
}

/// Sums one node block and divides; returns the largest magnitude of a velocity component as bits.
#[inline(always)]
fn node_block<V: Lanes>(block: &NodeBlock, tiles: &[Tile], keep: f32, out: &mut Velocities) -> u32 {
    let zero = V::broadcast(0.0);
    let truth = |of: fn(usize) -> bool| {
        let lanes = F32x16(std::array::from_fn(|i| f32::from(u8::from(of(i)))));
        zero.lt(V::load(&lanes))
    };
    let first_two_nodes = truth(|i| i < 8);
    let last_two_nodes = truth(|i| i >= 8);
    let everywhere = truth(|_| true);
    let velocity = truth(|i| i % 4 < 3);
    let mut sum = [zero; 16];
    for (offset, &tile) in OFFSETS.iter().zip(&block.tiles) {
        if tile == NONE {
            continue;
        }
        let tile = &tiles[tile as usize];
        // Node n of this block is node n - 4 offset of the particle block: first and last node in use here, and
        // where in the tile node 0 would be.
        let mut first = [0; 3];
        let mut last = [0; 3];
        let mut origin = [0; 3];
        for a in 0..3 {
            let shift = BLOCK * offset[a];
            first[a] = (tile.cells[a].0 - 1 + shift).max(0);
            last[a] = (tile.cells[a].1 + 1 + shift).min(BLOCK - 1);
            origin[a] = 2 - shift;
        }
        if first[2] > last[2] {
            continue;
        }
        // Rows along z that are half in this block are read whole and masked; those in front of it two nodes
        // early.
        let k = [6, 2, -2][(offset[2] + 1) as usize];
        let keep = [first_two_nodes, everywhere, last_two_nodes][(offset[2] + 1) as usize];
        let mut i = first[0];
        while i <= last[0] {
            let mut j = first[1];
            while j <= last[1] {
                let at = Tile::at((i + origin[0]) as usize, (j + origin[1]) as usize, 0);
                // SAFETY: i + origin and j + origin are in 0..8 because the cells of a tile are in -1..=4; reads
                // start at most two nodes before and end two nodes behind the nodes, where tiles are padded.
                let row = unsafe { V::load_at(tile.floats.0.as_ptr().offset(at as isize + 4 * k)) };
                let sum = &mut sum[(BLOCK * i + j) as usize];
                *sum = *sum + V::select(keep, row, zero);
                j += 1;
            }
            i += 1;
        }
    }
    let one = V::broadcast(1.0);
    let keep = V::broadcast(keep);
    let mut largest = zero;
    for (row, to) in sum.iter().zip(&mut out.0) {
        let mass = row.fourth();
        let occupied = V::broadcast(LIGHTEST).lt(mass);
        let v = *row / V::select(occupied, mass, one) * keep;
        let v = V::select(velocity & occupied, v, zero);
        v.store(to);
        largest = largest.larger_magnitude(v);
    }
    largest.largest_magnitude_bits()
}

/// Applies colliders and held regions to the nodes of a block, one by one.
fn constrain(
    block: &NodeBlock,
    boundaries: &NodeConditions<'_>,
    carrier: [f64; 3],
    out: &mut Velocities,
) {
    for (row, nodes) in out.0.iter_mut().enumerate() {
        for (k, node) in nodes.0.chunks_exact_mut(4).enumerate() {
            let local = [row / 4, row % 4, k];
            let x = std::array::from_fn(|a| f64::from(BLOCK * block.index[a] + local[a] as i32));
            let v = std::array::from_fn(|a| f64::from(node[a]) + carrier[a]);
            let v = boundaries.constrain(x, v, 1.0);
            for a in 0..3 {
                node[a] = (v[a] - carrier[a]) as f32;
            }
        }
    }
}
