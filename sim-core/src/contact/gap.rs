//! How far two surfaces are apart: the outermost particles of both sides along the normal of a node.

use rayon::prelude::*;

use super::sites::{NODES, Node, Site, Sites, coordinates};
use crate::{
    grid::{Grid, NONE, OFFSETS},
    mat3::dot,
    particles::{BLOCK, Particles},
    simd::LANES,
};

/// Farthest that a particle may be from the normal through a node to count as opposite [cells]: a bit more than
/// half the diagonal between nodes, so that every particle at a surface is seen by some node.
const ASIDE: f64 = 0.9;
/// Farthest from a node along the normal, and along any axis: the reach of the splines [cells].
const REACH: f64 = 1.5;
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
            let [(a, n), (b, m)] = [0, 1].map(|side| view.outermost(site, side));
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
    /// How far particles of one side reach beyond each node along its normal, seen from that side [cells], and how
    /// many it looked at.
    fn outermost(&self, site: &Site, side: usize) -> (Vec<f64>, u64) {
        let mut looked_at = 0;
        let mut found = vec![f64::NEG_INFINITY; self.nodes.len()];
        let mut slot = [usize::MAX; NODES];
        let (mut first, mut last) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for (n, node) in self.nodes.iter().enumerate() {
            if self.wanted[n] {
                slot[node.at] = n;
                let local = coordinates(node.at);
                for a in 0..3 {
                    first[a] = first[a].min(local[a] as f32 - REACH as f32);
                    last[a] = last[a].max(local[a] as f32 + REACH as f32);
                }
            }
        }
        let sign = if side == 0 { 1.0 } else { -1.0 };
        for (n, &tile) in self.grid.nodes[site.blocks[side]].tiles.iter().enumerate() {
            if tile == NONE || !overlaps(&self.grid.cells[tile as usize], OFFSETS[n], first, last) {
                continue;
            }
            let block = &self.particles.blocks[tile as usize];
            // From the block's centre to the first node of the site.
            let shift = OFFSETS[n].map(|o| (BLOCK * o) as f32 + 1.5);
            looked_at += (block.groups.len() * LANES) as u64;
            for run in &self.particles.runs[block.runs.clone()] {
                let volume = self.cells_per_mass[run.part];
                // Neighbours mostly have the same mass.
                let mut known = (0.0, 0.0);
                for group in run.groups.clone() {
                    let x = &self.particles.groups[group].x;
                    let mass = &self.particles.fixed[group].mass.0;
                    let mut near = [true; LANES];
                    for a in 0..3 {
                        for (lane, near) in near.iter_mut().enumerate() {
                            let x = x[a].0[lane] + shift[a];
                            *near &= (first[a] < x) & (x < last[a]);
                        }
                    }
                    for lane in (0..LANES).filter(|&lane| near[lane]) {
                        if mass[lane] <= 0.0 {
                            continue;
                        }
                        let x: [f32; 3] = std::array::from_fn(|a| x[a].0[lane] + shift[a]);
                        if known.0 != mass[lane] {
                            known = (mass[lane], radius(volume * f64::from(mass[lane])));
                        }
                        self.take(&slot, x.map(f64::from), sign, known.1, &mut found);
                    }
                }
            }
        }
        (found, looked_at)
    }

    /// Takes in one particle at `x` relative to the first node of the block.
    fn take(&self, slot: &[usize; NODES], x: [f64; 3], sign: f64, radius: f64, found: &mut [f64]) {
        let low = x.map(|x| ((x - REACH).ceil().max(0.0)) as usize);
        let high = x.map(|x| ((x + REACH).floor().min(3.0)) as i64);
        for i in low[0] as i64..=high[0] {
            for j in low[1] as i64..=high[1] {
                for k in low[2] as i64..=high[2] {
                    let n = slot[(16 * i + 4 * j + k) as usize];
                    if n == usize::MAX {
                        continue;
                    }
                    let way = [x[0] - i as f64, x[1] - j as f64, x[2] - k as f64];
                    let along = dot(way, self.nodes[n].normal);
                    if dot(way, way) - along * along < ASIDE * ASIDE {
                        found[n] = found[n].max(sign * along + radius);
                    }
                }
            }
        }
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
fn radius(volume: f64) -> f64 {
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
            let found = radius(edge * edge * edge);
            assert!((found - 0.5 * edge).abs() < 1e-12, "{found} for {edge}");
        }
        assert_eq!(radius(8.0), 0.5);
    }
}
