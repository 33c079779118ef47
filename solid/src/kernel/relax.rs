//! Stress that relaxes: a Maxwell branch beside the elastic law, as a filter of the elastic forces on nodes.
//!
//! With `E` the elastic force and `R` what it has relaxed to, `dR/dt = (E - R) / tau`, the branch adds `gain (E - R)`. Of a linear law that is
//! a branch with `gain` times all of its moduli (Simo and Hughes 1998, 10.1). Three numbers per node are all it needs.

use rayon::prelude::*;

use super::{TASK, Tiles};
use crate::{
    model::SolidModel,
    nodes::{Conditions, NODES, NodeBlock, Planes, write},
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// A branch that relaxes.
#[derive(Debug)]
pub struct Relaxing<'a> {
    /// What elastic forces have relaxed to, per block of nodes [Pa].
    pub relaxed: &'a mut [Planes],
    /// Stiffness of the branch over that of the law.
    pub gain: f32,
    /// Share of the way to the elastic force that it goes in this substep.
    pub share: f32,
    /// Turn of the solid in this substep [rad]: what has relaxed turns with it.
    pub turn: [f32; 3],
}

/// Adds the branch to the forces on nodes, before outer ones hand theirs on.
pub(super) fn relax(
    isa: Isa,
    relaxing: &mut Relaxing<'_>,
    conditions: &Conditions,
    tiles: &mut Tiles,
) {
    let Tiles { total, excess, .. } = tiles;
    excess.resize(total.len(), [[F32x16::ZERO; 4]; 3]);
    let (gain, share, turn) = (relaxing.gain, relaxing.share, relaxing.turn);
    let blocks = relaxing.relaxed.par_chunks_mut(TASK);
    let blocks = blocks.zip(total.par_chunks_mut(TASK));
    let blocks = blocks.zip(excess.par_chunks_mut(TASK)).enumerate();
    blocks.for_each(|(n, ((relaxed, total), excess))| {
        let first = n * TASK;
        relax_with_isa(
            isa,
            conditions,
            first,
            [relaxed, total, excess],
            [gain, share],
            turn,
        );
    });
}

on_isa! {
    fn relax_with_isa = relax_blocks(
        conditions: &Conditions,
        first: usize,
        blocks: [&mut [Planes]; 3],
        law: [f32; 2],
        turn: [f32; 3],
    )
}

#[inline(always)]
fn relax_blocks<V: Lanes>(
    conditions: &Conditions,
    first: usize,
    [relaxed, total, excess]: [&mut [Planes]; 3],
    [gain, share]: [f32; 2],
    turn: [f32; 3],
) {
    let (gain, share, half) = (V::broadcast(gain), V::broadcast(share), V::splat(0.5));
    let turn = turn.map(V::broadcast);
    let cross = |v: [V; 3]| -> [V; 3] {
        std::array::from_fn(|a| {
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            turn[b] * v[c] - turn[c] * v[b]
        })
    };
    let blocks = relaxed.iter_mut().zip(total).zip(excess);
    for (n, ((relaxed, total), excess)) in (first..).zip(blocks) {
        let forced = conditions.forced[n];
        let given = &conditions.force[NODES * n..][..NODES];
        for x in 0..4 {
            let mut elastic: [V; 3] = std::array::from_fn(|a| V::load(&total[a][x]));
            if forced {
                for a in 0..3 {
                    let outer = F32x16(std::array::from_fn(|lane| given[16 * x + lane][a]));
                    elastic[a] = elastic[a] - V::load(&outer);
                }
            }
            let before: [V; 3] = std::array::from_fn(|a| V::load(&relaxed[a][x]));
            let once = cross(before);
            let twice = cross(once);
            for a in 0..3 {
                let turned = before[a] + once[a] + half * twice[a];
                let now = share.mul_add(elastic[a] - turned, turned);
                let more = gain * (elastic[a] - now);
                now.store(&mut relaxed[a][x]);
                more.store(&mut excess[a][x]);
                (V::load(&total[a][x]) + more).store(&mut total[a][x]);
            }
        }
    }
}

/// Takes from outer nodes what they have handed on to inner ones.
pub(super) fn hand_on(model: &SolidModel, conditions: &Conditions, excess: &mut [Planes]) {
    let outer = model.extension.outer.iter().zip(&conditions.follows);
    for (&slot, _) in outer.filter(|(_, follows)| **follows) {
        write(&mut excess[slot as usize / NODES], slot as usize, [0.0; 3]);
    }
}

/// Energy that the branch takes from nodes in half a kick [s] at these velocities [Pa cells^3].
pub(super) fn taken(excess: &[Planes], nodes: &[NodeBlock], kick: f32) -> f64 {
    let blocks = excess.par_iter().zip(nodes).with_min_len(TASK);
    let of_blocks: Vec<f64> = blocks
        .map(|(excess, node)| {
            let mut sum = [0.0_f32; 16];
            let (excess, v) = (excess.as_flattened(), node.v.as_flattened());
            for (excess, v) in excess.iter().zip(v) {
                for lane in 0..16 {
                    sum[lane] -= excess.0[lane] * v.0[lane];
                }
            }
            sum.into_iter().map(f64::from).sum()
        })
        .collect();
    0.5 * f64::from(kick) * of_blocks.iter().sum::<f64>()
}
