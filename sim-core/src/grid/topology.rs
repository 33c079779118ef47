//! Which node blocks exist, and who neighbours whom.

use rayon::prelude::*;

use super::{Boundary, Grid, NONE, NodeBlock, Tile, Velocities};
use crate::{particles::Block, simd::F32x16};

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

fn shifted(index: [i32; 3], offset: [i32; 3]) -> [i32; 3] {
    std::array::from_fn(|a| index[a] + offset[a])
}

impl Grid {
    /// Rebuilds the grid for newly sorted particle blocks.
    pub fn rebuild(&mut self, blocks: &[Block], boundary: &Boundary) {
        let mut indices: Vec<[i32; 3]> = Vec::with_capacity(27 * blocks.len());
        for block in blocks {
            indices.extend(OFFSETS.map(|offset| shifted(block.index, offset)));
        }
        indices.par_sort_unstable();
        indices.dedup();
        let find_block = |index| {
            blocks
                .binary_search_by_key(&index, |block| block.index)
                .map_or(NONE, |at| at as u32)
        };
        self.nodes = indices
            .par_iter()
            .map(|&index| NodeBlock {
                index,
                tiles: OFFSETS.map(|offset| find_block(shifted(index, offset))),
                constrained: boundary.covers_block(index),
            })
            .collect();
        self.nodes_of = blocks
            .par_iter()
            .map(|block| {
                OFFSETS.map(|offset| {
                    indices
                        .binary_search(&shifted(block.index, offset))
                        .map_or(NONE, |at| at as u32)
                })
            })
            .collect();
        self.tiles.resize(blocks.len(), Tile::EMPTY);
        self.velocities
            .resize(self.nodes.len(), Velocities([F32x16::ZERO; 16]));
    }
}
