//! Contact between objects that deform: impulses between their velocity fields at the nodes that they share.
//!
//! Order: shared nodes and normals (`sites`), normals of patches (`patches`), gaps (`edge`, `gap`), impulses (`solve`), and
//! objects as wholes (`motion`), of which [`episodes`](crate::episodes) ask restitution.

mod edge;
mod gap;
mod impulse;
mod motion;
mod patches;
mod sites;
mod solve;

use edge::ClosingSpeed;
pub(crate) use gap::{LARGEST_RADIUS, Radii};
use motion::Fields;
use sites::{ContactBlocks, read};
use solve::{Surroundings, by_pair};

use crate::{
    episodes::{Episodes, PairExchange, RequestedRestitution},
    grid::{Grid, approach::BoundaryConditions},
    mat3::dot,
    particles::Particles,
    scene::ContactMethod,
    simd::Isa,
};

/// Nodes lighter than this share of the heaviest particle meet nobody.
const LIGHTEST: f32 = 1e-12;

/// What contact in one substep works on.
pub(crate) struct ContactInput<'a> {
    /// The method.
    pub method: ContactMethod,
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// All particles.
    pub particles: &'a Particles,
    /// Per part the volume of one unit of mass at rest [cells].
    pub cells_per_mass: &'a [f64],
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
    /// Substep [s].
    pub dt: f64,
    /// Everything that acts on nodes.
    pub acting: BoundaryConditions<'a>,
    /// Velocity that those of nodes are relative to [cells/s].
    pub frame_velocity: [f64; 3],
}

/// What contact looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Work {
    /// Nodes that two objects shared.
    pub nodes: u64,
    /// Particles, for gaps.
    pub particles: u64,
}

/// What came of a meeting.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactResult {
    /// What pairs exchanged.
    pub exchanged: Vec<PairExchange>,
    /// Largest velocity component that some node was given [cells/s]; NaN when one is.
    pub largest: f32,
    /// What it took.
    pub work: Work,
}

/// Lets the objects of a grid meet.
pub(crate) fn meet(
    grid: &mut Grid,
    meeting: &ContactInput<'_>,
    episodes: &mut Episodes,
) -> ContactResult {
    let on_nodes = matches!(
        meeting.method,
        ContactMethod::MultiField | ContactMethod::TwoScale
    );
    if !on_nodes {
        return ContactResult::default();
    }
    let (sites, work) = touching(grid, meeting);
    let friction: Vec<f64> = sites
        .sites
        .iter()
        .map(|site| (meeting.friction)(site.fields))
        .collect();
    let around = Surroundings {
        acting: meeting.acting,
        frame_velocity: meeting.frame_velocity,
    };
    let solved = solve::solve(grid, &sites, &friction, &around);
    let mut exchanged = by_pair(&sites.sites, &solved);
    let mut fields = Fields { grid, largest: 0 };
    episodes.take_in(&fields, &exchanged, meeting.frame_velocity, meeting.dt);
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
    let resting = 2.0 * meeting.gravity * meeting.dt;
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
        work,
    }
}

/// The nodes that objects share, with their normals and, where the method asks for them, gaps.
fn touching(grid: &Grid, meeting: &ContactInput<'_>) -> (ContactBlocks, Work) {
    let acting = &meeting.acting;
    let mut sites = ContactBlocks::find(
        grid,
        meeting.specific_volumes,
        acting.passes,
        acting.anchors,
    );
    let mut work = Work {
        nodes: sites.nodes.len() as u64,
        particles: 0,
    };
    if meeting.method == ContactMethod::TwoScale && !sites.sites.is_empty() {
        patches::smooth_normals(&mut sites);
        let approaches = approaches(grid, &sites, meeting.frame_velocity);
        let edges = edge::edges(
            &sites,
            &approaches,
            grid,
            acting.reconstructs_surface,
            acting.anchors,
        );
        work.particles = gap::measure_gaps(
            &mut sites,
            &edges.close,
            meeting.particles,
            grid,
            meeting.cells_per_mass,
            meeting.isa,
        );
        edges.widen(&mut sites.nodes, &approaches);
    }
    (sites, work)
}

/// Per node how its two sides approach along its normal.
fn approaches(grid: &Grid, sites: &ContactBlocks, frame_velocity: [f64; 3]) -> Vec<ClosingSpeed> {
    let mut found = Vec::with_capacity(sites.nodes.len());
    for site in &sites.sites {
        for node in &sites.nodes[site.range()] {
            let [(a, _), (b, _)] = site.blocks.map(|n| read(&grid.velocities[n], node.at));
            let u: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
            let [far_a, far_b] = site.passes.map(|pass| pass.elapsed);
            let way = std::array::from_fn(|i| {
                far_a * (a[i] + frame_velocity[i]) - far_b * (b[i] + frame_velocity[i])
            });
            found.push(ClosingSpeed {
                speed: dot(u, node.normal),
                closed: dot(way, node.normal),
            });
        }
    }
    found
}

#[cfg(test)]
mod tests;
