//! One substep of the nodes, sixteen points or nodes at a time.
//!
//! Every block of points writes the forces on its 6x6x6 nodes to a tile of its own (`block`), and every block of nodes sums the tiles
//! that reach it in the order of their places, so that no result depends on threads.
//!
//! With `w_p = N_i(X_p) V_p` the squared frequency of any motion is at most 4.5 / dx^2 times the largest mean over a node's points,
//! `sum_p w_p C_p / sum_p w_p rho`, of their tangents `C_p` (Cauchy and Schwarz in every point): so tangents go to nodes as mass does.

mod block;
mod flow;
mod gradients;
mod motion;
mod outer;
mod relax;
mod respond;
mod rule;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

pub(crate) use self::motion::velocities_of;
use self::{
    block::{Answers, NO_FORCES, NO_TANGENTS, Scratch, TangentTile, Tile},
    flow::Flowing,
    gradients::Matter,
    motion::{kick, move_nodes},
    outer::{bear_outer, follow_inner},
    rule::Rule,
};
pub use self::{outer::follow_again, relax::Relaxing};
use super::{
    memory::BlockMemory,
    model::{NO_BLOCK, SolidModel},
    nodes::{Conditions, NODES, NodeBlock, NodeRow, Planes},
};
use crate::{
    materials::{Coefficients, Law},
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Blocks of points of a task: they share the memory between the stages.
const TASK: usize = 8;

/// A law with its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidLaw {
    /// The law.
    pub law: Law,
    /// Lamé's first parameter [Pa].
    pub lambda: f64,
    /// Shear modulus [Pa].
    pub mu: f64,
    /// Mass per rest volume [kg/m^3].
    pub density: f64,
    /// Loss factor `tan delta`, 0..=1.
    pub loss: f64,
}

impl SolidLaw {
    /// Its numbers as laws read them.
    pub fn coefficients(&self) -> Coefficients<f64> {
        Coefficients::of_law(self.law, self.lambda, self.mu)
    }

    /// Tangent at rest that no direction exceeds [Pa].
    pub fn tangent_at_rest(&self) -> f64 {
        3.0 * self.lambda + 2.0 * self.mu
    }
}

/// What a substep changes.
#[derive(Debug)]
pub struct Moving<'a> {
    /// Per block of nodes.
    pub nodes: &'a mut [NodeBlock],
    /// Per block of points; without it all laws are elastic.
    pub memory: &'a mut [BlockMemory],
    /// What relaxes, if matter loses energy.
    pub relaxing: Option<Relaxing<'a>>,
}

/// What a substep does besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// How long forces act, and matter flows [s]; what it remembers stays as it is at 0.
    pub kick: f32,
    /// How long nodes move after that [s].
    pub drift: f32,
    /// Share of velocities that damping leaves.
    pub keep: f32,
    /// Gravity in the object's frame [cells/s^2].
    pub gravity: [f32; 3],
    /// Time of the viscous stress per strain rate, over Lamé's parameters [s].
    pub viscosity: f32,
    /// Whether [`Tiles::sums`] are asked for.
    pub wants_extremes: bool,
    /// Whether [`Extremes::rate`] is asked for where there is no viscosity.
    pub wants_rate: bool,
    /// Whether forces of points are those of the substep before: nothing has moved since, and nothing flows.
    pub knows_forces: bool,
}

/// What a substep finds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extremes {
    /// Largest gradient of the velocity over rest positions [1/s], where there is viscosity or it is asked for.
    pub rate: f32,
    /// Whether a node is nowhere.
    pub bad: bool,
    /// Energy that what relaxes takes from nodes in the first half of the kick [J].
    pub lost: f64,
}

/// The tiles that the kernel writes.
#[derive(Clone, Debug, Default)]
pub struct Tiles {
    forces: Vec<Tile>,
    tangents: Vec<TangentTile>,
    /// Sums of tangents over the points about inner nodes, and about those that follow them, as of when they were asked for [Pa].
    pub sums: Vec<[F32x16; 4]>,
    /// Forces on nodes per block, and on outer ones [Pa].
    total: Vec<Planes>,
    /// The part of them by what relaxes.
    excess: Vec<Planes>,
    outer: Vec<[f32; 4]>,
    /// Momenta of nodes over their masses, per block [cells/s].
    momenta: Vec<Planes>,
    /// Displacements and velocities of outer nodes.
    followed: Vec<NodeRow>,
    /// Of all nodes by their numbers, as they are after a substep or a [look](Self::look_at).
    pub rows: Vec<NodeRow>,
    /// Largest speed of a node per block of nodes in the object's frame [cells/s].
    pub speeds: Vec<f32>,
}

impl Tiles {
    /// For a solid.
    pub fn new(model: &SolidModel) -> Self {
        let count = model.point_blocks.len();
        Self {
            forces: vec![NO_FORCES; count],
            tangents: vec![NO_TANGENTS; count],
            sums: vec![[F32x16::ZERO; 4]; model.node_blocks.len()],
            outer: vec![[0.0; 4]; model.extension.outer.len()],
            excess: vec![],
            total: vec![[[F32x16::ZERO; 4]; 3]; model.node_blocks.len()],
            momenta: vec![[[F32x16::ZERO; 4]; 3]; model.node_blocks.len()],
            followed: vec![NodeRow::default(); model.extension.outer.len()],
            rows: vec![NodeRow::default(); NODES * model.node_blocks.len()],
            speeds: vec![0.0; model.node_blocks.len()],
        }
    }

    /// Energy that what relaxes takes from nodes in half a kick [s] at these velocities [J].
    pub fn lost(&self, model: &SolidModel, nodes: &[NodeBlock], kick: f32) -> f64 {
        model.dx.powi(3) * relax::taken(&self.excess, nodes, kick)
    }

    /// Takes note of nodes that were changed otherwise than by a substep.
    pub fn look_at(&mut self, nodes: &[NodeBlock]) {
        let all = self.rows.par_chunks_exact_mut(NODES).zip(nodes);
        let all = all.zip(&mut self.speeds).with_min_len(TASK);
        all.for_each(|((rows, block), speed)| {
            block.write_rows(rows);
            *speed = block.fastest();
        });
    }
}

/// Takes one substep: forces at the present displacements, `p += kick f / m`, `v = p + W C p`, `u += drift v`.
pub fn substep(
    isa: Isa,
    model: &SolidModel,
    laws: &[SolidLaw],
    conditions: &Conditions,
    Moving {
        nodes,
        memory,
        mut relaxing,
    }: Moving<'_>,
    tiles: &mut Tiles,
    step: &Step,
) -> Extremes {
    let mut rate = 0.0;
    if !step.knows_forces {
        let before = &*nodes;
        let answers = tiles.forces.par_chunks_mut(TASK);
        let answers = answers.zip(tiles.tangents.par_chunks_mut(TASK));
        let tasks = answers.zip(memory.par_chunks_mut(TASK)).enumerate();
        let of_points = tasks.map(|(n, ((forces, tangents), memory))| {
            let task = Task {
                model,
                first: n * TASK,
                laws,
                nodes: before,
            };
            forces_with_isa(isa, &task, step, (forces, tangents), memory)
        });
        rate = of_points.reduce(|| 0.0, f32::max);
    }
    if step.wants_extremes {
        sum_tangents(isa, model, tiles);
    }
    let Tiles { forces, total, .. } = &mut *tiles;
    let sums = total.par_chunks_mut(TASK).enumerate();
    sums.for_each(|(n, total)| sum_with_isa(isa, model, conditions, forces, n * TASK, total));
    let mut lost = 0.0;
    if let Some(relaxing) = &mut relaxing {
        relax::relax(isa, relaxing, conditions, tiles);
        let Tiles { outer, excess, .. } = &mut *tiles;
        bear_outer(model, conditions, outer, excess);
        relax::hand_on(model, conditions, excess);
        lost = tiles.lost(model, nodes, step.kick);
    }
    let Tiles {
        outer,
        total,
        momenta,
        followed,
        rows,
        speeds,
        ..
    } = tiles;
    bear_outer(model, conditions, outer, total);
    kick(isa, conditions, (nodes, total), momenta, step);
    let of_nodes = (&model.off_diagonal, &conditions.w[..], &momenta[..]);
    move_nodes(isa, of_nodes, (nodes, speeds), rows, step.drift);
    follow_inner(model, conditions, nodes, rows, followed, speeds);
    let bad = speeds.iter().any(|speed| !speed.is_finite());
    Extremes { rate, bad, lost }
}

/// Sums tangents about nodes. What follows others is no motion of its own: a corner of matter that is crushed makes those faster that move
/// it by as little as they bear of it.
fn sum_tangents(isa: Isa, model: &SolidModel, tiles: &mut Tiles) {
    let Tiles {
        tangents,
        sums,
        outer,
        ..
    } = tiles;
    let tangents = &*tangents;
    let tasks = sums.par_chunks_mut(TASK).enumerate();
    tasks.for_each(|(n, sums)| tangents_with_isa(isa, model, tangents, n * TASK, sums));
    let extension = &model.extension;
    for (&slot, outer) in extension.outer.iter().zip(&mut *outer) {
        let slot = slot as usize;
        outer[0] = std::mem::take(&mut sums[slot / NODES][slot / 16 % 4].0[slot % 16]);
    }
    let outer = &*outer;
    let blocks = sums.par_iter_mut().enumerate().with_min_len(TASK);
    blocks.for_each(|(block, sums)| extension.gather_magnitudes(block, outer, sums));
}

/// Elastic energy of a solid [J], summed block by block.
pub fn elastic_energy(
    isa: Isa,
    model: &SolidModel,
    laws: &[SolidLaw],
    nodes: &[NodeBlock],
    memory: &[BlockMemory],
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
            energy_with_isa(isa, &task, &memory[first..first + count])
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
        let matter = parts.map(|(law, volumes, filled)| Matter {
            law: &self.laws[usize::from(law)],
            volumes,
            filled,
        });
        (nodes, matter)
    }
}

on_isa! {
    fn forces_with_isa = forces(
        task: &Task<'_>,
        step: &Step,
        tiles: (&mut [Tile], &mut [TangentTile]),
        memory: &mut [BlockMemory],
    ) -> f32
}

/// Fills the tiles of some blocks; the largest gradient of the velocity where there is viscosity or it is asked for [1/s].
#[inline(always)]
fn forces<V: Flowing>(
    task: &Task<'_>,
    step: &Step,
    (tiles, tangents): (&mut [Tile], &mut [TangentTile]),
    memory: &mut [BlockMemory],
) -> f32 {
    let (mut scratch, rule) = (Scratch::EMPTY, Rule::<V>::new(&task.model.lattice.axes()));
    let mut rate = 0.0_f32;
    let answers = tiles.iter_mut().zip(tangents).zip(memory);
    for (n, ((tile, tangents), memory)) in answers.enumerate() {
        let (nodes, matter) = task.block(n);
        let answers = Answers {
            tile,
            tangents,
            memory,
        };
        rate = rate.max(block::forces(
            nodes,
            matter,
            &rule,
            step,
            &mut scratch,
            answers,
        ));
    }
    rate
}

on_isa! {
    fn tangents_with_isa = sum_of_tangents(
        model: &SolidModel,
        tiles: &[TangentTile],
        first: usize,
        sums: &mut [[F32x16; 4]],
    )
}

/// Sums of tangents over the points about nodes of some blocks [Pa].
#[inline(always)]
fn sum_of_tangents<V: Lanes>(
    model: &SolidModel,
    tiles: &[TangentTile],
    first: usize,
    sums: &mut [[F32x16; 4]],
) {
    for (n, sums) in (first..).zip(sums) {
        let mut sum = [V::splat(0.0); 4];
        for (o, &block) in model.point_blocks_of[n].iter().enumerate() {
            if block == NO_BLOCK {
                continue;
            }
            // As in `advance`.
            let (tile, from, piece) = (&tiles[block as usize], 4 - o / 4 * 4, 3 - o % 4);
            for x in 0..6 - from.max(2) {
                sum[x] = sum[x] + V::load(&tile[from + x][piece]);
            }
        }
        for x in 0..4 {
            sum[x].store(&mut sums[x]);
        }
    }
}

on_isa! {
    fn energy_with_isa = energy(task: &Task<'_>, memory: &[BlockMemory]) -> f64
}

/// Elastic energy of some blocks [Pa cells^3].
#[inline(always)]
fn energy<V: Lanes>(task: &Task<'_>, memory: &[BlockMemory]) -> f64 {
    let (mut scratch, rule) = (Scratch::EMPTY, Rule::<V>::new(&task.model.lattice.axes()));
    let mut sum = 0.0;
    for (n, memory) in memory.iter().enumerate() {
        let (nodes, matter) = task.block(n);
        sum += block::energy(nodes, matter, memory, &rule, &mut scratch);
    }
    sum
}

on_isa! {
    /// Sums the forces on some blocks of nodes [Pa], from `first` on.
    fn sum_with_isa = sum_forces(
        model: &SolidModel,
        conditions: &Conditions,
        tiles: &[Tile],
        first: usize,
        total: &mut [Planes],
    )
}

#[inline(always)]
fn sum_forces<V: Lanes>(
    model: &SolidModel,
    conditions: &Conditions,
    tiles: &[Tile],
    first: usize,
    total: &mut [Planes],
) {
    for (n, total) in (first..).zip(total) {
        let mut f = [[V::splat(0.0); 4]; 3];
        if conditions.forced[n] {
            let given = &conditions.force[NODES * n..][..NODES];
            for a in 0..3 {
                for x in 0..4 {
                    let component = F32x16(std::array::from_fn(|lane| given[16 * x + lane][a]));
                    f[a][x] = V::load(&component);
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
        for a in 0..3 {
            for x in 0..4 {
                f[a][x].store(&mut total[a][x]);
            }
        }
    }
}
