//! Rigid motions of objects on the grid [cells, s], relative to the frame velocity.
//!
//! Momentum and angular momentum of nodes are those of the particles with their affine parts, and the inertia of nodes counts
//! `2 D_p` per mass like theirs, so nothing is approximated.

use rayon::prelude::*;

use super::sites::read;
use crate::{
    grid::{Grid, Velocities},
    motion::{RigidMotion, SUMS, add_to_sums},
    particles::BLOCK,
};

/// Rigid part of the motion of a field; none where it has no extent.
pub(super) fn rigid_motion(grid: &Grid, field: u32) -> Option<RigidMotion> {
    let start = grid.nodes.partition_point(|node| node.field < field);
    let range = start..grid.nodes.partition_point(|node| node.field <= field);
    let nodes = &grid.nodes[range.clone()];
    let origin = nodes.first()?.index;
    let parts: Vec<[f64; SUMS]> = nodes
        .par_iter()
        .zip(&grid.velocities[range])
        .with_min_len(16)
        .map(|(node, velocities)| sums(node.index, origin, velocities))
        .collect();
    // In the order of blocks: the same for any number of threads.
    let mut total = [0.0; SUMS];
    for part in &parts {
        for (total, part) in total.iter_mut().zip(part) {
            *total += part;
        }
    }
    RigidMotion::from_sums(&total, origin.map(|o| f64::from(BLOCK * o)))
}

/// Sums over the nodes of a block, positions [cells] relative to `origin`.
fn sums(index: [i32; 3], origin: [i32; 3], velocities: &Velocities) -> [f64; SUMS] {
    let mut s = [0.0; SUMS];
    for at in 0..64 {
        let (v, mass) = read(velocities, at);
        if mass > 0.0 {
            let local = super::sites::coordinates(at);
            let x = std::array::from_fn(|a| f64::from(BLOCK * (index[a] - origin[a]) + local[a]));
            add_to_sums(&mut s, mass, x, v);
        }
    }
    s
}
