//! Nodes whose matter is attached to flat boundaries along the axes move as lines across them.

use rayon::prelude::*;

use super::{
    NONE, NodeBlock, Velocities,
    approach::{Acting, Allowed},
    boundary::attaches,
    node_pass::{constrain, holds_matter},
    topology::neighbours,
};
use crate::{
    colliders::attach::{Attached, Nodes, attached},
    particles::BLOCK,
};

/// A block near such a boundary as it was before.
struct Before<'a> {
    velocities: Velocities,
    allowed: Option<Allowed<'a>>,
}

/// A block and those around it, as they were.
struct Around<'a> {
    /// Per offset, or [`NONE`].
    blocks: [u32; 27],
    index: [i32; 3],
    before: &'a [Before<'a>],
    carrier: [f64; 3],
}

impl Around<'_> {
    /// The block that holds a node, at most one block away, and the node's place in it.
    fn at(&self, index: [i32; 3]) -> Option<(&Before<'_>, usize)> {
        let offset: [i32; 3] =
            std::array::from_fn(|a| index[a].div_euclid(BLOCK) - self.index[a] + 1);
        let block = self.blocks[((offset[0] * 3 + offset[1]) * 3 + offset[2]) as usize];
        let [i, j, k] = index.map(|i| i.rem_euclid(BLOCK));
        (block != NONE).then(|| {
            (
                &self.before[block as usize],
                ((i * BLOCK + j) * BLOCK + k) as usize,
            )
        })
    }
}

impl Nodes for Around<'_> {
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
        let (block, at) = self.at(index)?;
        let node = &block.velocities.0[at / 4].0[4 * (at % 4)..][..4];
        let velocity = std::array::from_fn(|a| f64::from(node[a]) + self.carrier[a]);
        (node[3] != 0.0).then_some((node[3].into(), velocity))
    }

    fn gap(&self, index: [i32; 3], body: usize) -> f64 {
        self.at(index)
            .and_then(|(block, at)| Some(block.allowed.as_ref()?.gap(at, body)))
            .unwrap_or(f64::INFINITY)
    }
}

/// Applies colliders and held regions to the blocks near flat boundaries that matter may be attached to. Returns the
/// largest magnitude of a velocity component, or speed of a boundary there, as bits.
pub(super) fn attach(
    nodes: &[NodeBlock],
    velocities: &mut [Velocities],
    acting: &Acting<'_>,
    carrier: [f64; 3],
) -> u32 {
    if acting.boundaries.faces().is_empty() {
        return 0;
    }
    let near: Vec<usize> = (0..nodes.len())
        .into_par_iter()
        .filter(|&n| attaches(acting.boundaries, nodes[n].index) && holds_matter(&velocities[n]))
        .collect();
    let before: Vec<Before<'_>> = near
        .par_iter()
        .map(|&n| Before {
            velocities: velocities[n],
            allowed: acting.on(&nodes[n]),
        })
        .collect();
    let place = |&n: &usize| (nodes[n].field, nodes[n].index);
    let after: Vec<(u32, Velocities)> = near
        .par_iter()
        .zip(&before)
        .map(|(n, block)| {
            let around = Around {
                blocks: neighbours(&near, place(n), place),
                index: nodes[*n].index,
                before: &before,
                carrier,
            };
            constrain_block(block, &around, acting)
        })
        .collect();
    let mut largest = 0;
    for (n, (speed, block)) in near.into_iter().zip(after) {
        velocities[n] = block;
        largest = largest.max(speed);
    }
    largest
}

/// All conditions on the nodes of one block.
fn constrain_block(
    block: &Before<'_>,
    around: &Around<'_>,
    acting: &Acting<'_>,
) -> (u32, Velocities) {
    let allowed = block.allowed.as_ref();
    let given = allowed.map_or(0, |allowed| (allowed.speed() as f32).to_bits());
    let mut out = block.velocities;
    let left = constrain(&mut out, around.carrier, |at, v| {
        let local = [at / 16, at / 4 % 4, at % 4];
        let index = std::array::from_fn(|a| BLOCK * around.index[a] + local[a] as i32);
        let obeyed = attached(acting.boundaries.faces(), index, around, 1.0);
        let obeyed = obeyed.unwrap_or(Attached::free(v));
        match allowed {
            Some(allowed) => allowed.constrain_rest(at, &obeyed),
            None => obeyed.velocity,
        }
    });
    (given.max(left), out)
}
