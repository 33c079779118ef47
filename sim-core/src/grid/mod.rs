//! Sparse background grid: blocks of 4x4x4 nodes, and the private tiles that particle blocks scatter into.

pub(crate) mod boundary;
mod node_pass;
mod topology;

pub(crate) use node_pass::node_pass;
pub(crate) use topology::OFFSETS;

use crate::simd::F32x16;

/// Nodes along one edge of a tile: a block, the stencil's reach and one cell of drift on each side.
pub(crate) const TILE: usize = 8;
/// Floats before the first node, so that a row may be read from two nodes earlier.
pub(crate) const FRONT: usize = 16;
/// Floats of a tile: nodes of four floats, padded at both ends.
pub(crate) const TILE_FLOATS: usize = FRONT + 4 * TILE * TILE * TILE + 16;

/// No block there.
pub(crate) const NONE: u32 = u32::MAX;

/// Nodes -2..=5 around a block, z fastest, four floats each: momentum and mass on the way to the grid, velocity
/// and one unused on the way back.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct TileFloats(pub [f32; TILE_FLOATS]);

impl TileFloats {
    /// All zero.
    pub const ZERO: Self = Self([0.0; TILE_FLOATS]);
}

/// What the particles of one block bring to the grid.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    /// Momentum and mass of the nodes.
    pub floats: TileFloats,
    /// Cell indices -1..=4 of the particles inside, smallest and largest along each axis; the nodes in use
    /// reach one further.
    pub cells: [(i32, i32); 3],
}

impl Tile {
    /// A tile that no particle touches.
    pub const EMPTY: Self = Self {
        floats: TileFloats::ZERO,
        cells: [(99, -99); 3],
    };

    /// Forgets all particles.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.floats.0.fill(0.0);
        self.cells = Self::EMPTY.cells;
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
    /// Block index: its first node is 4 times this.
    pub index: [i32; 3],
    /// Particle blocks around it, offsets -1..=1 per axis, z fastest, or [`NONE`].
    pub tiles: [u32; 27],
    /// Whether a collider or region that always acts in one place covers one of its nodes.
    pub constrained: bool,
}

/// Node velocities [cells/s] of one node block: rows of four nodes along z, x slowest.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Velocities(pub [F32x16; 16]);

/// The grid that belongs to one sorted arrangement of particles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid {
    /// One per particle block.
    pub tiles: Vec<Tile>,
    /// Per particle block the node blocks around it, like [`NodeBlock::tiles`].
    pub nodes_of: Vec<[u32; 27]>,
    /// All node blocks in lexicographic order.
    pub nodes: Vec<NodeBlock>,
    /// Like `nodes`.
    pub velocities: Vec<Velocities>,
}
