//! Particles from filled voxels and from surfaces that enclose nothing.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{
    FillReport, Filled,
    cut::Cut,
    grid::Grid,
    sites::{Site, join_slivers},
};

/// Full sites are moved by at most this part of their edge along each axis, which breaks the alignment of
/// particles with the grid.
const JITTER: f64 = 0.1;
/// One particle per site.
pub fn particles(
    grid: &Grid,
    density: &[f32],
    cut: &Cut,
    seed: u64,
    mut report: FillReport,
) -> Filled {
    let lattice = Grid {
        origin: grid.origin,
        voxel: grid.voxel * grid.site as f64,
        size: grid.size.map(|n| n / grid.site),
        site: 1,
    };
    let mut solid = vec![Site::default(); lattice.len()];
    for (i, part) in cut
        .inside
        .iter()
        .enumerate()
        .filter(|(_, part)| **part > 0.0)
    {
        let p = grid.coordinates(i);
        solid[lattice.index(p.map(|x| x / grid.site))].add(middle(p), f64::from(*part));
    }
    let full = (grid.site as f64).powi(3);
    join_slivers(lattice.size, &mut solid, full);
    let mut out = Filled::default();
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let cube = grid.voxel.powi(3);
    let mut push = |site: &Site, jitter: f64| {
        let position = std::array::from_fn(|a| {
            let shift = f64::from(rng.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0;
            let middle = site.moment[a] / site.volume + jitter * shift * grid.site as f64;
            grid.origin[a] + grid.voxel * middle
        });
        out.position.push(position);
        out.volume.push(site.volume * cube);
    };
    for site in solid.iter().filter(|site| site.volume > 0.0) {
        let whole = (site.volume - full).abs() < 1e-3 * full;
        push(site, if whole { JITTER } else { 0.0 });
        report.solid_volume += site.volume * cube;
    }

    // Surface that no solid particle is near: leaves, cloth, single sheets.
    let covered = lattice.distance(|i| solid[i].volume > 0.0);
    let mut thin = vec![(Site::default(), 0.0f64); lattice.len()];
    for i in (0..cut.thin.len()).filter(|&i| cut.thin[i]) {
        let p = grid.coordinates(i);
        let at = lattice.index(p.map(|x| x / grid.site));
        // More than one site away along an axis.
        if covered[at] > 5 {
            thin[at].0.add(middle(p), f64::from(density[i]));
            thin[at].1 += 1.0;
        }
    }
    for (site, voxels) in thin.iter().filter(|(site, _)| site.volume > 0.0) {
        let scale = voxels / site.volume;
        let site = Site {
            volume: *voxels,
            moment: site.moment.map(|m| m * scale),
        };
        push(&site, 0.0);
        report.thin_particles += 1;
        report.thin_volume += voxels * cube;
    }
    report.operations += 2 * grid.len() as u64;
    out.report = report;
    out
}

/// Middle of a voxel, in voxels.
fn middle(voxel: [usize; 3]) -> [f64; 3] {
    voxel.map(|x| x as f64 + 0.5)
}
