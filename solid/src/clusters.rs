//! Clusters of a surface: points near each other, which are looked for together.

use std::ops::Range;

use super::{
    nodes::NODES,
    search::{Bounds, CLUSTER, NOWHERE, PART, PARTS},
    surface::SurfacePoint,
};
use crate::mat3::length;

/// Share of their nodes' way that points are taken to go, where those at the ends of a cluster go no farther. Weights average: 0.3 of it in the
/// median of `fig4`, 0.55 in nine of ten, and the ways of two sides seldom add up. But what turns goes as far as its nodes. Contacts began no
/// deeper with 0.35 than with 1, within what moves in a substep.
const MOVED: f64 = 0.4;

/// Points that follow each other in the list, `CLUSTER` of them but for the last, and are near each other.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// Their places in the list.
    pub points: Range<usize>,
    /// Middle of every part of them at rest [m].
    pub middles: [[f64; 3]; PARTS],
    /// Blocks of the nodes that move them.
    blocks: Vec<u32>,
    /// Largest sum of magnitudes of a point's weights: how much farther than nodes it may move.
    pub spread: f64,
}

impl Cluster {
    /// Of the points from the `first` on.
    pub fn new(all: &[SurfacePoint], first: usize) -> Self {
        let points = first..all.len().min(first + CLUSTER);
        let here = &all[points.clone()];
        let nodes = here.iter().flat_map(|point| &point.bears);
        let mut blocks: Vec<u32> = nodes.map(|node| node.0 / NODES as u32).collect();
        blocks.sort_unstable();
        blocks.dedup();
        let spread = |point: &SurfacePoint| -> f64 {
            point.bears.iter().map(|b| f64::from(b.1.abs())).sum()
        };
        Self {
            spread: here.iter().map(spread).fold(1.0, f64::max),
            middles: parts_of(here, |point| point.x).map(middle),
            points,
            blocks,
        }
    }

    /// Places in the list of its first and last point.
    pub fn ends(&self) -> [usize; 2] {
        [self.points.start, self.points.end - 1]
    }

    /// How far its points have moved where the nodes of every block have moved so far [m], but for what turns.
    pub fn way(&self, ways: &[f64]) -> f64 {
        let of_blocks = self.blocks.iter().map(|&block| ways[block as usize]);
        MOVED * self.spread * of_blocks.fold(0.0, f64::max)
    }
}

/// Distance between the farther two of two pairs of places [m].
pub(super) fn farther_of(one: &[[f64; 3]; 2], other: &[[f64; 3]; 2]) -> f64 {
    let pairs = one.iter().zip(other);
    let apart = pairs.map(|(a, b)| length(std::array::from_fn(|n| a[n] - b[n])));
    apart.fold(0.0, f64::max)
}

/// Box around some points [m].
#[inline(always)]
pub(super) fn bounds_of<T>(points: &[T], place: impl Fn(&T) -> [f64; 3]) -> Bounds {
    let [mut min, mut max] = NOWHERE;
    for point in points {
        let x = place(point);
        for a in 0..3 {
            min[a] = min[a].min(x[a]);
            max[a] = max[a].max(x[a]);
        }
    }
    [min, max]
}

/// Boxes around the parts of a cluster [m].
#[inline(always)]
pub(super) fn parts_of(
    points: &[SurfacePoint],
    place: impl Fn(&SurfacePoint) -> [f64; 3],
) -> [Bounds; PARTS] {
    let mut parts = [NOWHERE; PARTS];
    for (points, part) in points.chunks(PART).zip(&mut parts) {
        *part = bounds_of(points, &place);
    }
    parts
}

/// Middle of a box.
pub(super) fn middle([min, max]: Bounds) -> [f64; 3] {
    std::array::from_fn(|a| 0.5 * (min[a] + max[a]))
}

/// Place of a cell along a curve that visits blocks of two, four and so on as wholes (Morton 1966).
pub(super) fn curve(cell: [i64; 3]) -> u64 {
    const BITS: usize = 21;
    let at = cell.map(|c| (c + (1 << (BITS - 1))) as u64);
    (0..BITS).fold(0, |sum, bit| {
        let here = (0..3).map(|a| (at[a] >> bit & 1) << (3 * bit + a));
        sum + here.sum::<u64>()
    })
}
