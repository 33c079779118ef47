//! Nodes in blocks of 4x4x4: what varies in time.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use crate::simd::F32x16;

/// Nodes of a block.
pub(crate) const NODES: usize = 64;

/// One vector per component and x plane of a block; lane `4 z + y`.
pub(crate) type Planes = [[F32x16; 4]; 3];

/// Displacement and velocity of a block of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C, align(64))]
pub(crate) struct NodeBlock {
    /// Displacement from rest, relative to the object's frame [cells].
    pub u: Planes,
    /// Velocity relative to the object's frame [cells/s].
    pub v: Planes,
}

impl NodeBlock {
    /// At rest.
    pub const REST: Self = Self {
        u: [[F32x16::ZERO; 4]; 3],
        v: [[F32x16::ZERO; 4]; 3],
    };
}

/// What holds and pushes nodes, per block.
#[derive(Clone, Debug, Default)]
pub(crate) struct Conditions {
    /// Cell size over mass [m/kg]; 0 where a node has none, or has its velocity given.
    pub w: Vec<[F32x16; 4]>,
    /// External force over the squared cell size [Pa].
    pub force: Vec<Planes>,
    /// Whether there is any in a block.
    pub forced: Vec<bool>,
    /// Per outer node whether it follows inner ones, and has not its own velocity given.
    pub follows: Vec<bool>,
}

impl Conditions {
    /// Takes all forces away.
    pub fn clear_forces(&mut self) {
        for (force, forced) in self.force.iter_mut().zip(&mut self.forced) {
            if std::mem::take(forced) {
                *force = [[F32x16::ZERO; 4]; 3];
            }
        }
    }

    /// Adds a force over the squared cell size [Pa] on a node.
    pub fn add_force(&mut self, slot: usize, force: [f32; 3]) {
        let block = slot / NODES;
        let sum = read(&self.force[block], slot);
        write(
            &mut self.force[block],
            slot,
            std::array::from_fn(|a| sum[a] + force[a]),
        );
        self.forced[block] = true;
    }
}

/// Place of a node in its block: x plane and lane.
#[inline(always)]
pub(crate) fn place(x: usize, y: usize, z: usize) -> [usize; 2] {
    [x, 4 * z + y]
}

/// Number of a node: its block, then x plane and lane.
#[inline(always)]
pub(crate) fn slot(block: usize, [x, lane]: [usize; 2]) -> usize {
    NODES * block + 16 * x + lane
}

/// Reads a vector of a node by its number.
#[inline(always)]
pub(crate) fn read(planes: &Planes, slot: usize) -> [f32; 3] {
    let (x, lane) = (slot / 16 % 4, slot % 16);
    [
        planes[0][x].0[lane],
        planes[1][x].0[lane],
        planes[2][x].0[lane],
    ]
}

/// Writes a vector of a node by its number.
#[inline(always)]
pub(crate) fn write(planes: &mut Planes, slot: usize, value: [f32; 3]) {
    let (x, lane) = (slot / 16 % 4, slot % 16);
    for a in 0..3 {
        planes[a][x].0[lane] = value[a];
    }
}
