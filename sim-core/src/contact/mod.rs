//! Contact between objects that deform: impulses between their velocity fields at the nodes that they share.
//!
//! Order: shared nodes and normals (`sites`), impulses (`solve`), and objects as wholes (`motion`), of which
//! [`episodes`](crate::episodes) ask restitution.

mod impulse;
mod motion;
mod sites;
mod solve;

use motion::Fields;
use sites::ContactBlocks;
use solve::by_pair;

use crate::{
    episodes::{Episodes, PairExchange, RequestedRestitution},
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
    /// Restitution that is asked of two fields, the lower first.
    pub wish: &'a dyn Fn([u32; 2]) -> RequestedRestitution,
    /// Size of gravity [cells/s^2].
    pub gravity: f64,
    /// Simulated time [s].
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
    let mut exchanged = by_pair(&sites.sites, &solved);
    let mut fields = Fields { grid, largest: 0 };
    episodes.take_in(&fields, &exchanged, acting.frame_velocity, acting.dt);
    let blocks = solved
        .into_iter()
        .flat_map(|place| place.blocks.into_iter().zip(place.given));
    for ((n, block), given) in blocks {
        for node in block.0.iter().flat_map(|row| row.0.chunks_exact(4)) {
            for v in &node[..3] {
                fields.largest = fields.largest.max(v.abs().to_bits());
            }
        }
        fields.grid.velocities[n] = block;
        fields.grid.given_to_nodes[n].merge(&given);
    }
    // Twice what gravity adds in a substep: bodies at rest on each other do not bounce.
    let resting = 2.0 * meeting.gravity * acting.dt;
    episodes.part(
        &mut fields,
        meeting.wish,
        // Both fall.
        (resting, [0.0; 3]),
        meeting.time,
        &mut exchanged,
    );
    ContactResult {
        exchanged,
        largest: f32::from_bits(fields.largest),
        nodes: sites.nodes.len() as u64,
    }
}

#[cfg(test)]
mod tests;
