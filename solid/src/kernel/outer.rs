//! Outer nodes, which follow inner ones and hand on to them what acts on them.

use rayon::prelude::*;

use super::{TASK, Tiles};
use crate::{
    model::SolidModel,
    nodes::{Conditions, NODES, NodeBlock, NodeRow, Planes, read, write},
};

/// Outer nodes of a task at least.
const OUTER: usize = 512;

/// Gives inner nodes what acts on those that follow them.
pub(super) fn bear_outer(
    model: &SolidModel,
    conditions: &Conditions,
    outer: &mut [[f32; 4]],
    total: &mut [Planes],
) {
    let extension = &model.extension;
    let slots = extension.outer.par_iter().with_min_len(OUTER);
    let slots = slots.zip(&conditions.follows);
    let of_nodes = &*total;
    slots
        .zip(outer.par_iter_mut())
        .for_each(|((&slot, &follows), force)| {
            let slot = slot as usize;
            let [x, y, z] = match follows {
                true => read(&of_nodes[slot / NODES], slot),
                false => [0.0; 3],
            };
            *force = [x, y, z, 0.0];
        });
    let blocks = total.par_iter_mut().enumerate().with_min_len(TASK);
    blocks.for_each(|(block, total)| extension.gather(block, &*outer, total));
}

/// Puts some outer nodes where they belong, by their places in the list, after inner ones were changed otherwise than by a substep.
pub fn follow_again(
    model: &SolidModel,
    conditions: &Conditions,
    nodes: &mut [NodeBlock],
    tiles: &mut Tiles,
    outer: &[u32],
) {
    let extension = &model.extension;
    for &n in outer.iter().filter(|&&n| conditions.follows[n as usize]) {
        let slot = extension.outer[n as usize] as usize;
        let row = extension.follow(n as usize, &tiles.rows);
        let speed = &mut tiles.speeds[slot / NODES];
        follow_to(row, &mut nodes[slot / NODES], speed, slot);
        tiles.rows[slot] = row;
    }
}

/// Puts an outer node where others take it.
#[inline(always)]
fn follow_to(row: NodeRow, node: &mut NodeBlock, speed: &mut f32, slot: usize) {
    let [ux, uy, uz, vx, vy, vz, ..] = row.0;
    write(&mut node.u, slot, [ux, uy, uz]);
    write(&mut node.v, slot, [vx, vy, vz]);
    let squared = vx * vx + vy * vy + vz * vz;
    let is_more = squared.sqrt() > *speed || squared.is_nan();
    if is_more && !speed.is_nan() {
        *speed = squared.sqrt();
    }
}

/// Puts outer nodes where they belong.
pub(super) fn follow_inner(
    model: &SolidModel,
    conditions: &Conditions,
    nodes: &mut [NodeBlock],
    rows: &mut [NodeRow],
    followed: &mut [NodeRow],
    speeds: &mut [f32],
) {
    let extension = &model.extension;
    let (before, all) = (&*rows, followed.par_iter_mut().enumerate());
    all.with_min_len(OUTER)
        .for_each(|(n, out)| *out = extension.follow(n, before));
    let followed = &*followed;
    let blocks = nodes.par_iter_mut().zip(rows.par_chunks_exact_mut(NODES));
    let blocks = blocks.zip(speeds).enumerate();
    blocks
        .with_min_len(TASK)
        .for_each(|(block, ((node, rows), speed))| {
            for n in extension.outer_of[block].clone() {
                if !conditions.follows[n as usize] {
                    continue;
                }
                let slot = extension.outer[n as usize] as usize;
                let row = followed[n as usize];
                rows[slot % NODES] = row;
                follow_to(row, node, speed, slot);
            }
        });
}
