//! Particles for splat objects: what is seen is a surface, what moves is the volume behind it.
//!
//! 1. `surfels`: Gaussians become bounded ellipsoids on a voxel grid finer than `dx`.
//! 2. `classify`: voxels are surface, outside, or inside; holes are closed, open vessels stay open.
//! 3. `cut`: the Gaussians' own planes, turned outwards, cut the surface voxels at sub-voxel precision.
//! 4. `sample`: one particle per lattice cell with the volume and the centroid of what is filled in it; parts
//!    thinner than a cell get particles along their surface.

mod classify;
mod cut;
mod grid;
mod sample;
pub(crate) mod sites;
mod surfels;

use crate::assets::Gaussians;

/// How an object is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FillOptions {
    /// Grid cell size of the simulation [m], > 0.
    pub dx: f64,
    /// Particles per filled cell, 1..=64; rounded so that particles sit on a cubic lattice.
    pub particles_per_cell: f64,
    /// Seed of the particles' jitter.
    pub seed: u64,
    /// The object stands on something that hid its underside from the cameras: a cavity that is open only
    /// below (-y) counts as closed.
    pub closed_below: bool,
}

/// Particles that stand for an object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filled {
    /// Positions, in the frame of the Gaussians [m].
    pub position: Vec<[f64; 3]>,
    /// Volume of each [m^3], > 0.
    pub volume: Vec<f64>,
    /// What was found.
    pub report: FillReport,
}

/// What filling found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FillReport {
    /// Edge of a voxel [m].
    pub voxel: f64,
    /// Voxels of the grid.
    pub voxels: usize,
    /// Gaussians left out: a value is not finite, or invisible.
    pub skipped: usize,
    /// Gaussians far from all others, left out.
    pub outliers: usize,
    /// Gaussians whose size was limited to keep the cost of each bounded.
    pub limited: usize,
    /// Gaussians that separate inside from outside.
    pub oriented: usize,
    /// Volume of the solid parts [m^3].
    pub solid_volume: f64,
    /// Volume given to parts too thin to have an inside [m^3].
    pub thin_volume: f64,
    /// The last of the particles, which stand for thin parts.
    pub thin_particles: usize,
    /// Voxel visits: the cost, independent of the machine.
    pub operations: u64,
}

/// Fills the volume that the Gaussians enclose.
///
/// The volumes of the particles of solid parts add up to the volume inside the mid-surface of the Gaussians.
/// No usable Gaussian gives no particle.
pub fn fill(gaussians: &Gaussians, options: &FillOptions) -> Filled {
    let mut report = FillReport::default();
    let sites = options.particles_per_cell.clamp(1.0, 64.0).cbrt().round();
    let spacing = options.dx / sites;
    let Some((grid, surfels)) = surfels::voxelize(gaussians, spacing, &mut report) else {
        return Filled {
            report,
            ..Filled::default()
        };
    };
    let density = surfels::density(&grid, &surfels, &mut report);
    let class = classify::classify(&grid, &density, options.closed_below, &mut report);
    let cut = cut::cut(&grid, &class, surfels, &mut report);
    sample::particles(&grid, &density, &cut, options.seed, report)
}

/// One particle at every Gaussian, as PhysGaussian does: `volume = dx^3 / (particles in that cell)`.
/// Positions that are not finite are left out and counted.
pub fn per_gaussian(gaussians: &Gaussians, dx: f64) -> Filled {
    let mut out = Filled::default();
    let mut cells = Vec::new();
    for p in &gaussians.position {
        let p = p.map(f64::from);
        let cell = p.map(|x| (x / dx).floor());
        if cell.iter().all(|c| c.abs() < 1e15) {
            cells.push(cell.map(|c| c as i64));
            out.position.push(p);
        } else {
            out.report.skipped += 1;
        }
    }
    let mut sorted = cells.clone();
    sorted.sort_unstable();
    let count = |cell: &[i64; 3]| {
        sorted.partition_point(|c| c <= cell) - sorted.partition_point(|c| c < cell)
    };
    out.volume = cells
        .iter()
        .map(|cell| dx.powi(3) / count(cell) as f64)
        .collect();
    out.report.thin_particles = out.position.len();
    out.report.thin_volume = out.volume.iter().sum();
    out
}

#[cfg(test)]
mod tests;
