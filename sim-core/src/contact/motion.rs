//! Objects on the grid as wholes: motions of their fields [mass units, cells, s], relative to the frame velocity.
//!
//! Momentum and angular momentum of nodes are those of the particles with their affine parts, and the inertia of nodes counts
//! `2 D_p` per mass like theirs, so nothing is approximated.

use std::ops::Range;

use rayon::prelude::*;

use super::sites::read;
use crate::{
    episodes::Movers,
    grid::{Grid, Velocities},
    motion::{RigidMotion, SUMS, add_to_sums},
    particles::BLOCK,
};

/// All fields of a grid.
pub(super) struct Fields<'a> {
    pub grid: &'a mut Grid,
    /// Largest velocity component given to a node [cells/s], as bits: as integers, so that NaN is the largest of all.
    pub largest: u32,
}

/// Node blocks of a field.
fn blocks_of(grid: &Grid, field: u32) -> Range<usize> {
    let start = grid.nodes.partition_point(|node| node.field < field);
    start..grid.nodes.partition_point(|node| node.field <= field)
}

/// Position [cells] of the nodes of a block relative to `origin`, with their numbers.
fn places(index: [i32; 3], origin: [i32; 3]) -> impl Iterator<Item = (usize, [f64; 3])> {
    (0..64).map(move |at| {
        let local = super::sites::coordinates(at);
        let x = |a: usize| f64::from(BLOCK * (index[a] - origin[a]) + local[a]);
        (at, [x(0), x(1), x(2)])
    })
}

impl Movers for Fields<'_> {
    fn motion(&self, field: u32, _: [f64; 3]) -> Option<RigidMotion> {
        let range = blocks_of(self.grid, field);
        let nodes = &self.grid.nodes[range.clone()];
        let origin = nodes.first()?.index;
        let parts: Vec<[f64; SUMS]> = nodes
            .par_iter()
            .zip(&self.grid.velocities[range])
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

    fn push(
        &mut self,
        field: u32,
        motion: &RigidMotion,
        x: [f64; 3],
        impulse: [f64; 3],
        keep: f64,
    ) {
        let after = motion.after(x, impulse);
        let range = blocks_of(self.grid, field);
        let blocks = self.grid.nodes[range.clone()]
            .par_iter()
            .zip(&mut self.grid.velocities[range]);
        let largest = blocks.with_min_len(16).map(|(node, velocities)| {
            let mut largest = 0;
            for (at, y) in places(node.index, [0; 3]) {
                let (v, mass) = read(velocities, at);
                if mass <= 0.0 {
                    continue;
                }
                let (rigid, pushed) = (motion.at(y), after.at(y));
                let to = &mut velocities.0[at / 4].0[4 * (at % 4)..][..3];
                for a in 0..3 {
                    to[a] = (pushed[a] + keep * (v[a] - rigid[a])) as f32;
                    largest = largest.max(to[a].abs().to_bits());
                }
            }
            largest
        });
        self.largest = self.largest.max(largest.reduce(|| 0, u32::max));
    }
}

/// Sums over the nodes of a block, positions relative to `origin`.
fn sums(index: [i32; 3], origin: [i32; 3], velocities: &Velocities) -> [f64; SUMS] {
    let mut s = [0.0; SUMS];
    for (at, x) in places(index, origin) {
        let (v, mass) = read(velocities, at);
        if mass > 0.0 {
            add_to_sums(&mut s, mass, x, v);
        }
    }
    s
}
