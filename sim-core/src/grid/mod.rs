//! Sparse background grid: blocks of 4x4x4 nodes, and the private tiles that particle blocks scatter into.

pub(crate) mod anchors;
pub(crate) mod approach;
mod attach;
pub(crate) mod boundary;
mod node_pass;
mod topology;

use std::ops::Range;

pub(crate) use node_pass::{node_means, node_pass};
pub(crate) use topology::OFFSETS;

use crate::{
    ledger::ColliderImpulses,
    particles::BLOCK,
    simd::{F32x16, Lanes},
};

/// Nodes along one edge of a tile: a block, the stencil's reach and one cell of drift on each side.
pub(crate) const TILE: usize = 8;
/// Floats before the first node, so that a row may be read from two nodes earlier.
pub(crate) const FRONT: usize = 16;
/// Floats of a tile: nodes of four floats, padded at both ends.
pub(crate) const TILE_FLOATS: usize = FRONT + 4 * TILE * TILE * TILE + 32;

/// Nodes of a block.
pub(crate) const NODES: usize = 64;

/// No block there.
pub(crate) const NONE: u32 = u32::MAX;

/// Nodes -2..=5 around a block, z fastest, four floats each: momentum and mass on the way to the grid, velocity
/// and mass on the way back. Of [packed](Tile::pack) tiles only the nodes in use, one after the other.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Tile(pub [f32; TILE_FLOATS]);

/// Cell indices -1..=4 of the particles of a block, smallest and largest along each axis; the nodes in use reach one
/// further.
pub(crate) type Cells = [(i32, i32); 3];

/// No particle.
pub(crate) const NO_CELLS: Cells = [(99, -99); 3];

impl Tile {
    /// All zero.
    pub const ZERO: Self = Self([0.0; TILE_FLOATS]);

    /// Copies the nodes in use to `to`: most tiles fill half of the space that they are entitled to, and what moves
    /// between caches is what costs.
    #[inline(always)]
    pub fn pack<V: Lanes>(&self, cells: &Cells, to: &mut Self) {
        let [(x0, x1), (y0, y1), (z0, z1)] = *cells;
        if x0 > x1 {
            return;
        }
        let length = 4 * (z1 - z0 + 3) as usize;
        let mut end = FRONT;
        for i in x0 + 1..=x1 + 3 {
            for j in y0 + 1..=y1 + 3 {
                let start = Self::at(i as usize, j as usize, (z0 + 1) as usize);
                // SAFETY: cells are in -1..=4, so a row starts at node 7, 7, 5 or before, and two vectors from there
                // end within the padding. Packed rows are no longer and no more than those of the tile. What the
                // second vector holds beyond its row is overwritten by the next, or is padding that nobody reads.
                unsafe {
                    let (from, to) = (self.0.as_ptr().add(start), to.0.as_mut_ptr().add(end));
                    V::load_at(from).store_at(to);
                    V::load_at(from.add(16)).store_at(to.add(16));
                }
                end += length;
            }
        }
    }

    /// Index of the first float of the node at `i`, `j`, `k` in 0..8.
    #[inline(always)]
    pub fn at(i: usize, j: usize, k: usize) -> usize {
        FRONT + 4 * ((i * TILE + j) * TILE + k)
    }
}

/// A 4x4x4 block of grid nodes that particles reach.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NodeBlock {
    /// Grid field.
    pub field: u32,
    /// Block index: its first node is 4 times this.
    pub index: [i32; 3],
    /// Particle blocks around it, offsets -1..=1 per axis, z fastest, or [`NONE`].
    pub tiles: [u32; 27],
    /// Whether a collider or region that always acts in one place covers one of its nodes.
    pub constrained: bool,
}

/// Node velocities [cells/s] and masses of one node block: rows of four nodes along z, x slowest.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Velocities(pub [F32x16; 16]);

/// Place in the grid of a node of a block, by its number there, z fastest.
pub(crate) fn place_of(block: [i32; 3], at: usize) -> [i32; 3] {
    let local = [at / 16, at / 4 % 4, at % 4];
    std::array::from_fn(|a| BLOCK * block[a] + local[a] as i32)
}

/// A place where node blocks of two or more fields lie over each other.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Shared {
    /// Block index.
    pub index: [i32; 3],
    /// The node blocks, in [`Grid::sharers`], by ascending field.
    pub nodes: Range<usize>,
}

/// The grid that belongs to one sorted arrangement of particles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid {
    /// Momentum and mass that each particle block brings, packed.
    pub tiles: Vec<Tile>,
    /// Cells in use, like `tiles`.
    pub cells: Vec<Cells>,
    /// Per particle block the node blocks around it, like [`NodeBlock::tiles`].
    pub nodes_of: Vec<[u32; 27]>,
    /// All node blocks, ordered by field and index.
    pub nodes: Vec<NodeBlock>,
    /// Places that fields share, ordered by index.
    pub shared: Vec<Shared>,
    /// Positions in `nodes`, place after place.
    pub sharers: Vec<u32>,
    /// Like `sharers`: positions in `nodes` of the node blocks of the same field around each, or [`NONE`].
    pub around: Vec<[u32; 27]>,
    /// Like `nodes`.
    pub velocities: Vec<Velocities>,
    /// Like `nodes`: what colliders gave them in this substep [mass units, cells, s].
    pub given_to_nodes: Vec<ColliderImpulses>,
    /// Like `tiles`: what colliders gave single particles in this substep [mass units, cells, s].
    pub given_to_particles: Vec<ColliderImpulses>,
}
