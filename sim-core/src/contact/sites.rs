//! Nodes that two objects share, with the direction from one to the other: the gradients of their masses.

use rayon::prelude::*;

use crate::{
    grid::{Grid, NONE, Shared, Velocities, anchors::Anchors},
    mat3::unit,
};

/// Nodes along an edge of a block with one more on each side.
const HALO: usize = 6;

/// Where node blocks of two fields lie over each other and share nodes.
#[derive(Clone, Debug)]
pub(super) struct ContactBlock {
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
    /// Position of its first node in [`ContactBlocks::nodes`].
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
}

/// All nodes that objects share in one substep.
#[derive(Clone, Debug, Default)]
pub(super) struct ContactBlocks {
    /// Ordered by place, then fields.
    pub sites: Vec<ContactBlock>,
    /// Site after site.
    pub nodes: Vec<Node>,
}

impl ContactBlock {
    /// Its nodes in [`ContactBlocks::nodes`].
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

/// Numbers of the bits that are set, ascending.
pub(super) fn members(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let at = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (at < 64).then_some(at)
    })
}

/// Velocity [cells/s] and mass of a node.
pub(super) fn read(block: &Velocities, at: usize) -> ([f64; 3], f64) {
    let row = &block.0[at / 4].0[4 * (at % 4)..][..4];
    ([0, 1, 2].map(|a| f64::from(row[a])), f64::from(row[3]))
}

impl ContactBlocks {
    /// Finds them. `specific_volumes` is per field the rest volume per mass, up to a common factor.
    pub fn find(grid: &Grid, specific_volumes: &[f64], anchors: &Anchors<'_>) -> Self {
        let found: Vec<(ContactBlock, Vec<Node>)> = grid
            .shared
            .par_iter()
            .enumerate()
            .flat_map_iter(|(shared, place)| {
                at_place(grid, specific_volumes, anchors, shared, place)
            })
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
    specific_volumes: &[f64],
    anchors: &Anchors<'_>,
    shared: usize,
    place: &Shared,
) -> Vec<(ContactBlock, Vec<Node>)> {
    let sharers = &grid.sharers[place.nodes.clone()];
    let around = &grid.around[place.nodes.clone()];
    // At most places no node has mass of two: particles may drift further than they did.
    let (mut once, mut twice) = (0, 0);
    for &block in sharers {
        let bits = occupied(&grid.velocities[block as usize]);
        twice |= once & bits;
        once |= bits;
    }
    if twice == 0 {
        return vec![];
    }
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
            let fields = blocks.map(|block| grid.nodes[block].field);
            for n in [one, two] {
                gradients[n].get_or_insert_with(|| Gradients::new(grid, anchors, &around[n]));
            }
            let [Some(of_a), Some(of_b)] = [one, two].map(|n| gradients[n].as_ref()) else {
                continue;
            };
            let scale = fields.map(|field| specific_volumes[field as usize]);
            let mut nodes = Vec::with_capacity(mask.count_ones() as usize);
            let mut row = (usize::MAX, [[[0.0; 4]; 3]; 2]);
            for at in members(mask) {
                if row.0 != at / 4 {
                    row = (at / 4, [of_a.row(at / 4), of_b.row(at / 4)]);
                }
                let [up_a, up_b] = &row.1;
                let mut way = [0.0; 3];
                for a in 0..3 {
                    way[a] = scale[1] * up_b[a][at % 4] - scale[0] * up_a[a][at % 4];
                }
                nodes.push(Node {
                    at,
                    mass: blocks.map(|block| read(&grid.velocities[block], at).1),
                    normal: unit(way),
                });
            }
            let site = ContactBlock {
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

/// Masses of the matter of a block and of the nodes around it.
#[derive(Clone, Debug)]
struct Gradients([f32; HALO * HALO * HALO]);

impl Gradients {
    /// From the node blocks around a block.
    fn new(grid: &Grid, anchors: &Anchors<'_>, around: &[u32; 27]) -> Self {
        let mut mass = [0.0; HALO * HALO * HALO];
        for i in 0..HALO {
            for j in 0..HALO {
                let [x, y] = [i + 3, j + 3];
                let column = 9 * (x / 4) + 3 * (y / 4);
                let row = &mut mass[(i * HALO + j) * HALO..][..HALO];
                // The last node of the block below, those of the block, the first of the block above.
                for (block, from, to) in [(0, 3, 0..1), (1, 0, 1..5), (2, 0, 5..6)] {
                    let block = around[column + block];
                    if block != NONE {
                        let (n, line) = (block as usize, 4 * (x % 4) + y % 4);
                        let nodes = &grid.velocities[n].0[line].0;
                        for (at, mass) in (from..).zip(&mut row[to]) {
                            let weighs = f64::from(nodes[4 * at + 3]);
                            *mass = anchors.matter(n, &grid.nodes[n], 4 * line + at, weighs) as f32;
                        }
                    }
                }
            }
        }
        Self(mass)
    }

    /// Gradients of mass at the four nodes of a row of the block, per axis, up to a factor: central differences, averaged
    /// across with the weights 1, 2, 1, so that particles in rows do not show.
    fn row(&self, row: usize) -> [[f64; 4]; 3] {
        const ACROSS: [f64; 3] = [1.0, 2.0, 1.0];
        let mut up = [[0.0; 4]; 3];
        for x in 0..3 {
            for y in 0..3 {
                let start = ((row / 4 + x) * HALO + row % 4 + y) * HALO;
                let mut m = [0.0; HALO];
                for (m, mass) in m.iter_mut().zip(&self.0[start..]) {
                    *m = f64::from(*mass);
                }
                let [along_x, along_y] = [x, y].map(|n| n as f64 - 1.0);
                for z in 0..3 {
                    let along_z = z as f64 - 1.0;
                    // In the same order for every node. All factors are powers of two.
                    if x != 1 {
                        let share = along_x * ACROSS[y] * ACROSS[z];
                        for k in 0..4 {
                            up[0][k] += m[k + z] * share;
                        }
                    }
                    if y != 1 {
                        let share = along_y * ACROSS[x] * ACROSS[z];
                        for k in 0..4 {
                            up[1][k] += m[k + z] * share;
                        }
                    }
                    if z != 1 {
                        let share = along_z * ACROSS[x] * ACROSS[y];
                        for k in 0..4 {
                            up[2][k] += m[k + z] * share;
                        }
                    }
                }
            }
        }
        up
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::random;

    #[test]
    fn gradients_of_a_row_are_those_of_its_nodes_to_the_bit() {
        const ACROSS: [f64; 3] = [1.0, 2.0, 1.0];
        let mut seed = 3;
        let masses = std::array::from_fn(|_| (random(&mut seed).max(0.0) * 2.0) as f32);
        let gradients = Gradients(masses);
        for at in 0..64 {
            let mut up = [0.0; 3];
            for n in 0..27 {
                let offset = [n / 9, n / 3 % 3, n % 3];
                let [i, j, k] = [0, 1, 2].map(|a| coordinates(at)[a] as usize + offset[a]);
                let m = f64::from(masses[(i * HALO + j) * HALO + k]);
                for a in 0..3 {
                    let across = ACROSS[offset[(a + 1) % 3]] * ACROSS[offset[(a + 2) % 3]];
                    up[a] += m * (offset[a] as f64 - 1.0) * across;
                }
            }
            let row = gradients.row(at / 4);
            assert_eq!([0, 1, 2].map(|a| row[a][at % 4]), up, "node {at}");
        }
    }

    #[test]
    fn members_of_a_mask_come_in_order() {
        let mask = 1 << 63 | 0b1010_0001;
        assert_eq!(members(mask).collect::<Vec<_>>(), [0, 5, 7, 63]);
        assert_eq!(members(0).count(), 0);
    }
}
