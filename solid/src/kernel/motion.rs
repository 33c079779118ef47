//! Momenta and velocities of nodes, and where they move.

use rayon::prelude::*;

use super::{Step, TASK};
use crate::{
    nodes::{Conditions, NODES, NodeBlock, NodeRow, Planes},
    off_diagonal::OffDiagonalMass,
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Displacements [cells] and velocities [cells/s] below which there are none: cubes of them are normal numbers.
const NOTHING: f64 = 1e-12;
/// Of no block.
const NO_PLANES: Planes = [[F32x16::ZERO; 4]; 3];

/// Nodes with cell sizes over masses [m/kg], and momenta over masses [cells/s].
type Momenta<'a> = (&'a OffDiagonalMass, &'a [[F32x16; 4]], &'a [Planes]);

/// Momenta of nodes over their masses after forces [Pa] have acted [cells/s].
pub(super) fn kick(
    isa: Isa,
    conditions: &Conditions,
    (nodes, total): (&[NodeBlock], &[Planes]),
    momenta: &mut [Planes],
    step: &Step,
) {
    let tasks = momenta.par_chunks_mut(TASK).enumerate();
    tasks.for_each(|(n, momenta)| {
        let forces = NodeForces {
            conditions,
            nodes,
            total,
            first: n * TASK,
        };
        kick_with_isa(isa, &forces, momenta, step);
    });
}

/// Velocities of nodes, where they are after a time [s], and the largest speed of each block.
pub(super) fn move_nodes(
    isa: Isa,
    of_nodes: Momenta<'_>,
    (nodes, speeds): (&mut [NodeBlock], &mut [f32]),
    rows: &mut [NodeRow],
    drift: f32,
) {
    let chunks = nodes.par_chunks_mut(TASK);
    let tasks = chunks.zip(speeds.par_chunks_mut(TASK));
    let tasks = tasks.zip(rows.par_chunks_mut(TASK * NODES)).enumerate();
    tasks.for_each(|(n, (answers, rows))| {
        move_with_isa(isa, of_nodes, n * TASK, answers, rows, drift);
    });
}

/// What pushes blocks of nodes.
struct NodeForces<'a> {
    conditions: &'a Conditions,
    nodes: &'a [NodeBlock],
    /// Forces on nodes, per block [Pa].
    total: &'a [Planes],
    /// The first block.
    first: usize,
}

/// The same, or nothing where it is next to nothing: products of such numbers would be subnormal, which takes a hundred times as long.
#[inline(always)]
fn flushed<V: Lanes>(value: V) -> V {
    V::select(value.abs().lt(V::splat(NOTHING)), V::splat(0.0), value)
}

on_isa! {
    /// Momenta of some blocks of nodes over their masses, after forces have acted [cells/s].
    fn kick_with_isa = kick_blocks(
        forces: &NodeForces<'_>,
        momenta: &mut [Planes],
        step: &Step,
    )
}

#[inline(always)]
fn kick_blocks<V: Lanes>(forces: &NodeForces<'_>, momenta: &mut [Planes], step: &Step) {
    let zero = V::splat(0.0);
    let (kick, keep) = (V::broadcast(step.kick), V::broadcast(step.keep));
    for (n, momenta) in (forces.first..).zip(momenta) {
        for x in 0..4 {
            let w = V::load(&forces.conditions.w[n][x]);
            let free = zero.lt(w);
            for a in 0..3 {
                let force = V::load(&forces.total[n][a][x]);
                let rate = w.mul_add(force, V::broadcast(step.gravity[a]));
                let before = V::load(&forces.nodes[n].p[a][x]);
                let p = flushed(kick.mul_add(rate, before) * keep);
                V::select(free, p, before).store(&mut momenta[a][x]);
            }
        }
    }
}

/// A block of nodes among its neighbours.
struct Neighbourhood<'a> {
    pairs: &'a Planes,
    /// Pairs of the blocks before it along every axis.
    pairs_before: [&'a Planes; 3],
    p: &'a Planes,
    /// Momenta of the blocks before and behind it along every axis.
    p_around: [&'a Planes; 6],
}

impl<'a> Neighbourhood<'a> {
    #[inline(always)]
    fn new(mass: &'a OffDiagonalMass, p: &'a [Planes], n: usize) -> Self {
        let around = mass.around(n);
        let of = |planes: &'a [Planes], at: usize| around[at].map_or(&NO_PLANES, |n| &planes[n]);
        Self {
            pairs: &mass.pairs[n],
            pairs_before: [0, 2, 4].map(|at| of(&mass.pairs, at)),
            p: &p[n],
            p_around: [0, 1, 2, 3, 4, 5].map(|at| of(p, at)),
        }
    }

    /// Mass of the nodes of a plane together with those two cells before and behind them, axis after axis.
    #[inline(always)]
    fn pairs<V: Lanes>(&self, x: usize) -> [V; 6] {
        let own = |axis: usize| V::load(&self.pairs[axis][x]);
        let before = |axis: usize| V::load(&self.pairs_before[axis][axis][x]);
        let before_x = match x {
            0 | 1 => V::load(&self.pairs_before[0][0][x + 2]),
            _ => V::load(&self.pairs[0][x - 2]),
        };
        [
            before_x,
            own(0),
            before(1).shift_in_quarters::<2>(own(1)),
            own(1),
            before(2).shift_quarters::<2>(own(2)),
            own(2),
        ]
    }

    /// A component of the momenta of the nodes two cells from those of a plane, in the same order.
    #[inline(always)]
    fn momenta<V: Lanes>(&self, a: usize, x: usize, own: V) -> [V; 6] {
        let [before_x, behind_x, before_y, behind_y, before_z, behind_z] = self.p_around;
        let at = |planes: &Planes, x: usize| V::load(&planes[a][x]);
        [
            if x < 2 {
                at(before_x, x + 2)
            } else {
                at(self.p, x - 2)
            },
            if x < 2 {
                at(self.p, x + 2)
            } else {
                at(behind_x, x - 2)
            },
            at(before_y, x).shift_in_quarters::<2>(own),
            own.shift_in_quarters::<2>(at(behind_y, x)),
            at(before_z, x).shift_quarters::<2>(own),
            own.shift_quarters::<2>(at(behind_z, x)),
        ]
    }

    /// A component of the velocities that a plane of nodes has with its momenta, at cell sizes over masses `w` [m/kg].
    #[inline(always)]
    fn velocities<V: Lanes>(&self, (a, x): (usize, usize), pairs: &[V; 6], w: V) -> V {
        let own = V::load(&self.p[a][x]);
        let others = self.momenta(a, x, own);
        let mut sum = pairs[0] * (own - others[0]);
        for n in 1..6 {
            sum = pairs[n].mul_add(own - others[n], sum);
        }
        w.mul_add(sum, own)
    }
}

on_isa! {
    /// Velocities of some blocks of nodes, from `first` on, with momenta over masses [cells/s].
    fn velocities_with_isa = velocities(
        of_nodes: Momenta<'_>,
        first: usize,
        out: &mut [Planes],
    )
}

#[inline(always)]
fn velocities<V: Lanes>((mass, w, p): Momenta<'_>, first: usize, out: &mut [Planes]) {
    for (n, out) in (first..).zip(out) {
        let here = Neighbourhood::new(mass, p, n);
        for x in 0..4 {
            let (w, pairs) = (V::load(&w[n][x]), here.pairs(x));
            for a in 0..3 {
                let v: V = here.velocities((a, x), &pairs, w);
                v.store(&mut out[a][x]);
            }
        }
    }
}

/// Velocities of all nodes with momenta over masses [cells/s], with cell sizes over masses [m/kg].
pub(crate) fn velocities_of(isa: Isa, of_nodes: Momenta<'_>, out: &mut [Planes]) {
    velocities_with_isa(isa, of_nodes, 0, out);
}

on_isa! {
    /// Velocities with momenta over masses, and displacements of some blocks of nodes, from `first` on, and the largest speed of each.
    fn move_with_isa = move_blocks(
        of_nodes: Momenta<'_>,
        first: usize,
        answers: (&mut [NodeBlock], &mut [f32]),
        rows: &mut [NodeRow],
        drift: f32,
    )
}

#[inline(always)]
fn move_blocks<V: Lanes>(
    (mass, w, p): Momenta<'_>,
    first: usize,
    (nodes, speeds): (&mut [NodeBlock], &mut [f32]),
    rows: &mut [NodeRow],
    drift: f32,
) {
    let (zero, drift) = (V::splat(0.0), V::broadcast(drift));
    let blocks = nodes.iter_mut().zip(rows.chunks_exact_mut(NODES));
    for ((n, (block, rows)), speed) in (first..).zip(blocks).zip(speeds) {
        let here = Neighbourhood::new(mass, p, n);
        block.p = p[n];
        let mut largest = zero;
        for x in 0..4 {
            let (w, pairs) = (V::load(&w[n][x]), here.pairs(x));
            let mut squared = zero;
            for a in 0..3 {
                let v = flushed(here.velocities((a, x), &pairs, w));
                v.store(&mut block.v[a][x]);
                let u = drift.mul_add(v, V::load(&block.u[a][x]));
                flushed(u).store(&mut block.u[a][x]);
                squared = v.mul_add(v, squared);
            }
            largest = largest.larger_magnitude(squared);
        }
        block.write_rows(rows);
        *speed = f32::from_bits(largest.largest_magnitude_bits()).sqrt();
    }
}
