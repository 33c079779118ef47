//! Nodes that two objects share, with the direction from one to the other: the gradients of their masses.

use rayon::prelude::*;

use crate::{
    grid::{Grid, NONE, Shared, Velocities},
    mat3::dot,
};

/// Nodes of a block.
pub(super) const NODES: usize = 64;
/// Nodes along an edge of a block with one more on each side.
const HALO: usize = 6;

/// Where node blocks of two fields lie over each other and share nodes.
#[derive(Clone, Debug)]
pub(super) struct Site {
    /// Position in [`Grid::shared`].
    pub shared: usize,
    /// The fields, the lower first: sides `a` and `b`.
    pub fields: [u32; 2],
    /// Block index.
    pub index: [i32; 3],
    /// Positions in [`Grid::nodes`].
    pub blocks: [usize; 2],
    /// Nodes that have mass of both, one bit each, z fastest.
    pub mask: u64,
    /// Position of its first node in [`Sites::nodes`].
    pub first: usize,
}

/// A node with mass of two fields.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Number within its block, z fastest.
    pub at: usize,
    /// Masses of both sides, in units of the heaviest particle.
    pub mass: [f64; 2],
    /// Direction from `a` to `b`, of length 1; zero where the masses tell none.
    pub normal: [f64; 3],
    /// Distance of the surfaces along the normal [cells]; infinite where one is out of reach.
    pub gap: f64,
}

impl Node {
    /// Reduced mass.
    pub fn weight(&self) -> f64 {
        let [a, b] = self.mass;
        a * b / (a + b)
    }
}

/// All nodes that objects share in one substep.
#[derive(Clone, Debug, Default)]
pub(super) struct Sites {
    /// Ordered by place, then fields.
    pub sites: Vec<Site>,
    /// Site after site.
    pub nodes: Vec<Node>,
}

impl Site {
    /// Which of its nodes one of the block that is in the mask is.
    pub fn rank(&self, at: usize) -> usize {
        (self.mask & ((1 << at) - 1)).count_ones() as usize
    }

    /// Its nodes in [`Sites::nodes`].
    pub fn range(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.mask.count_ones() as usize
    }

    /// Coordinates of a node [cells].
    pub fn position(&self, at: usize) -> [f64; 3] {
        let local = coordinates(at);
        std::array::from_fn(|a| f64::from(4 * self.index[a] + local[a]))
    }
}

/// Place of a node within its block.
pub(super) fn coordinates(at: usize) -> [i32; 3] {
    [at / 16, at / 4 % 4, at % 4].map(|i| i as i32)
}

/// Velocity [cells/s] and mass of a node.
pub(super) fn read(block: &Velocities, at: usize) -> ([f64; 3], f64) {
    let row = &block.0[at / 4].0[4 * (at % 4)..][..4];
    ([0, 1, 2].map(|a| f64::from(row[a])), f64::from(row[3]))
}

impl Sites {
    /// Finds them. `fullness` is per field what to multiply mass by to get volume, up to a common factor.
    pub fn find(grid: &Grid, fullness: &[f64]) -> Self {
        let found: Vec<(Site, Vec<Node>)> = grid
            .shared
            .par_iter()
            .enumerate()
            .flat_map_iter(|(shared, place)| at_place(grid, fullness, shared, place))
            .collect();
        let mut all = Self::default();
        for (mut site, nodes) in found {
            site.first = all.nodes.len();
            all.nodes.extend(nodes);
            all.sites.push(site);
        }
        all
    }
}

/// Sites of one place, in the order of fields.
fn at_place(
    grid: &Grid,
    fullness: &[f64],
    shared: usize,
    place: &Shared,
) -> Vec<(Site, Vec<Node>)> {
    let sharers = &grid.sharers[place.nodes.clone()];
    let around = &grid.around[place.nodes.clone()];
    let occupied: Vec<u64> = sharers
        .iter()
        .map(|&block| occupied(&grid.velocities[block as usize]))
        .collect();
    let mut gradients: Vec<Option<Gradients>> = vec![None; sharers.len()];
    let mut found = vec![];
    for one in 0..sharers.len() {
        for two in one + 1..sharers.len() {
            let mask = occupied[one] & occupied[two];
            if mask == 0 {
                continue;
            }
            let blocks = [one, two].map(|n| sharers[n] as usize);
            for n in [one, two] {
                gradients[n].get_or_insert_with(|| Gradients::new(grid, &around[n]));
            }
            let fields = blocks.map(|block| grid.nodes[block].field);
            let [Some(of_a), Some(of_b)] = [one, two].map(|n| gradients[n].as_ref()) else {
                continue;
            };
            let scale = fields.map(|field| fullness[field as usize]);
            let nodes = (0..NODES).filter(|at| mask >> at & 1 == 1);
            let nodes = nodes.map(|at| {
                let (up_a, up_b) = (of_a.at(at), of_b.at(at));
                let way = std::array::from_fn(|a| scale[1] * up_b[a] - scale[0] * up_a[a]);
                Node {
                    at,
                    mass: blocks.map(|block| read(&grid.velocities[block], at).1),
                    normal: unit(way),
                    gap: f64::NEG_INFINITY,
                }
            });
            let nodes = nodes.collect();
            let site = Site {
                shared,
                fields,
                index: place.index,
                blocks,
                mask,
                first: 0,
            };
            found.push((site, nodes));
        }
    }
    found
}

/// A vector of length 1 in the same direction; zero where there is none.
pub(super) fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 && length.is_finite() {
        v.map(|v| v / length)
    } else {
        [0.0; 3]
    }
}

/// Nodes with mass, one bit each.
fn occupied(block: &Velocities) -> u64 {
    let mut bits = 0;
    for (row, nodes) in block.0.iter().enumerate() {
        for k in 0..4 {
            bits |= u64::from(nodes.0[4 * k + 3] > super::LIGHTEST) << (4 * row + k);
        }
    }
    bits
}

/// Masses of a block and of the nodes around it.
#[derive(Clone, Debug)]
struct Gradients([f32; HALO * HALO * HALO]);

impl Gradients {
    /// From the node blocks around a block.
    fn new(grid: &Grid, around: &[u32; 27]) -> Self {
        let mut mass = [0.0; HALO * HALO * HALO];
        for i in 0..HALO {
            for j in 0..HALO {
                for k in 0..HALO {
                    let [x, y, z] = [i, j, k].map(|n| n + 3);
                    let neighbour = around[9 * (x / 4) + 3 * (y / 4) + z / 4];
                    if neighbour != NONE {
                        let row = &grid.velocities[neighbour as usize].0[4 * (x % 4) + y % 4];
                        mass[(i * HALO + j) * HALO + k] = row.0[4 * (z % 4) + 3];
                    }
                }
            }
        }
        Self(mass)
    }

    /// Gradient of mass at a node of the block, up to a factor: central differences, averaged across with the
    /// weights 1, 2, 1, so that particles in rows do not show.
    fn at(&self, at: usize) -> [f64; 3] {
        const ACROSS: [f64; 3] = [1.0, 2.0, 1.0];
        let [i, j, k] = coordinates(at).map(|c| c as usize);
        let mut up = [0.0; 3];
        for x in 0..3 {
            for y in 0..3 {
                for z in 0..3 {
                    let m = f64::from(self.0[((i + x) * HALO + j + y) * HALO + k + z]);
                    let offset = [x, y, z].map(|n| n as f64 - 1.0);
                    up[0] += m * offset[0] * ACROSS[y] * ACROSS[z];
                    up[1] += m * offset[1] * ACROSS[x] * ACROSS[z];
                    up[2] += m * offset[2] * ACROSS[x] * ACROSS[y];
                }
            }
        }
        up
    }
}
