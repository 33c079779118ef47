//! How far two surfaces are apart: the outermost particles of both sides along the normal of a node.

use rayon::prelude::*;

use super::sites::{Node, Site, Sites, coordinates};
use crate::{
    grid::{Grid, NONE, OFFSETS},
    particles::{BLOCK, Particles},
    simd::{F32x16, LANES},
};

/// Farthest that a particle may be from the normal through a node to count as opposite [cells]: a bit more than
/// half the diagonal between nodes, so that every particle at a surface is seen by some node.
const ASIDE: f32 = 0.9;
/// Farthest from a node along the normal, and along any axis: the reach of the splines [cells].
const REACH: f32 = 1.5;
/// Particles are taken for balls of their volume at rest, but none larger than this [cells].
const LARGEST_RADIUS: f64 = 0.5;

/// Measures the gaps of the nodes for which `wanted` says so; returns how many particles it looked at.
pub(super) fn measure_gaps(
    sites: &mut Sites,
    wanted: &[bool],
    particles: &Particles,
    grid: &Grid,
    cells_per_mass: &[f64],
) -> u64 {
    let Sites { sites, nodes } = sites;
    let found: Vec<(Vec<f64>, u64)> = sites
        .par_iter()
        .map(|site| {
            let nodes = &nodes[site.range()];
            let wanted = &wanted[site.range()];
            if !wanted.contains(&true) {
                return (vec![], 0);
            }
            let view = View {
                particles,
                grid,
                cells_per_mass,
                nodes,
                wanted,
            };
            let [(a, n), (b, m)] = [0, 1].map(|side| view.fastest(site, side));
            (a.iter().zip(&b).map(|(a, b)| -(a + b)).collect(), n + m)
        })
        .collect();
    let mut particles = 0;
    for (site, (gaps, looked_at)) in sites.iter().zip(found) {
        particles += looked_at;
        for (node, gap) in nodes[site.range()].iter_mut().zip(gaps) {
            node.gap = gap;
        }
    }
    particles
}

struct View<'a> {
    particles: &'a Particles,
    grid: &'a Grid,
    cells_per_mass: &'a [f64],
    nodes: &'a [Node],
    wanted: &'a [bool],
}

impl View<'_> {
    /// [`outermost`](Self::outermost) with wide registers where the processor has them: same bits, nothing is fused.
    fn fastest(&self, site: &Site, side: usize) -> (Vec<f64>, u64) {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn wide(view: &View<'_>, site: &Site, side: usize) -> (Vec<f64>, u64) {
                view.outermost(site, side)
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the feature that `wide` is compiled for was just detected.
                return unsafe { wide(self, site, side) };
            }
        }
        self.outermost(site, side)
    }

    /// How far particles of one side reach beyond each node along its normal, seen from that side [cells], and how
    /// many it looked at.
    #[inline(always)]
    fn outermost(&self, site: &Site, side: usize) -> (Vec<f64>, u64) {
        let mut looked_at = 0;
        let mut found = vec![f64::NEG_INFINITY; self.nodes.len()];
        let (mut first, mut last) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let sign = if side == 0 { 1.0 } else { -1.0 };
        let mut probes = Vec::with_capacity(self.nodes.len());
        for (n, node) in self
            .nodes
            .iter()
            .enumerate()
            .filter(|(n, _)| self.wanted[*n])
        {
            let at = coordinates(node.at).map(|c| c as f32);
            for a in 0..3 {
                first[a] = first[a].min(at[a] - REACH);
                last[a] = last[a].max(at[a] + REACH);
            }
            let outward = node.normal.map(|c| (sign * c) as f32);
            probes.push((n, Probe { at, outward }));
        }
        for (n, &tile) in self.grid.nodes[site.blocks[side]].tiles.iter().enumerate() {
            if tile == NONE || !overlaps(&self.grid.cells[tile as usize], OFFSETS[n], first, last) {
                continue;
            }
            let block = &self.particles.blocks[tile as usize];
            looked_at += (block.groups.len() * LANES) as u64;
            // From the block's centre to the first node of the site.
            let shift = OFFSETS[n].map(|o| (BLOCK * o) as f32 + 1.5);
            for run in &self.particles.runs[block.runs.clone()] {
                let volume = self.cells_per_mass[run.part];
                // Neighbours mostly have the same mass.
                let mut known = (0.0, 0.0);
                for group in run.groups.clone() {
                    let mut near = Near::new(&self.particles.groups[group].x, shift);
                    if !near.overlaps(first, last) {
                        continue;
                    }
                    let mass = &self.particles.fixed[group].mass.0;
                    for (radius, &mass) in near.radius.iter_mut().zip(mass) {
                        if mass > 0.0 && known.0 != mass {
                            known = (mass, radius_of(volume * f64::from(mass)) as f32);
                        }
                        *radius = if mass > 0.0 {
                            known.1
                        } else {
                            f32::NEG_INFINITY
                        };
                    }
                    for (n, probe) in &probes {
                        let [x, y, z] = probe.at;
                        let low = [x - REACH, y - REACH, z - REACH];
                        let high = [x + REACH, y + REACH, z + REACH];
                        if near.overlaps(low, high) {
                            found[*n] = found[*n].max(f64::from(near.outermost(probe)));
                        }
                    }
                }
            }
        }
        (found, looked_at)
    }
}

/// A node that looks for particles.
struct Probe {
    /// Where it is, relative to the first node of its block [cells].
    at: [f32; 3],
    /// Its normal, away from the side that is searched.
    outward: [f32; 3],
}

/// Sixteen particles relative to the first node of a block [cells].
struct Near {
    x: [[f32; LANES]; 3],
    /// Infinitely negative in unused lanes.
    radius: [f32; LANES],
    /// Box that holds them, unused lanes too.
    bounds: [[f32; 3]; 2],
}

impl Near {
    #[inline(always)]
    fn new(x: &[F32x16; 3], shift: [f32; 3]) -> Self {
        let mut near = Self {
            x: [[0.0; LANES]; 3],
            radius: [f32::NEG_INFINITY; LANES],
            bounds: [[0.0; 3]; 2],
        };
        for a in 0..3 {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for lane in 0..LANES {
                let x = x[a].0[lane] + shift[a];
                near.x[a][lane] = x;
                low = if x < low { x } else { low };
                high = if x > high { x } else { high };
            }
            (near.bounds[0][a], near.bounds[1][a]) = (low, high);
        }
        near
    }

    /// Whether some of them may be in a box.
    #[inline(always)]
    fn overlaps(&self, min: [f32; 3], max: [f32; 3]) -> bool {
        let [low, high] = &self.bounds;
        let mut overlap = true;
        for a in 0..3 {
            overlap &= (low[a] < max[a]) & (high[a] > min[a]);
        }
        overlap
    }

    /// How far they reach beyond a node.
    #[inline(always)]
    fn outermost(&self, probe: &Probe) -> f32 {
        let Probe { at, outward } = probe;
        let mut reach = [f32::NEG_INFINITY; LANES];
        // Without branches, for the vectorizer.
        for lane in 0..LANES {
            let x = self.x[0][lane] - at[0];
            let y = self.x[1][lane] - at[1];
            let z = self.x[2][lane] - at[2];
            let along = x * outward[0] + y * outward[1] + z * outward[2];
            let aside = x * x + y * y + z * z - along * along;
            let seen =
                (x.abs() < REACH) & (y.abs() < REACH) & (z.abs() < REACH) & (aside < ASIDE * ASIDE);
            let value = along + self.radius[lane];
            reach[lane] = if seen { value } else { f32::NEG_INFINITY };
        }
        let mut most = f32::NEG_INFINITY;
        for reach in reach {
            most = if reach > most { reach } else { most };
        }
        most
    }
}

/// Whether particles in these cells of a block may be within a box about the nodes of another.
fn overlaps(cells: &crate::grid::Cells, offset: [i32; 3], first: [f32; 3], last: [f32; 3]) -> bool {
    (0..3).all(|a| {
        let shift = (BLOCK * offset[a]) as f32;
        // Particles of a cell are within half of its node.
        let (low, high) = (cells[a].0 as f32 - 0.5, cells[a].1 as f32 + 0.5);
        low + shift <= last[a] && high + shift >= first[a]
    })
}

/// Half the edge of a cube of this volume [cells].
fn radius_of(volume: f64) -> f64 {
    if volume >= (2.0 * LARGEST_RADIUS).powi(3) {
        return LARGEST_RADIUS;
    }
    // Newton's iteration from above; volumes of interest are some thousandths to 1.
    let mut edge = 1.0;
    for _ in 0..16 {
        edge = (2.0 * edge + volume / (edge * edge)) / 3.0;
    }
    0.5 * edge
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_radius_is_half_the_edge_up_to_half_a_cell() {
        for edge in [0.05, 0.25, 1.0 / 3.0, 0.5, 0.99] {
            let found = radius_of(edge * edge * edge);
            assert!((found - 0.5 * edge).abs() < 1e-12, "{found} for {edge}");
        }
        assert_eq!(radius_of(8.0), 0.5);
    }
}
