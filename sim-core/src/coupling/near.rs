//! How near matter is to an obstacle at the nodes that it reaches: its nearest particle tells, as in front of colliders.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{
    CouplingInput,
    obstacle::{GAP_LOOKAHEAD, GapSample, Obstacle},
};
use crate::{
    bodies::vector::Vec3,
    colliders::edge,
    contact::{LARGEST_RADIUS, Radii},
    grid::{Grid, NODES},
    particles::{BLOCK, Block, Particles},
    simd::LANES,
};

/// How far particles may be outside of their block [cells].
const DRIFT: f64 = 1.0;

/// A particle near an obstacle.
struct CandidateParticle {
    /// From the first node of its block [cells].
    inner: Vec3,
    nearest: GapSample,
}

/// The nearest particles of the nodes of some blocks.
pub(super) struct ClosestParticles {
    /// Per node block where its nodes are.
    at: BTreeMap<u32, usize>,
    /// Nodes of a block, z fastest.
    nodes: Vec<[GapSample; NODES]>,
}

impl ClosestParticles {
    /// Node blocks of which some nodes are reached by particles that may touch the obstacle, in ascending order.
    pub fn blocks(&self) -> impl Iterator<Item = usize> {
        self.at.keys().map(|&block| block as usize)
    }

    /// Of the nodes of a block, if any of them is reached by a particle that may touch the obstacle.
    pub fn get(&self, block: usize) -> Option<&[GapSample; NODES]> {
        Some(&self.nodes[*self.at.get(&(block as u32))?])
    }
}

/// The nearest particles of nodes, of all those that may touch an obstacle within the substep, which moves at most
/// at `speed` [m/s].
pub(super) fn near<O: Obstacle>(
    input: &CouplingInput<'_>,
    grid: &Grid,
    obstacle: &O,
    speed: f64,
) -> ClosestParticles {
    let (particles, dx) = (input.particles, input.dx);
    let cells_per_mass = input.fields.cells_per_mass;
    let most = GAP_LOOKAHEAD * dx + input.dt * (input.fastest + speed);
    let blocks = particles.blocks.par_iter().zip(&grid.nodes_of);
    let of_block = |(block, nodes_of)| {
        let found = of_block(particles, cells_per_mass, block, obstacle, most, dx);
        (!found.is_empty()).then_some((found, nodes_of))
    };
    let blocks: Vec<(Vec<CandidateParticle>, &[u32; 27])> = blocks.filter_map(of_block).collect();
    let (mut at, mut nodes) = (BTreeMap::new(), Vec::new());
    for (found, nodes_of) in blocks {
        let mut known = [None; 27];
        for CandidateParticle { inner, nearest } in found {
            reached(inner, |offset, node| {
                let place = *known[offset].get_or_insert_with(|| {
                    *at.entry(nodes_of[offset]).or_insert_with(|| {
                        nodes.push([GapSample::NONE; NODES]);
                        nodes.len() - 1
                    })
                });
                let before: &mut GapSample = &mut nodes[place][node];
                if nearest.gap < before.gap {
                    *before = nearest;
                }
            });
        }
    }
    ClosestParticles { at, nodes }
}

/// The particles of a block with a gap of at most `most`.
fn of_block<O: Obstacle>(
    particles: &Particles,
    cells_per_mass: &[f64],
    block: &Block,
    obstacle: &O,
    most: f64,
    dx: f64,
) -> Vec<CandidateParticle> {
    let mut found = vec![];
    let (center, radius) = obstacle.ball();
    let reach = (radius + most) / dx + LARGEST_RADIUS;
    if block.distance(center.map(|x| x / dx), DRIFT) > reach {
        return found;
    }
    let start: Vec3 = block.index.map(|i| f64::from(BLOCK * i));
    for run in &particles.runs[block.runs.clone()] {
        let mut radii = Radii::new(cells_per_mass[run.part]);
        for g in run.groups.clone() {
            let (mass, x) = (&particles.fixed[g].mass.0, &particles.groups[g].x);
            for lane in (0..LANES).filter(|&lane| mass[lane] > 0.0) {
                let inner: Vec3 = std::array::from_fn(|a| f64::from(x[a].0[lane]) + 1.5);
                let place = [0, 1, 2].map(|a| dx * (start[a] + inner[a]));
                let towards = obstacle.towards(place, most + LARGEST_RADIUS * dx);
                let Some((distance, normal)) = towards else {
                    continue;
                };
                let gap = distance - dx * radii.of(mass[lane]);
                if gap <= most {
                    let nearest = GapSample { gap, normal };
                    found.push(CandidateParticle { inner, nearest });
                }
            }
        }
    }
    found
}

/// The nodes that a particle reaches, given where it is from the first node of its block [cells]: which of the 27 blocks around
/// that, and which node of it.
fn reached(x: Vec3, mut node: impl FnMut(usize, usize)) {
    let [i, j, k] = x.map(|x| edge::nearest_node(x) - 1);
    for i in i..i + 3 {
        for j in j..j + 3 {
            for k in k..k + 3 {
                let [a, b, c] = [i, j, k].map(|n| (n.div_euclid(BLOCK) + 1).clamp(0, 2) as usize);
                let [u, v, w] = [i, j, k].map(|n| n.rem_euclid(BLOCK) as usize);
                node(9 * a + 3 * b + c, 16 * u + 4 * v + w);
            }
        }
    }
}
