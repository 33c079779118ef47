//! What held particles weigh on the grid beyond their own mass.
//!
//! They are [`ANCHOR`] times as heavy there, so that nodes move as they do. Whoever asks masses where matter ends, or which way
//! its surface faces, has to know better: beside an anchored node full ones look all but empty.

use std::sync::OnceLock;

use super::{NODES, NONE, NodeBlock, OFFSETS};
use crate::{
    colliders::{
        Substep,
        rules::{Pins, Rules},
        touch::ANCHOR,
    },
    particles::{BLOCK, NO_PARTICLE, Particles},
    simd::LANES,
};

/// Masses of held particles at nodes, of the blocks that are asked for.
#[derive(Debug)]
pub(crate) struct Anchors<'a> {
    particles: &'a Particles,
    rules: &'a Rules,
    pins: &'a Pins,
    substep: Substep,
    /// Per particle block, whether a rule may name one of its particles.
    concerned: &'a [bool],
    /// Per node block the mass of what is held at its nodes, where there is any; empty when nothing is held at all.
    masses: Vec<OnceLock<Option<Box<[f64; NODES]>>>>,
}

impl<'a> Anchors<'a> {
    /// Of a grid of `count` node blocks in a substep; `concerned` says per particle block whether a rule may name one of it.
    pub fn new(
        particles: &'a Particles,
        rules: &'a Rules,
        pins: &'a Pins,
        substep: Substep,
        concerned: &'a [bool],
        count: usize,
    ) -> Self {
        let holds = rules.hold_in(pins, &substep);
        let masses = (0..if holds { count } else { 0 }).map(|_| OnceLock::new());
        Self {
            particles,
            rules,
            pins,
            substep,
            concerned,
            masses: masses.collect(),
        }
    }

    /// Mass of the matter at a node of the `n`-th node block, which on the grid weighs `mass`: the same where nothing is held.
    #[inline]
    pub fn matter(&self, n: usize, block: &NodeBlock, at: usize, mass: f64) -> f64 {
        match self.masses.get(n) {
            None => mass,
            Some(known) => match known.get_or_init(|| self.weigh(block)) {
                // Sums of single precision lose up to a hundredth of what is held: it is there at least.
                Some(held) if held[at] > 0.0 => (mass - (ANCHOR - 1.0) * held[at]).max(held[at]),
                _ => mass,
            },
        }
    }

    /// Mass of what is held at the nodes of a block.
    #[cold]
    fn weigh(&self, block: &NodeBlock) -> Option<Box<[f64; NODES]>> {
        let mut found: Option<Box<[f64; NODES]>> = None;
        for (tile, offset) in block.tiles.iter().zip(OFFSETS) {
            if *tile == NONE || !self.concerned.get(*tile as usize).is_some_and(|c| *c) {
                continue;
            }
            for g in self.particles.blocks[*tile as usize].groups.clone() {
                let (fixed, x) = (&self.particles.fixed[g], &self.particles.groups[g].x);
                for lane in (0..LANES).filter(|&lane| fixed.id[lane] != NO_PARTICLE) {
                    // From the first node of the block [cells].
                    let x: [f64; 3] = std::array::from_fn(|a| {
                        f64::from(x[a].0[lane]) + 1.5 + f64::from(BLOCK * offset[a])
                    });
                    let reaches = x.iter().all(|x| (-1.5..f64::from(BLOCK) + 0.5).contains(x));
                    if reaches && self.is_held(fixed.id[lane]) {
                        let masses = found.get_or_insert_with(|| Box::new([0.0; NODES]));
                        spread(masses, x, f64::from(fixed.mass.0[lane]));
                    }
                }
            }
        }
        found
    }

    fn is_held(&self, id: u32) -> bool {
        self.rules.field(self.pins, &self.substep, id).is_some()
    }
}

/// Adds the mass of a particle at `x` from the first node of a block [cells] to those of its nodes that it reaches.
fn spread(masses: &mut [f64; NODES], x: [f64; 3], mass: f64) {
    let cell = x.map(|x| x.round());
    // Weights of the nodes -1, 0, 1 along each axis.
    let weights: [[f64; 3]; 3] = std::array::from_fn(|a| {
        let d = x[a] - cell[a];
        let (low, high) = (0.5 - d, 0.5 + d);
        [0.5 * low * low, 0.75 - d * d, 0.5 * high * high]
    });
    let nodes = |a: usize| {
        (0..3).filter_map(move |n| {
            let node = cell[a] as i32 + n as i32 - 1;
            (0..BLOCK).contains(&node).then_some((node as usize, n))
        })
    };
    for (i, u) in nodes(0) {
        for (j, v) in nodes(1) {
            for (k, w) in nodes(2) {
                masses[16 * i + 4 * j + k] += weights[0][u] * weights[1][v] * weights[2][w] * mass;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mass_among_the_nodes_of_a_block_is_all_there() {
        let mut masses = [0.0; NODES];
        spread(&mut masses, [1.2, 1.9, 2.0], 0.7);
        let sum: f64 = masses.iter().sum();
        assert!((sum - 0.7).abs() < 1e-15, "{sum}");
        for a in 0..3 {
            let place = |at: usize| [at / 16, at / 4 % 4, at % 4][a] as f64;
            let first: f64 = (0..NODES).map(|at| masses[at] * place(at)).sum();
            assert!((first / 0.7 - [1.2, 1.9, 2.0][a]).abs() < 1e-14, "{first}");
        }
        // At a corner only one of eight nodes is of the block.
        let mut corner = [0.0; NODES];
        spread(&mut corner, [-0.5, -0.5, -0.5], 1.0);
        assert_eq!(corner[0], 0.125);
        assert_eq!(corner.iter().sum::<f64>(), 0.125);
    }
}
