//! Nodes in blocks of 4x4x4: what varies in time.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use crate::simd::F32x16;

/// Nodes of a block.
pub const NODES: usize = 64;

/// One vector per component and x plane of a block; lane `4 z + y`.
pub(crate) type Planes = [[F32x16; 4]; 3];

/// Displacement, velocity and momentum of a block of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C, align(64))]
pub struct NodeBlock {
    /// Displacement from rest, relative to the object's frame [cells].
    pub u: Planes,
    /// Velocity relative to the object's frame [cells/s].
    pub v: Planes,
    /// Momentum over the node's mass, of that velocity [cells/s]: the two are the same but for the mass between nodes
    /// ([`OffDiagonalMass`](crate::off_diagonal::OffDiagonalMass)). That of a node that follows others has no meaning.
    pub p: Planes,
}

impl NodeBlock {
    /// At rest.
    pub const REST: Self = Self {
        u: [[F32x16::ZERO; 4]; 3],
        v: [[F32x16::ZERO; 4]; 3],
        p: [[F32x16::ZERO; 4]; 3],
    };
}

/// Nodes that bear a force, with their weights.
pub(crate) type Bears = [(u32, f32); 27];

/// Displacement and velocity of a node side by side [cells, cells/s], for whoever reads single nodes: three components of each, and
/// two floats without a meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct NodeRow(pub [f32; 8]);

impl NodeRow {
    /// Sum of some nodes by weights.
    #[inline(always)]
    pub fn sum(rows: &[Self], weights: &[(u32, f32)]) -> [f32; 8] {
        let mut sum = [0.0; 8];
        for &(slot, weight) in weights {
            let row = &rows[slot as usize].0;
            for n in 0..8 {
                sum[n] += weight * row[n];
            }
        }
        sum
    }

    /// All nodes of some blocks.
    pub fn of(nodes: &[NodeBlock]) -> Vec<Self> {
        let mut rows = vec![Self::default(); NODES * nodes.len()];
        let blocks = rows.chunks_exact_mut(NODES).zip(nodes);
        blocks.for_each(|(rows, block)| block.write_rows(rows));
        rows
    }

    /// Sum of the nodes about a place, of the first `N` floats: planes of nodes one by one, which do not wait for each other.
    #[inline(always)]
    pub fn about<const N: usize>(rows: &[Self], bears: &Bears) -> [f32; N] {
        let mut sums = [[0.0; N]; 3];
        for n in 0..9 {
            for (plane, sum) in sums.iter_mut().enumerate() {
                let (slot, weight) = bears[9 * plane + n];
                let row = &rows[slot as usize].0;
                for a in 0..N {
                    sum[a] += weight * row[a];
                }
            }
        }
        let [low, middle, high] = sums;
        std::array::from_fn(|a| low[a] + middle[a] + high[a])
    }
}

impl NodeBlock {
    /// Speed of the fastest node [cells/s].
    pub fn fastest(&self) -> f32 {
        let mut largest = [0.0_f32; 16];
        let [u, v, w] = &self.v;
        for ((u, v), w) in u.iter().zip(v).zip(w) {
            for (n, largest) in largest.iter_mut().enumerate() {
                let (u, v, w) = (u.0[n], v.0[n], w.0[n]);
                *largest = largest.max(u * u + v * v + w * w);
            }
        }
        largest.into_iter().fold(0.0, f32::max).sqrt()
    }

    /// Writes all nodes side by side.
    #[inline(always)]
    pub fn write_rows(&self, rows: &mut [NodeRow]) {
        for (x, rows) in rows.chunks_exact_mut(16).enumerate() {
            let [u, v] = [&self.u, &self.v].map(|of| [&of[0][x].0, &of[1][x].0, &of[2][x].0]);
            for (n, row) in rows.iter_mut().enumerate() {
                row.0 = [
                    u[0][n], u[1][n], u[2][n], v[0][n], v[1][n], v[2][n], 0.0, 0.0,
                ];
            }
        }
    }
}

/// What holds and pushes nodes, per block.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    /// Cell size over mass [m/kg]; 0 where a node has none, or has its velocity given.
    pub w: Vec<[F32x16; 4]>,
    /// External force over the squared cell size per node, and a float without a meaning [Pa].
    pub force: Vec<[f32; 4]>,
    /// Whether there is any in a block.
    pub forced: Vec<bool>,
    /// Per outer node whether it follows inner ones, and has not its own velocity given.
    pub follows: Vec<bool>,
}

impl Conditions {
    /// Takes all forces away.
    pub fn clear_forces(&mut self) {
        for (force, forced) in self.force.chunks_exact_mut(NODES).zip(&mut self.forced) {
            if std::mem::take(forced) {
                force.fill([0.0; 4]);
            }
        }
    }

    /// Adds a force over the squared cell size [Pa] on a node.
    pub fn add_force(&mut self, slot: usize, force: [f32; 3]) {
        let sum = &mut self.force[slot];
        for a in 0..3 {
            sum[a] += force[a];
        }
        self.forced[slot / NODES] = true;
    }

    /// Adds a force over the squared cell size [Pa] on nodes that share it by weights.
    #[inline(always)]
    pub fn share_force(&mut self, bears: &[(u32, f32)], [x, y, z]: [f32; 3]) {
        let force = [x, y, z, 0.0];
        for &(slot, weight) in bears {
            let slot = slot as usize;
            let sum = &mut self.force[slot];
            for a in 0..4 {
                sum[a] += weight * force[a];
            }
            self.forced[slot / NODES] = true;
        }
    }
}

/// Place of a node in its block: x plane and lane.
#[inline(always)]
pub fn place(x: usize, y: usize, z: usize) -> [usize; 2] {
    [x, 4 * z + y]
}

/// Number of a node: its block, then x plane and lane.
#[inline(always)]
pub fn slot(block: usize, [x, lane]: [usize; 2]) -> usize {
    NODES * block + 16 * x + lane
}

/// Place of a node by its number [cells], with blocks at `places`.
pub(crate) fn place_in_cells(places: &[[i32; 3]], slot: usize) -> [i32; 3] {
    let local = [slot / 16 % 4, slot % 4, slot / 4 % 4];
    std::array::from_fn(|a| 4 * places[slot / NODES][a] + local[a] as i32)
}

/// Number of the node at a place [cells], with blocks at `places` in lexicographic order; none where there is no block.
pub(crate) fn node_at(places: &[[i32; 3]], at: [i32; 3]) -> Option<usize> {
    let block = places.binary_search(&at.map(|x| x.div_euclid(4))).ok()?;
    let [x, y, z] = at.map(|x| x.rem_euclid(4) as usize);
    Some(slot(block, place(x, y, z)))
}

/// Reads a vector of a node by its number.
#[inline(always)]
pub fn read(planes: &Planes, slot: usize) -> [f32; 3] {
    let (x, lane) = (slot / 16 % 4, slot % 16);
    [
        planes[0][x].0[lane],
        planes[1][x].0[lane],
        planes[2][x].0[lane],
    ]
}

/// Writes a vector of a node by its number.
#[inline(always)]
pub fn write(planes: &mut Planes, slot: usize, value: [f32; 3]) {
    let (x, lane) = (slot / 16 % 4, slot % 16);
    for a in 0..3 {
        planes[a][x].0[lane] = value[a];
    }
}
