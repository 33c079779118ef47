//! Contact between objects that deform: impulses between their velocity fields at the nodes that they share.
//!
//! Order: shared nodes and normals (`sites`), normals of patches (`patches`), gaps (`gap`), impulses (`solve`).

mod gap;
mod impulse;
mod patches;
mod sites;
mod solve;

use sites::{Sites, read};
use solve::Surroundings;

use crate::{
    grid::{Grid, approach::Acting},
    mat3::dot,
    particles::Particles,
    scene::ContactMethod,
};

/// Nodes lighter than this share of the heaviest particle meet nobody.
const LIGHTEST: f32 = 1e-12;

/// What contact in one substep works on.
pub(crate) struct Meeting<'a> {
    /// The method.
    pub method: ContactMethod,
    /// All particles.
    pub particles: &'a Particles,
    /// Per part the volume of one unit of mass at rest [cells].
    pub cells_per_mass: &'a [f64],
    /// The same per field.
    pub fullness: &'a [f64],
    /// Friction coefficient of two fields, the lower first.
    pub friction: &'a (dyn Fn([u32; 2]) -> f64 + Sync),
    /// Everything that acts on nodes.
    pub acting: Acting<'a>,
    /// Velocity that those of nodes are relative to [cells/s].
    pub carrier: [f64; 3],
}

/// Lets the objects of a grid meet; returns the largest velocity component given [cells/s].
pub(crate) fn meet(grid: &mut Grid, meeting: &Meeting<'_>) -> f32 {
    let on_nodes = matches!(
        meeting.method,
        ContactMethod::MultiField | ContactMethod::TwoScale
    );
    if !on_nodes || grid.shared.is_empty() {
        return 0.0;
    }
    let mut sites = Sites::find(grid, meeting.fullness);
    if sites.sites.is_empty() {
        return 0.0;
    }
    if meeting.method == ContactMethod::TwoScale {
        patches::smooth_normals(&mut sites);
        let wanted = approaching(grid, &sites);
        gap::measure_gaps(
            &mut sites,
            &wanted,
            meeting.particles,
            grid,
            meeting.cells_per_mass,
        );
    }
    let friction: Vec<f64> = sites
        .sites
        .iter()
        .map(|site| (meeting.friction)(site.fields))
        .collect();
    let around = Surroundings {
        acting: meeting.acting,
        carrier: meeting.carrier,
    };
    let solved = solve::solve(grid, &sites, &friction, &around);
    let mut largest = 0_u32;
    for place in solved {
        for (n, block) in place.blocks {
            for v in block.0.iter().flat_map(|row| row.0.chunks_exact(4)) {
                for v in &v[..3] {
                    // As integers, so that NaN is the largest of all.
                    largest = largest.max(v.abs().to_bits());
                }
            }
            grid.velocities[n] = block;
        }
    }
    f32::from_bits(largest)
}

/// Per node, whether its two sides approach.
fn approaching(grid: &Grid, sites: &Sites) -> Vec<bool> {
    let mut wanted = Vec::with_capacity(sites.nodes.len());
    for site in &sites.sites {
        for node in &sites.nodes[site.range()] {
            let [(a, _), (b, _)] = site.blocks.map(|n| read(&grid.velocities[n], node.at));
            let u: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
            wanted.push(dot(u, node.normal) > 0.0);
        }
    }
    wanted
}

#[cfg(test)]
mod tests;
