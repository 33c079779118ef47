//! Nodes whose matter is attached to flat boundaries along the axes move as lines across them.

use std::{borrow::Cow, cell::Cell};

use rayon::prelude::*;

use super::{
    NODES, NONE, NodeBlock, Velocities,
    anchors::Anchors,
    approach::{BlockConstraints, BoundaryConditions},
    boundary::{attaches, constrain, holds_matter},
    place_of,
    topology::Place,
};
use crate::{
    colliders::{Attached, Face, Nodes, attached, attached_line},
    ledger::ColliderImpulses,
    particles::BLOCK,
};

/// Node blocks per task at least, of all and of those near such a boundary.
const TASK: [usize; 2] = [256, 8];
/// Not looked for yet.
const UNKNOWN: u32 = NONE - 1;

/// A block near a boundary as it was before.
struct Before<'a> {
    /// Which of all blocks it is.
    n: usize,
    block: &'a NodeBlock,
    velocities: Velocities,
    allowed: Option<BlockConstraints<'a>>,
}

/// A block near a boundary as it becomes: which of all it is, and what colliders give it.
type NearBlock<'a> = (
    usize,
    &'a NodeBlock,
    &'a mut Velocities,
    &'a mut ColliderImpulses,
);

/// A block and those around it, as they were.
struct Around<'a> {
    place: Place,
    own: &'a Before<'a>,
    /// Per offset the number of a block, [`NONE`] or [`UNKNOWN`]: lines end in few of the blocks around.
    blocks: [Cell<u32>; 27],
    places: &'a [Place],
    before: &'a [Before<'a>],
    frame_velocity: [f64; 3],
    /// Substep [s].
    dt: f64,
    anchors: &'a Anchors<'a>,
}

impl Around<'_> {
    /// The block that holds a node, at most one block away, and the node's place in it.
    fn at(&self, index: [i32; 3]) -> Option<(&Before<'_>, usize)> {
        let (field, here) = self.place;
        let place: [i32; 3] = std::array::from_fn(|a| index[a].div_euclid(BLOCK));
        let [i, j, k] = index.map(|i| i.rem_euclid(BLOCK));
        let node = ((i * BLOCK + j) * BLOCK + k) as usize;
        if place == here {
            return Some((self.own, node));
        }
        let [x, y, z] = std::array::from_fn(|a| place[a] - here[a] + 1);
        let known = &self.blocks[((x * 3 + y) * 3 + z) as usize];
        if known.get() == UNKNOWN {
            let found = self.places.binary_search(&(field, place));
            known.set(found.map_or(NONE, |n| n as u32));
        }
        (known.get() != NONE).then(|| (&self.before[known.get() as usize], node))
    }
}

impl Nodes for Around<'_> {
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
        let (block, at) = self.at(index)?;
        let node = &block.velocities.0[at / 4].0[4 * (at % 4)..][..4];
        let velocity = std::array::from_fn(|a| f64::from(node[a]) + self.frame_velocity[a]);
        (node[3] != 0.0).then_some((node[3].into(), velocity))
    }

    fn gap(&self, index: [i32; 3], body: usize) -> f64 {
        self.at(index)
            .and_then(|(block, at)| Some(block.allowed.as_ref()?.gap(at, body)))
            .unwrap_or(f64::INFINITY)
    }
}

/// Applies colliders and held regions to the blocks with lines of nodes that end at flat boundaries. Returns the largest magnitude of a
/// velocity component, or speed of a boundary there, as bits.
pub(super) fn attach(
    nodes: &[NodeBlock],
    velocities: &mut [Velocities],
    given: &mut [ColliderImpulses],
    acting: &BoundaryConditions<'_>,
) -> u32 {
    if acting.boundaries.is_empty() {
        return 0;
    }
    let mut near: Vec<NearBlock<'_>> = nodes
        .par_iter()
        .zip(velocities)
        .zip(given)
        .enumerate()
        .with_min_len(TASK[0])
        .filter_map(|(n, ((block, out), given))| {
            let acts = attaches(acting.boundaries, block.index);
            (acts && holds_matter(out)).then_some((n, block, out, given))
        })
        .collect();
    let places: Vec<Place> = near
        .iter()
        .map(|(_, at, ..)| (at.field, at.index))
        .collect();
    let fields = 0..places.last().map_or(0, |last| last.0 + 1);
    let faces: Vec<Cow<'_, [Face]>> = fields.map(|f| acting.boundaries.faces_for(f)).collect();
    let before: Vec<Before<'_>> = near
        .par_iter()
        .with_min_len(TASK[1])
        .map(|&(n, block, ref out, _)| Before {
            n,
            block,
            velocities: **out,
            allowed: acting.on(block),
        })
        .collect();
    near.par_iter_mut()
        .zip(&before)
        .zip(&places)
        .with_min_len(TASK[1])
        .map(|(((_, _, out, given), own), &place)| {
            let around = Around {
                place,
                own,
                blocks: [const { Cell::new(UNKNOWN) }; 27],
                places: &places,
                before: &before,
                frame_velocity: acting.frame_velocity,
                dt: acting.dt,
                anchors: acting.anchors,
            };
            constrain_block(out, given, &around, &faces[place.0 as usize])
        })
        .reduce(|| 0, u32::max)
}

/// All conditions on the nodes of one block, which are what they were. Returns the largest magnitude as above.
fn constrain_block(
    out: &mut Velocities,
    given: &mut ColliderImpulses,
    around: &Around<'_>,
    faces: &[Face],
) -> u32 {
    let allowed = around.own.allowed.as_ref();
    let speed = allowed.map_or(0, |allowed| (allowed.speed() as f32).to_bits());
    let (_, block) = around.place;
    let corners = [0, BLOCK - 1].map(|i| block.map(|b| BLOCK * b + i));
    let mut near = faces
        .iter()
        .filter(|face| face.is_near(corners[0], corners[1], 1.0));
    let near = [near.next(), near.next()];
    // Nearly always.
    let lines = match near {
        [Some(face), None] => LinesOfBlock::new(face, block, around),
        _ => LinesOfBlock::default(),
    };
    let left = constrain(out, around.frame_velocity, |at, mass, v| {
        let (own, index) = (around.own, place_of(block, at));
        let mass = around.anchors.matter(own.n, own.block, at, mass.into());
        let obeyed = match near {
            [None, _] => None,
            [Some(face), None] => lines.get(at).map(|v| Attached::to(face, v)),
            _ => attached(faces, index, around, 1.0, around.dt),
        };
        let obeyed = obeyed.unwrap_or(Attached::free(v));
        for change in obeyed.changes(index, v, 1.0) {
            given.add(mass, &change);
        }
        match allowed {
            Some(allowed) => allowed.constrain(at, &obeyed, &mut |change| {
                given.add(mass, &change);
            }),
            None => obeyed.velocity,
        }
    });
    speed.max(left)
}

/// What a face alone makes of the nodes of a block.
struct LinesOfBlock {
    velocities: [[f64; 3]; NODES],
    /// Nodes that it acts on, one bit each.
    mask: u64,
}

impl Default for LinesOfBlock {
    fn default() -> Self {
        Self {
            velocities: [[0.0; 3]; NODES],
            mask: 0,
        }
    }
}

impl LinesOfBlock {
    fn new(face: &Face, block: [i32; 3], around: &Around<'_>) -> Self {
        let mut found = Self::default();
        let (axis, [first, last]) = face.lines();
        let start = BLOCK * block[axis];
        let within = first.max(start)..=last.min(start + BLOCK - 1);
        if within.is_empty() {
            return found;
        }
        let stride = [16, 4, 1];
        let across = [[1, 2], [0, 2], [0, 1]][axis].map(|a| stride[a]);
        for line in 0..16 {
            let first = across[0] * (line / 4) + across[1] * (line % 4);
            let place = place_of(block, first);
            if let Some(of_line) = attached_line(face, place, around, 1.0, around.dt) {
                for i in within.clone() {
                    let at = first + stride[axis] * (i - start) as usize;
                    found.velocities[at] = of_line[face.rank_of(i)];
                    found.mask |= 1 << at;
                }
            }
        }
        found
    }

    fn get(&self, at: usize) -> Option<[f64; 3]> {
        (self.mask >> at & 1 == 1).then(|| self.velocities[at])
    }
}
