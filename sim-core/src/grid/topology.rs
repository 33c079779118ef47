//! Which node blocks exist, and who neighbours whom.

use rayon::prelude::*;

use super::{Grid, NO_CELLS, NONE, NodeBlock, Shared, Tile, Velocities, boundary::covers_block};
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

/// Field and block index.
pub(super) type Place = (u32, [i32; 3]);

/// Positions in `sorted` of the blocks at the 27 offsets from a place in its field, or [`NONE`].
fn neighbours<T>(sorted: &[T], (field, index): Place, key: impl Fn(&T) -> Place) -> [u32; 27] {
    let mut found = [NONE; 27];
    for column in 0..9 {
        // The three blocks of a column along z follow one another: one search finds them all.
        let start = shifted(index, OFFSETS[3 * column]);
        let first = sorted.partition_point(|item| key(item) < (field, start));
        for (at, item) in (first..).zip(&sorted[first..]).take(3) {
            let (its_field, [x, y, z]) = key(item);
            let k = z - start[2];
            if its_field == field && [x, y] == start[..2] && k < 3 {
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
        let mut places: Vec<Place> = Vec::with_capacity(27 * blocks.len());
        for block in blocks {
            places.extend(OFFSETS.map(|offset| (block.field, shifted(block.index, offset))));
        }
        places.par_sort_unstable();
        places.dedup();
        self.nodes = places
            .par_iter()
            .map(|&(field, index)| NodeBlock {
                field,
                index,
                tiles: neighbours(blocks, (field, index), |block| (block.field, block.index)),
                constrained: covers_block(fixed, index),
            })
            .collect();
        self.nodes_of = blocks
            .par_iter()
            .map(|block| neighbours(&places, (block.field, block.index), |&place| place))
            .collect();
        self.tiles.resize(blocks.len(), Tile::ZERO);
        self.cells.clear();
        self.cells.resize(blocks.len(), NO_CELLS);
        self.velocities
            .resize(self.nodes.len(), Velocities([F32x16::ZERO; 16]));
        self.find_shared();
    }

    /// Lists the places where fields meet.
    fn find_shared(&mut self) {
        self.shared.clear();
        self.sharers.clear();
        self.around.clear();
        let nodes = &self.nodes;
        if nodes.first().map(|n| n.field) == nodes.last().map(|n| n.field) {
            return;
        }
        let mut order: Vec<u32> = (0..nodes.len() as u32).collect();
        order.par_sort_unstable_by_key(|&n| (nodes[n as usize].index, nodes[n as usize].field));
        for here in order.chunk_by(|&a, &b| nodes[a as usize].index == nodes[b as usize].index) {
            if here.len() > 1 {
                let start = self.sharers.len();
                self.sharers.extend_from_slice(here);
                self.shared.push(Shared {
                    index: nodes[here[0] as usize].index,
                    nodes: start..self.sharers.len(),
                });
            }
        }
        self.around = self
            .sharers
            .par_iter()
            .map(|&block| neighbours_of(&self.nodes, block as usize))
            .collect();
    }
}

/// Positions in `nodes` of the node blocks of the same field around one, or [`NONE`].
fn neighbours_of(nodes: &[NodeBlock], block: usize) -> [u32; 27] {
    let here = &nodes[block];
    neighbours(nodes, (here.field, here.index), |node| {
        (node.field, node.index)
    })
}
