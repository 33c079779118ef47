//! Which node blocks exist, and who neighbours whom.

use rayon::prelude::*;

use super::{Grid, NO_CELLS, NONE, NodeBlock, Tile, Velocities, boundary::covers_block};
use crate::{colliders::NodeConditions, particles::Block, simd::F32x16};

/// Neighbour offsets, z fastest.
pub(crate) const OFFSETS: [[i32; 3]; 27] = {
    let mut offsets = [[0; 3]; 27];
    let mut n = 0;
    while n < 27 {
        offsets[n] = [n as i32 / 9 - 1, n as i32 / 3 % 3 - 1, n as i32 % 3 - 1];
        n += 1;
    }
    offsets
};

/// Positions in `sorted` of the blocks at the 27 offsets from `index`, or [`NONE`].
fn neighbours<T>(sorted: &[T], index: [i32; 3], key: impl Fn(&T) -> [i32; 3]) -> [u32; 27] {
    let mut found = [NONE; 27];
    for column in 0..9 {
        // The three blocks of a column along z follow one another: one search finds them all.
        let start = shifted(index, OFFSETS[3 * column]);
        let first = sorted.partition_point(|item| key(item) < start);
        for (at, item) in (first..).zip(&sorted[first..]).take(3) {
            let [x, y, z] = key(item);
            let k = z - start[2];
            if [x, y] == start[..2] && k < 3 {
                found[3 * column + k as usize] = at as u32;
            }
        }
    }
    found
}

fn shifted(index: [i32; 3], offset: [i32; 3]) -> [i32; 3] {
    std::array::from_fn(|a| index[a] + offset[a])
}

impl Grid {
    /// Rebuilds the grid for newly sorted particle blocks; `fixed` is what always acts in one place.
    pub fn rebuild(&mut self, blocks: &[Block], fixed: &NodeConditions<'_>) {
        let mut indices: Vec<[i32; 3]> = Vec::with_capacity(27 * blocks.len());
        for block in blocks {
            indices.extend(OFFSETS.map(|offset| shifted(block.index, offset)));
        }
        indices.par_sort_unstable();
        indices.dedup();
        self.nodes = indices
            .par_iter()
            .map(|&index| NodeBlock {
                index,
                tiles: neighbours(blocks, index, |block| block.index),
                constrained: covers_block(fixed, index),
            })
            .collect();
        self.nodes_of = blocks
            .par_iter()
            .map(|block| neighbours(&indices, block.index, |&index| index))
            .collect();
        self.tiles.resize(blocks.len(), Tile::ZERO);
        self.cells.clear();
        self.cells.resize(blocks.len(), NO_CELLS);
        self.velocities
            .resize(self.nodes.len(), Velocities([F32x16::ZERO; 16]));
    }
}
