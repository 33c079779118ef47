//! One substep of the nodes, sixteen points or nodes at a time.
//!
//! Every block of points writes the forces on its 6x6x6 nodes to a tile of its own ([`block`]), and every block of nodes sums the tiles
//! that reach it in the order of their places, so that no result depends on threads.

mod block;
mod rule;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use self::block::{Matter, Scratch, Tile};
use super::{
    model::{NO_BLOCK, SolidModel},
    nodes::{Conditions, NodeBlock},
};
use crate::{
    materials::Law,
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Blocks of points of a task: they share the memory between the stages.
const TASK: usize = 8;

/// A law with its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SolidLaw {
    pub law: Law,
    /// Lamé's first parameter [Pa].
    pub lambda: f64,
    /// Shear modulus [Pa].
    pub mu: f64,
    /// Mass per rest volume [kg/m^3].
    pub density: f64,
}

/// What a substep does besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    /// How long forces act [s].
    pub kick: f32,
    /// How long nodes move after that [s].
    pub drift: f32,
    /// Share of velocities that damping leaves.
    pub keep: f32,
    /// Gravity in the object's frame [cells/s^2].
    pub gravity: [f32; 3],
    /// Time of the viscous stress per strain rate, over Lamé's parameters [s].
    pub viscosity: f32,
    /// Whether [`Extremes::tangent`] is asked for.
    pub wants_extremes: bool,
}

/// What a substep finds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Extremes {
    /// Largest tangent over density [m^2/s^2], if asked for.
    pub tangent: f32,
    /// Largest gradient of the velocity over rest positions [1/s], where there is viscosity.
    pub rate: f32,
    /// Largest component of a node's velocity in the object's frame [cells/s].
    pub speed: f32,
    /// Whether a node is nowhere.
    pub bad: bool,
}

impl Extremes {
    fn join(self, other: Self) -> Self {
        Self {
            tangent: self.tangent.max(other.tangent),
            rate: self.rate.max(other.rate),
            speed: self.speed.max(other.speed),
            bad: self.bad || other.bad,
        }
    }
}

/// The tiles that the kernel writes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tiles(Vec<Tile>);

impl Tiles {
    /// For a solid.
    pub fn new(model: &SolidModel) -> Self {
        Self(vec![[[[F32x16::ZERO; 4]; 6]; 3]; model.point_blocks.len()])
    }
}

/// Takes one substep: forces at the present displacements, `v += kick f / m`, `u += drift v`.
pub(crate) fn substep(
    isa: Isa,
    model: &SolidModel,
    laws: &[SolidLaw],
    conditions: &Conditions,
    nodes: &mut [NodeBlock],
    tiles: &mut Tiles,
    step: &Step,
) -> Extremes {
    let before = &*nodes;
    let tasks = tiles.0.par_chunks_mut(TASK).enumerate();
    let of_points = tasks.map(|(n, tiles)| {
        let task = Task {
            model,
            first: n * TASK,
            laws,
            nodes: before,
        };
        forces_with_isa(isa, &task, step, tiles)
    });
    let found = of_points.reduce(Extremes::default, Extremes::join);
    let tiles = &*tiles.0;
    let tasks = nodes.par_chunks_mut(TASK).enumerate();
    let largest = tasks
        .map(|(n, nodes)| advance_with_isa(isa, model, conditions, tiles, n * TASK, nodes, step));
    let largest = largest.reduce(|| 0, u32::max);
    Extremes {
        bad: largest >= f32::INFINITY.to_bits(),
        speed: f32::from_bits(largest),
        ..found
    }
}

/// Elastic energy of a solid [J], summed block by block.
pub(crate) fn elastic_energy(
    isa: Isa,
    model: &SolidModel,
    laws: &[SolidLaw],
    nodes: &[NodeBlock],
) -> f64 {
    let tasks = (0..model.point_blocks.len().div_ceil(TASK)).into_par_iter();
    let of_tasks: Vec<f64> = tasks
        .map(|n| {
            let first = n * TASK;
            let task = Task {
                model,
                first,
                laws,
                nodes,
            };
            let count = TASK.min(model.point_blocks.len() - first);
            energy_with_isa(isa, &task, count)
        })
        .collect();
    of_tasks.iter().sum::<f64>() * model.dx.powi(3)
}

/// Some blocks of points, and what they read.
struct Task<'a> {
    model: &'a SolidModel,
    /// The first of them.
    first: usize,
    laws: &'a [SolidLaw],
    nodes: &'a [NodeBlock],
}

impl Task<'_> {
    /// Nodes of its block `n`, and what that is made of.
    #[inline(always)]
    fn block(&self, n: usize) -> ([&NodeBlock; 8], impl Iterator<Item = Matter<'_>>) {
        let around = self.model.point_blocks[self.first + n].nodes;
        let node = |k: usize| &self.nodes[around[k] as usize];
        let nodes = [
            node(0),
            node(1),
            node(2),
            node(3),
            node(4),
            node(5),
            node(6),
            node(7),
        ];
        let parts = self.model.parts.of(self.first + n);
        let matter = parts.map(|(law, volumes)| Matter {
            law: &self.laws[usize::from(law)],
            volumes,
        });
        (nodes, matter)
    }
}

on_isa! {
    fn forces_with_isa = forces(task: &Task<'_>, step: &Step, tiles: &mut [Tile]) -> Extremes
}

/// Fills the tiles of some blocks.
#[inline(always)]
fn forces<V: Lanes>(task: &Task<'_>, step: &Step, tiles: &mut [Tile]) -> Extremes {
    let mut scratch = Scratch::EMPTY;
    let mut found = Extremes::default();
    for (n, tile) in tiles.iter_mut().enumerate() {
        let (nodes, matter) = task.block(n);
        found = found.join(block::forces::<V>(nodes, matter, step, &mut scratch, tile));
    }
    found
}

on_isa! {
    fn energy_with_isa = energy(task: &Task<'_>, count: usize) -> f64
}

/// Elastic energy of some blocks [Pa cells^3].
#[inline(always)]
fn energy<V: Lanes>(task: &Task<'_>, count: usize) -> f64 {
    let mut scratch = Scratch::EMPTY;
    let mut sum = 0.0;
    for n in 0..count {
        let (nodes, matter) = task.block(n);
        sum += block::energy::<V>(nodes, matter, &mut scratch);
    }
    sum
}

on_isa! {
    fn advance_with_isa = advance(
        model: &SolidModel,
        conditions: &Conditions,
        tiles: &[Tile],
        first: usize,
        nodes: &mut [NodeBlock],
        step: &Step,
    ) -> u32
}

/// Velocities and displacements of some blocks of nodes; bits of the largest component of a velocity.
#[inline(always)]
fn advance<V: Lanes>(
    model: &SolidModel,
    conditions: &Conditions,
    tiles: &[Tile],
    first: usize,
    nodes: &mut [NodeBlock],
    step: &Step,
) -> u32 {
    let zero = V::splat(0.0);
    let (kick, drift, keep) = (
        V::broadcast(step.kick),
        V::broadcast(step.drift),
        V::broadcast(step.keep),
    );
    let mut largest = zero;
    for (n, block) in (first..).zip(nodes) {
        let mut f = [[zero; 4]; 3];
        if conditions.forced[n] {
            for a in 0..3 {
                for x in 0..4 {
                    f[a][x] = V::load(&conditions.force[n][a][x]);
                }
            }
        }
        // The first tile is that of the block before along every axis: its nodes from 4 on are here.
        let around = &model.point_blocks_of[n];
        for o in 0..8 {
            if around[o] == NO_BLOCK {
                continue;
            }
            let tile = &tiles[around[o] as usize];
            let piece = 3 - o % 4;
            if o < 4 {
                for a in 0..3 {
                    for x in 0..2 {
                        f[a][x] = f[a][x] - V::load(&tile[a][4 + x][piece]);
                    }
                }
            } else {
                for a in 0..3 {
                    for x in 0..4 {
                        f[a][x] = f[a][x] - V::load(&tile[a][x][piece]);
                    }
                }
            }
        }
        for x in 0..4 {
            let w = V::load(&conditions.w[n][x]);
            let free = zero.lt(w);
            for a in 0..3 {
                let rate = w.mul_add(f[a][x], V::broadcast(step.gravity[a]));
                let before = V::load(&block.v[a][x]);
                let v = V::select(free, kick.mul_add(rate, before) * keep, before);
                v.store(&mut block.v[a][x]);
                drift
                    .mul_add(v, V::load(&block.u[a][x]))
                    .store(&mut block.u[a][x]);
                largest = largest.larger_magnitude(v);
            }
        }
    }
    largest.largest_magnitude_bits()
}
