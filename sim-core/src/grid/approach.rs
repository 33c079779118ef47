//! How near particles are to colliders that act on nodes, for every node that they reach.

use rayon::prelude::*;

use super::{NONE, NodeBlock, TILE, boundary::near_block, topology::OFFSETS};
use crate::{
    colliders::{
        NodeConditions, Placed,
        approach::{Nearest, RADIUS_MAX, RANGE},
        attach::Attached,
    },
    particles::{BLOCK, Block, NO_PARTICLE, Particles, position_in_cells},
    simd::{F32x16, LANES},
};

/// Nodes of a tile.
const NODES: usize = TILE * TILE * TILE;
/// Cells along an edge in which particles of a block may be, -1..=4.
const CELLS: usize = TILE - 2;
/// Particle blocks per task at least.
const TASK: usize = 16;

/// What the particles of one block are near to: ids of colliders, and what the nodes -2..=5 around the block see.
pub(crate) type Approach = Vec<(usize, Vec<Nearest>)>;

/// Everything that acts on nodes in one substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Acting<'a> {
    /// All colliders and regions.
    pub boundaries: &'a NodeConditions<'a>,
    /// Those that move, or come and go.
    pub moving: &'a NodeConditions<'a>,
    /// Per particle block.
    pub approaches: &'a [Approach],
    /// Substep [s].
    pub dt: f64,
}

/// What acts on one block of nodes.
#[derive(Clone, Debug)]
pub(crate) struct Allowed<'a> {
    conditions: NodeConditions<'a>,
    /// Node by node, for every collider.
    nearest: Vec<Nearest>,
    index: [i32; 3],
    dt: f64,
}

/// Finds what the particles of every block are near to; `half_spacings` is in scene order [cells].
pub(crate) fn approaches(
    particles: &Particles,
    half_spacings: &[f64],
    boundaries: &NodeConditions<'_>,
) -> Vec<Approach> {
    let blocks = particles.blocks.par_iter().with_min_len(TASK);
    blocks
        .map(|block| approach(block, particles, half_spacings, boundaries))
        .collect()
}

fn approach(
    block: &Block,
    particles: &Particles,
    half_spacings: &[f64],
    boundaries: &NodeConditions<'_>,
) -> Approach {
    let mut found = Approach::new();
    // Cells of the block, and as far as particles may drift.
    let min = block.index.map(|i| f64::from(BLOCK * i) - 1.5);
    let max = block.index.map(|i| f64::from(BLOCK * (i + 1)) + 0.5);
    let (mut cells, mut is_used) = ([Nearest::NONE; CELLS * CELLS * CELLS], false);
    for body in boundaries.bodies() {
        if !body.is_near(min, max, RANGE + RADIUS_MAX) {
            continue;
        }
        if std::mem::take(&mut is_used) {
            cells.fill(Nearest::NONE);
        }
        for g in block.groups.clone() {
            let (id, x) = (&particles.fixed[g].id, &particles.groups[g].x);
            if is_out_of_range(body, block.index, x) {
                continue;
            }
            for lane in (0..LANES).filter(|&lane| id[lane] != NO_PARTICLE) {
                let local = [x[0].0[lane], x[1].0[lane], x[2].0[lane]];
                let at = position_in_cells(block.index, local);
                let half_spacing = half_spacings[id[lane] as usize];
                if let Some(nearest) = body.nearest_of(at, half_spacing, 1.0) {
                    is_used = true;
                    // From -1 on, the block's centre is at 1.5; without the library's rounding.
                    let [i, j, k] = local.map(|x| (x + 3.0).clamp(0.0, 5.5) as usize);
                    cells[(i * CELLS + j) * CELLS + k].take(&nearest);
                }
            }
        }
        if is_used {
            found.push((body.id, spread(&cells)));
        }
    }
    found
}

/// Whether none of sixteen particles can be in range: distances change no faster than places do, so that one stands for
/// all. Particles of a group are neighbours.
fn is_out_of_range(body: &Placed<'_>, block: [i32; 3], x: &[F32x16; 3]) -> bool {
    let (mut centre, mut radius) = ([0.0; 3], 0.0);
    for a in 0..3 {
        // Unused lanes are at the block's centre and do no harm. Halving, not one after the other, so that several lanes
        // go at once.
        let (mut min, mut max) = (x[a].0, x[a].0);
        for half in [8, 4, 2, 1] {
            for n in 0..half {
                let (low, high) = (min[n + half], max[n + half]);
                min[n] = if low < min[n] { low } else { min[n] };
                max[n] = if high > max[n] { high } else { max[n] };
            }
        }
        let (min, max) = (min[0], max[0]);
        centre[a] = 0.5 * (min + max);
        radius += f64::from(max - min).powi(2);
    }
    // The centre is rounded to single precision.
    let radius = 0.5 * radius.sqrt() + 1e-5;
    body.distance(position_in_cells(block, centre)).value > RANGE + RADIUS_MAX + radius
}

/// Tells the nodes -2..=5 how near the particles are that reach them: those of the cells around them.
fn spread(cells: &[Nearest; CELLS * CELLS * CELLS]) -> Vec<Nearest> {
    // One axis after the other, with cells by their rank in place of what they hold.
    let mut columns = [u64::MAX; CELLS * CELLS * TILE];
    let mut is_used = [false; CELLS * CELLS];
    for (row, used) in is_used.iter_mut().enumerate() {
        for k in 0..CELLS {
            let rank = rank(cells, CELLS * row + k);
            *used |= rank != u64::MAX;
            for to in &mut columns[TILE * row + k..][..3] {
                *to = rank.min(*to);
            }
        }
    }
    let mut slabs = [u64::MAX; CELLS * TILE * TILE];
    for row in (0..CELLS * CELLS).filter(|&row| is_used[row]) {
        let (i, j) = (row / CELLS, row % CELLS);
        let from = &columns[TILE * row..][..TILE];
        for to in slabs[TILE * (TILE * i + j)..][..3 * TILE].chunks_exact_mut(TILE) {
            take_ranks(to, from);
        }
    }
    let mut ranks = [u64::MAX; NODES];
    for i in (0..CELLS).filter(|i| is_used[CELLS * i..][..CELLS].contains(&true)) {
        let from = &slabs[TILE * TILE * i..][..TILE * TILE];
        for to in ranks[TILE * TILE * i..][..3 * TILE * TILE].chunks_exact_mut(TILE * TILE) {
            take_ranks(to, from);
        }
    }
    let of_rank = |rank| match rank {
        u64::MAX => Nearest::NONE,
        rank => cells[rank as u32 as usize],
    };
    ranks.into_iter().map(of_rank).collect()
}

/// Orders cells by gap, then by number, which is the low half; the largest of all where there is no gap.
fn rank(cells: &[Nearest; CELLS * CELLS * CELLS], cell: usize) -> u64 {
    let gap = cells[cell].gap;
    if gap == f32::INFINITY {
        return u64::MAX;
    }
    // Integers in the order of the floats: negative ones turned round, below the others.
    let bits = gap.to_bits();
    let order = if gap.is_sign_negative() {
        !bits
    } else {
        bits | 1 << 31
    };
    u64::from(order) << 32 | cell as u64
}

fn take_ranks(to: &mut [u64], from: &[u64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = (*to).min(*from);
    }
}

impl<'a> Acting<'a> {
    /// Whether anything may act on the nodes of a block.
    pub fn may_reach(&self, block: &NodeBlock) -> bool {
        block.constrained || super::boundary::covers_block(self.moving, block.index)
    }

    /// What acts on the nodes of a block, if anything does.
    pub fn on(&self, block: &NodeBlock) -> Option<Allowed<'a>> {
        if !self.may_reach(block) {
            return None;
        }
        // What the particle blocks around it are near to; most are near to nothing.
        let mut around: [(usize, &[_]); 27] = [(0, &[]); 27];
        let mut count = 0;
        for n in (0..27).filter(|&n| block.tiles[n] != NONE) {
            around[count] = (n, &self.approaches[block.tiles[n] as usize]);
            count += usize::from(!around[count].1.is_empty());
        }
        let around = &around[..count];
        let mut conditions = near_block(self.boundaries, block.index);
        conditions.retain_bodies(|body| {
            let here = |(id, _): &(usize, _)| *id == body.id;
            body.holds() || around.iter().any(|(_, approach)| approach.iter().any(here))
        });
        if conditions.is_empty() {
            return None;
        }
        let bodies = conditions.bodies();
        let mut nearest = vec![Nearest::NONE; 64 * bodies.len()];
        for &(n, approach) in around {
            for (id, tile) in approach {
                if let Some(b) = bodies.iter().position(|body| body.id == *id) {
                    join(&mut nearest[b..], bodies.len(), tile, OFFSETS[n]);
                }
            }
        }
        Some(Allowed {
            conditions,
            nearest,
            index: block.index,
            dt: self.dt,
        })
    }
}

/// Takes in the tile of the particle block at an offset from a node block.
fn join(nearest: &mut [Nearest], count: usize, tile: &[Nearest], offset: [i32; 3]) {
    // Where they overlap: first and last node in the block's numbers, and what to add for the tile's.
    let shift = offset.map(|o| 2 - BLOCK * o);
    let first = shift.map(|s| (-s).max(0));
    let end = shift.map(|s| (TILE as i32 - s).min(BLOCK));
    for i in first[0]..end[0] {
        for j in first[1]..end[1] {
            for k in first[2]..end[2] {
                let here = (i * BLOCK + j) * BLOCK + k;
                let [x, y, z] = [i + shift[0], j + shift[1], k + shift[2]].map(|i| i as usize);
                nearest[here as usize * count].take(&tile[(x * TILE + y) * TILE + z]);
            }
        }
    }
}

impl Allowed<'_> {
    /// Largest speed that it may give to nodes [cells/s].
    pub fn speed(&self) -> f64 {
        let [first, last] = super::boundary::corners(self.index);
        self.conditions.speed(first, last)
    }

    /// Velocity that the node `at`, 0..64 with z fastest, may have when forces alone would give it `v` [cells/s].
    pub fn constrain(&self, at: usize, v: [f64; 3]) -> [f64; 3] {
        self.constrain_rest(at, &Attached::free(v))
    }

    /// The same where some of it is obeyed already.
    pub fn constrain_rest(&self, at: usize, obeyed: &Attached) -> [f64; 3] {
        let local = [at / 16, at / 4 % 4, at % 4];
        let x = std::array::from_fn(|a| f64::from(BLOCK * self.index[a] + local[a] as i32));
        let count = self.conditions.bodies().len();
        let nearest = &self.nearest[count * at..][..count];
        self.conditions.constrain(x, nearest, self.dt, 1.0, obeyed)
    }

    /// How near matter that reaches a node is to a collider [cells].
    pub fn gap(&self, at: usize, body: usize) -> f64 {
        let bodies = self.conditions.bodies();
        let found = bodies.iter().position(|known| known.id == body);
        found.map_or(f64::INFINITY, |b| {
            self.nearest[bodies.len() * at + b].gap.into()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_sees_the_nearest_of_all_cells_around_it_and_no_other() {
        let mut cells = [Nearest::NONE; CELLS * CELLS * CELLS];
        for (n, cell) in cells.iter_mut().enumerate().filter(|(n, _)| n % 7 < 2) {
            cell.gap = (n * 37 % 101) as f32 - 30.0;
        }
        let nodes = spread(&cells);
        for n in 0..NODES {
            let node = [n / 64, n / 8 % 8, n % 8];
            let sees = |c: &usize| {
                let cell = [c / 36, c / 6 % 6, c % 6];
                (0..3).all(|a| (cell[a]..cell[a] + 3).contains(&node[a]))
            };
            let around = (0..cells.len()).filter(sees).map(|c| cells[c].gap);
            assert_eq!(
                nodes[n].gap,
                around.fold(f32::INFINITY, f32::min),
                "{node:?}"
            );
        }
    }

    #[test]
    fn a_node_block_takes_from_a_tile_what_lies_over_it() {
        let mut tile = vec![Nearest::NONE; NODES];
        for (n, node) in tile.iter_mut().enumerate() {
            node.gap = n as f32;
        }
        for offset in OFFSETS {
            let mut nearest = vec![Nearest::NONE; 64];
            join(&mut nearest, 1, &tile, offset);
            for (n, found) in nearest.iter().enumerate() {
                let local = [n / 16, n / 4 % 4, n % 4];
                let at: [i32; 3] = std::array::from_fn(|a| local[a] as i32 - BLOCK * offset[a] + 2);
                let inside = at.iter().all(|i| (0..8).contains(i));
                let number = (at[0] * 64 + at[1] * 8 + at[2]) as f32;
                let expected = if inside { number } else { f32::INFINITY };
                assert_eq!(found.gap, expected, "{offset:?} {local:?}");
            }
        }
    }
}
