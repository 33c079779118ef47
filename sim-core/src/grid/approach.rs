//! How near particles are to colliders that act on nodes, for every node that they reach.

use rayon::prelude::*;

use super::{NONE, NodeBlock, TILE, boundary::near_block, topology::OFFSETS};
use crate::{
    colliders::{
        NodeConditions,
        approach::{Nearest, RADIUS_MAX, RANGE},
    },
    particles::{BLOCK, Block, Particles, position_in_cells},
    simd::LANES,
};

/// Nodes of a tile.
const NODES: usize = TILE * TILE * TILE;
/// Particle blocks per task at least.
const TASK: usize = 16;

/// What the particles of one block are near to: ids of colliders, and what the nodes -2..=5 around the block see.
pub(crate) type Approach = Vec<(usize, Box<[Nearest; NODES]>)>;

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

/// Finds what the particles of every block are near to; `cells_per_mass` is the volume of a unit of mass per part.
pub(crate) fn approaches(
    particles: &Particles,
    cells_per_mass: &[f64],
    boundaries: &NodeConditions<'_>,
) -> Vec<Approach> {
    let blocks = particles.blocks.par_iter().with_min_len(TASK);
    blocks
        .map(|block| approach(block, particles, cells_per_mass, boundaries))
        .collect()
}

fn approach(
    block: &Block,
    particles: &Particles,
    cells_per_mass: &[f64],
    boundaries: &NodeConditions<'_>,
) -> Approach {
    let mut found = Approach::new();
    // Cells of the block, and as far as particles may drift.
    let min = block.index.map(|i| f64::from(BLOCK * i) - 1.5);
    let max = block.index.map(|i| f64::from(BLOCK * (i + 1)) + 0.5);
    for body in boundaries.bodies() {
        if !body.is_near(min, max, RANGE + RADIUS_MAX) {
            continue;
        }
        let mut nodes: Option<Box<[Nearest; NODES]>> = None;
        for run in &particles.runs[block.runs.clone()] {
            for g in run.groups.clone() {
                let (mass, x) = (&particles.fixed[g].mass.0, &particles.groups[g].x);
                for lane in (0..LANES).filter(|&lane| mass[lane] > 0.0) {
                    let local = [x[0].0[lane], x[1].0[lane], x[2].0[lane]];
                    let volume = f64::from(mass[lane]) * cells_per_mass[run.part];
                    let at = position_in_cells(block.index, local);
                    if let Some(nearest) = body.nearest(at, volume, 1.0) {
                        let nodes = nodes.get_or_insert_with(|| Box::new([Nearest::NONE; NODES]));
                        tell(nodes, local, &nearest);
                    }
                }
            }
        }
        if let Some(nodes) = nodes {
            found.push((body.id, nodes));
        }
    }
    found
}

/// Tells the nodes that a particle reaches how near it is.
fn tell(nodes: &mut [Nearest; NODES], local: [f32; 3], nearest: &Nearest) {
    // Nodes of the tile run from -2 to 5, the block's centre is at 1.5.
    let first = local.map(|x| (x + 1.5).round().clamp(-1.0, 4.0) as i32 + 1);
    let [x, y, z] = first.map(|i| i as usize);
    for i in x..x + 3 {
        for j in y..y + 3 {
            for node in &mut nodes[(i * TILE + j) * TILE + z..][..3] {
                node.take(nearest);
            }
        }
    }
}

impl<'a> Acting<'a> {
    /// What acts on the nodes of a block, if anything does.
    pub fn on(&self, block: &NodeBlock) -> Option<Allowed<'a>> {
        if !block.constrained && !super::boundary::covers_block(self.moving, block.index) {
            return None;
        }
        let mut conditions = near_block(self.boundaries, block.index);
        let tiles = || (0..27).filter(|&n| block.tiles[n] != NONE);
        conditions.retain_bodies(|body| {
            body.holds()
                || tiles().any(|n| {
                    let approach = &self.approaches[block.tiles[n] as usize];
                    approach.iter().any(|(id, _)| *id == body.id)
                })
        });
        if conditions.is_empty() {
            return None;
        }
        let count = conditions.bodies().len();
        let mut nearest = vec![Nearest::NONE; 64 * count];
        for (b, body) in conditions.bodies().iter().enumerate() {
            for n in tiles() {
                for (id, tile) in &self.approaches[block.tiles[n] as usize] {
                    if *id == body.id {
                        join(&mut nearest[b..], count, tile, OFFSETS[n]);
                    }
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
fn join(nearest: &mut [Nearest], count: usize, tile: &[Nearest; NODES], offset: [i32; 3]) {
    for (n, nearest) in nearest.iter_mut().step_by(count).enumerate() {
        let local = [n / 16, n / 4 % 4, n % 4];
        let at: [i32; 3] = std::array::from_fn(|a| local[a] as i32 - BLOCK * offset[a] + 2);
        if at.iter().all(|i| (0..TILE as i32).contains(i)) {
            let [i, j, k] = at.map(|i| i as usize);
            nearest.take(&tile[(i * TILE + j) * TILE + k]);
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
        let local = [at / 16, at / 4 % 4, at % 4];
        let x = std::array::from_fn(|a| f64::from(BLOCK * self.index[a] + local[a] as i32));
        let count = self.conditions.bodies().len();
        let nearest = &self.nearest[count * at..][..count];
        self.conditions.constrain(x, v, nearest, self.dt, 1.0)
    }
}
