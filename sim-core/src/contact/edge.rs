//! Where the matter of two objects ends between them, told by the masses of nodes, as in front of colliders
//! ([`crate::colliders::edge`]): the nearest particles of both may lie a cell beside a node's normal, which closes gaps
//! between curved bodies too early and at the facets of their lattices.
//!
//! Along the normal through a node one side ends at the height that its share of the mass inside says, the other begins
//! at the one that its own does: `gap = h_a + h_b`, told at the node of that line that lies midway, where both shares are
//! far from 0 and 1.

use rayon::prelude::*;

use super::sites::{ContactBlock, ContactBlocks, Node, coordinates, read};
use crate::{
    colliders::edge::{end, gap, nearest_node},
    grid::{Grid, NONE, anchors::Anchors},
    particles::BLOCK,
};

/// Farthest that the middle is from the node whose gap it is along an axis [nodes].
const LINE_OFFSET_MAX: f64 = 1.0;
/// Gap that is looked into even where nothing closes it by itself: pairs that share a node may push each other [cells].
const GAP_LOOKAHEAD: f64 = 0.1;

/// How the two sides of a node come nearer along its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ClosingSpeed {
    /// How fast [cells/s].
    pub speed: f64,
    /// By how much since their particles came to the grid, as far as that was in an earlier substep [cells].
    pub closed: f64,
}

/// What masses say of the gaps of all nodes, site after site.
pub(super) struct Edges {
    /// Gaps [cells]; infinitely negative where only particles know.
    gaps: Vec<f64>,
    /// Whether a node may press, so that its nearest particles have to be asked too: what approaches across a gap that
    /// closes within the substep or nearly does.
    pub close: Vec<bool>,
}

/// Asks the masses, where both fields tell edges and approach each other, per node.
pub(super) fn edges(
    sites: &ContactBlocks,
    approaches: &[ClosingSpeed],
    grid: &Grid,
    reconstructs_surface: &[bool],
    anchors: &Anchors<'_>,
) -> Edges {
    let gaps: Vec<Vec<f64>> = sites
        .sites
        .par_iter()
        .map(|site| {
            let nodes = &sites.nodes[site.range()];
            if !site
                .fields
                .iter()
                .all(|&field| reconstructs_surface[field as usize])
            {
                return vec![f64::NEG_INFINITY; nodes.len()];
            }
            let around = Around::new(grid, site, anchors);
            let nodes = nodes.iter().zip(&approaches[site.range()]);
            let gap = |(node, approach): (&Node, &ClosingSpeed)| match approach.speed > 0.0 {
                true => around.gap(coordinates(node.at), node.normal),
                false => f64::NEG_INFINITY,
            };
            nodes.map(gap).collect()
        })
        .collect();
    let gaps = gaps.concat();
    let close = sites.sites.iter().flat_map(|site| {
        let range = site.range();
        let nodes = gaps[range.clone()].iter().zip(&approaches[range]);
        let left = site.left();
        nodes.map(move |(gap, approach)| {
            approach.speed > 0.0 && gap - approach.closed < closes(approach.speed, left)
        })
    });
    Edges {
        close: close.collect(),
        gaps,
    }
}

/// Gap that an approach at some speed [cells/s] may close in what is left of a substep [s], in cells.
fn closes(speed: f64, left: f64) -> f64 {
    GAP_LOOKAHEAD.max(speed * left)
}

impl Edges {
    /// Widens the gaps of nodes, as the nearest particles say them where they were asked, and takes off what has closed
    /// since.
    pub fn widen(&self, nodes: &mut [Node], approaches: &[ClosingSpeed]) {
        let told = self.gaps.iter().zip(&self.close);
        for ((node, (&edge, &asked)), approach) in nodes.iter_mut().zip(told).zip(approaches) {
            if edge > f64::NEG_INFINITY {
                node.gap = gap(if asked { node.gap } else { edge }, edge);
            }
            node.gap -= approach.closed;
        }
    }
}

/// The node blocks of both fields at a site and around it.
struct Around<'a> {
    grid: &'a Grid,
    anchors: &'a Anchors<'a>,
    blocks: [&'a [u32; 27]; 2],
}

impl<'a> Around<'a> {
    fn new(grid: &'a Grid, site: &ContactBlock, anchors: &'a Anchors<'a>) -> Self {
        let here = &grid.shared[site.shared].nodes;
        let sharers = &grid.sharers[here.clone()];
        let blocks = site.blocks.map(|block| {
            let sharer = sharers.iter().position(|&n| n as usize == block);
            &grid.around[here.start + sharer.unwrap_or(0)]
        });
        Self {
            grid,
            anchors,
            blocks,
        }
    }

    /// Mass of the matter of a side at a node, at most a block away: a line begins at most `LINE_OFFSET_MAX` its node, and three of its nodes count.
    fn mass(&self, side: usize, at: [i32; 3]) -> f64 {
        let [x, y, z] = at.map(|i| i.div_euclid(BLOCK) + 1);
        let block = self.blocks[side][(9 * x + 3 * y + z) as usize];
        if block == NONE {
            return 0.0;
        }
        let [i, j, k] = at.map(|i| i.rem_euclid(BLOCK));
        let (n, node) = (block as usize, ((i * BLOCK + j) * BLOCK + k) as usize);
        let mass = read(&self.grid.velocities[n], node).1;
        self.anchors.matter(n, &self.grid.nodes[n], node, mass)
    }

    /// Height above a node from which on a side covers it, looking inwards [cells]; infinite where there is none of it.
    fn height(&self, side: usize, at: [i32; 3], inward: [f64; 3]) -> f64 {
        end(|n| {
            let along = |a: usize| at[a] + nearest_node(f64::from(n) * inward[a]);
            self.mass(side, std::array::from_fn(along))
        })
    }

    /// Distance of the two sides in the line of nodes along a normal [cells]; infinite where one has no matter in it.
    fn gap(&self, at: [i32; 3], normal: [f64; 3]) -> f64 {
        let heights = |at| {
            let inward = [normal.map(|n| -n), normal];
            [0, 1].map(|side| self.height(side, at, inward[side]))
        };
        let [a, b] = heights(at);
        // How far the middle is from the node along the normal.
        let middle = 0.5 * (b - a);
        if !middle.is_finite() {
            return f64::INFINITY;
        }
        let step =
            |a: usize| nearest_node((middle * normal[a]).clamp(-LINE_OFFSET_MAX, LINE_OFFSET_MAX));
        let better = std::array::from_fn(|a| at[a] + step(a));
        let [a, b] = if better == at {
            [a, b]
        } else {
            heights(better)
        };
        a + b
    }
}
