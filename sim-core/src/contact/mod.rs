//! Contact between objects that deform: impulses between their velocity fields at the nodes that they share.
//!
//! Order: shared nodes and normals (`sites`), impulses (`solve`), and rigid motions (`motion`), which
//! [`episodes`](crate::episodes) tell of.

mod impulse;
mod motion;
mod sites;
mod solve;

use motion::rigid_motion;
use sites::ContactBlocks;
use solve::by_pair;

use crate::{
    episodes::{Episodes, PairExchange},
    grid::{Grid, approach::BoundaryConditions},
    scene::ContactMethod,
};

/// Nodes lighter than this share of the heaviest particle meet nobody.
const LIGHTEST: f32 = 1e-12;

/// What contact in one substep works on.
pub(crate) struct ContactInput<'a> {
    /// The method.
    pub method: ContactMethod,
    /// Per field the rest volume per mass, up to a common factor.
    pub specific_volumes: &'a [f64],
    /// Friction coefficient of two fields, the lower first.
    pub friction: &'a (dyn Fn([u32; 2]) -> f64 + Sync),
    /// Simulated time at the end of the substep [s].
    pub time: f64,
    /// Everything that acts on nodes.
    pub acting: BoundaryConditions<'a>,
}

/// What came of a meeting.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactResult {
    /// What pairs exchanged.
    pub exchanged: Vec<PairExchange>,
    /// Largest velocity component that some node was given [cells/s]; NaN when one is.
    pub largest: f32,
    /// Nodes that two objects shared.
    pub nodes: u64,
}

/// Lets the objects of a grid meet.
pub(crate) fn meet(
    grid: &mut Grid,
    meeting: &ContactInput<'_>,
    episodes: &mut Episodes,
) -> ContactResult {
    if !meeting.method.tells_apart() {
        return ContactResult::default();
    }
    let acting = &meeting.acting;
    let sites = ContactBlocks::find(grid, meeting.specific_volumes, acting.anchors);
    let friction: Vec<f64> = sites
        .sites
        .iter()
        .map(|site| (meeting.friction)(site.fields))
        .collect();
    let solved = solve::solve(grid, &sites, &friction, acting);
    let exchanged = by_pair(&sites.sites, &solved);
    let motion = |field| rigid_motion(grid, field);
    episodes.book(&exchanged, motion, [acting.dt, meeting.time]);
    // As bits: as integers, so that NaN is the largest of all.
    let mut largest = 0;
    let blocks = solved
        .into_iter()
        .flat_map(|place| place.blocks.into_iter().zip(place.given));
    for ((n, block), given) in blocks {
        for node in block.0.iter().flat_map(|row| row.0.chunks_exact(4)) {
            for v in &node[..3] {
                largest = largest.max(v.abs().to_bits());
            }
        }
        grid.velocities[n] = block;
        grid.given_to_nodes[n].merge(&given);
    }
    ContactResult {
        exchanged,
        largest: f32::from_bits(largest),
        nodes: sites.nodes.len() as u64,
    }
}

#[cfg(test)]
mod tests;
