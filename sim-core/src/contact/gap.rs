//! How far two surfaces are apart: the outermost particles of both sides along the normal of a node.

use rayon::prelude::*;

use super::sites::{ContactBlock, ContactBlocks, Node, coordinates};
use crate::{
    grid::{Grid, NONE, OFFSETS},
    num::cube_root,
    particles::{BLOCK, Block, Particles},
    simd::{F32x16, Isa, LANES, Lanes, on_isa},
};

/// Farthest that a particle may be from the normal through a node to count as opposite [cells]: a bit more than
/// half the diagonal between nodes, so that every particle at a surface is seen by some node.
const ASIDE: f32 = 0.9;
/// Farthest from a node along the normal, and along any axis: the reach of the splines [cells].
const REACH: f32 = 1.5;
/// Particles are taken for balls of their volume at rest, but none larger than this [cells].
pub(crate) const LARGEST_RADIUS: f64 = 0.5;

/// Measures the gaps of the nodes for which `wanted` says so; returns how many particles it looked at.
pub(super) fn measure_gaps(
    sites: &mut ContactBlocks,
    wanted: &[bool],
    particles: &Particles,
    grid: &Grid,
    cells_per_mass: &[f64],
    isa: Isa,
) -> u64 {
    let ContactBlocks { sites, nodes } = sites;
    let seen = CandidateGroups::new(sites, wanted, particles, grid, cells_per_mass);
    let found: Vec<(Vec<f64>, u64)> = sites
        .par_iter()
        .map(|site| {
            let nodes = &nodes[site.range()];
            let wanted = &wanted[site.range()];
            if !wanted.contains(&true) {
                return (vec![], 0);
            }
            let view = View {
                seen: &seen,
                grid,
                nodes,
                wanted,
            };
            let [(a, n), (b, m)] = [0, 1].map(|side| view.outermost(isa, site, side));
            (a.iter().zip(&b).map(|(a, b)| -(a + b)).collect(), n + m)
        })
        .collect();
    let mut particles = seen.particles();
    for (site, (gaps, looked_at)) in sites.iter().zip(found) {
        particles += looked_at;
        for (node, gap) in nodes[site.range()].iter_mut().zip(gaps) {
            node.gap = gap;
        }
    }
    particles
}

/// Particles of all blocks that some node looks at: what does not depend on the node, found once for all.
struct CandidateGroups {
    /// Per particle block where it is in `blocks`, or [`NONE`].
    place: Vec<u32>,
    blocks: Vec<Vec<ParticleGroup>>,
}

impl CandidateGroups {
    fn new(
        sites: &[ContactBlock],
        wanted: &[bool],
        particles: &Particles,
        grid: &Grid,
        cells_per_mass: &[f64],
    ) -> Self {
        let mut place = vec![NONE; particles.blocks.len()];
        let mut concerned = vec![];
        for site in sites.iter().filter(|s| wanted[s.range()].contains(&true)) {
            let tiles = site.blocks.iter().flat_map(|&n| grid.nodes[n].tiles);
            for tile in tiles.filter(|&tile| tile != NONE) {
                let place = &mut place[tile as usize];
                if *place == NONE {
                    *place = concerned.len() as u32;
                    concerned.push(tile as usize);
                }
            }
        }
        let of = |&block: &usize| near(particles, &particles.blocks[block], cells_per_mass);
        let blocks = concerned.par_iter().map(of).collect();
        Self { place, blocks }
    }

    /// How many lanes.
    fn particles(&self) -> u64 {
        let groups: usize = self.blocks.iter().map(Vec::len).sum();
        (groups * LANES) as u64
    }

    fn block(&self, tile: u32) -> &[ParticleGroup] {
        &self.blocks[self.place[tile as usize] as usize]
    }
}

/// The groups of a block.
fn near(particles: &Particles, block: &Block, cells_per_mass: &[f64]) -> Vec<ParticleGroup> {
    let mut found = Vec::with_capacity(block.groups.len());
    for run in &particles.runs[block.runs.clone()] {
        let mut radii = Radii::new(cells_per_mass[run.part]);
        for group in run.groups.clone() {
            let mut radius = F32x16::splat(f32::NEG_INFINITY);
            let mass = &particles.fixed[group].mass.0;
            for (radius, &mass) in radius.0.iter_mut().zip(mass) {
                if mass > 0.0 {
                    *radius = radii.of(mass) as f32;
                }
            }
            found.push(ParticleGroup::new(&particles.groups[group].x, radius));
        }
    }
    found
}

struct View<'a> {
    seen: &'a CandidateGroups,
    grid: &'a Grid,
    nodes: &'a [Node],
    wanted: &'a [bool],
}

impl View<'_> {
    /// How far particles of one side reach beyond each node along its normal, seen from that side [cells], and how
    /// many it looked at.
    fn outermost(&self, isa: Isa, site: &ContactBlock, side: usize) -> (Vec<f64>, u64) {
        let sign = if side == 0 { 1.0 } else { -1.0 };
        let wanted = self.nodes.iter().zip(self.wanted);
        let wanted = wanted.enumerate().filter(|(_, (_, wanted))| **wanted);
        let mut probes: Vec<Probe> = wanted
            .map(|(node, (at, _))| Probe {
                node,
                at: coordinates(at.at).map(|c| c as f32),
                outward: at.normal.map(|c| (sign * c) as f32),
                reach: F32x16::splat(f32::NEG_INFINITY),
            })
            .collect();
        let (mut first, mut last) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for probe in &probes {
            for a in 0..3 {
                first[a] = first[a].min(probe.at[a] - REACH);
                last[a] = last[a].max(probe.at[a] + REACH);
            }
        }
        let mut looked_at = 0;
        for (n, &tile) in self.grid.nodes[site.blocks[side]].tiles.iter().enumerate() {
            if tile == NONE || !overlaps(&self.grid.cells[tile as usize], OFFSETS[n], first, last) {
                continue;
            }
            // From the block's centre to the first node of the site.
            let shift = OFFSETS[n].map(|o| (BLOCK * o) as f32 + 1.5);
            for near in self.seen.block(tile) {
                let bounds = near.bounds(shift);
                if overlap(&bounds, first, last) {
                    looked_at += LANES as u64;
                    look(isa, near, shift, &bounds, &mut probes);
                }
            }
        }
        let mut found = vec![f64::NEG_INFINITY; self.nodes.len()];
        for probe in &probes {
            let larger = |a: f32, b: f32| if b > a { b } else { a };
            let reach = probe.reach.0.into_iter().fold(f32::NEG_INFINITY, larger);
            found[probe.node] = f64::from(reach);
        }
        (found, looked_at)
    }
}

/// A node that looks for particles.
struct Probe {
    /// Which of the site's.
    node: usize,
    /// Where it is, relative to the first node of its block [cells].
    at: [f32; 3],
    /// Its normal, away from the side that is searched.
    outward: [f32; 3],
    /// How far particles reach beyond it, lane by lane.
    reach: F32x16,
}

on_isa! {
    /// Takes note of how far sixteen particles reach beyond nodes.
    fn look = look_on(near: &ParticleGroup, shift: [f32; 3], bounds: &[[f32; 3]; 2], probes: &mut [Probe])
}

#[inline(always)]
fn look_on<V: Lanes>(
    near: &ParticleGroup,
    shift: [f32; 3],
    bounds: &[[f32; 3]; 2],
    probes: &mut [Probe],
) {
    let x = V::load(&near.x[0]) + V::broadcast(shift[0]);
    let y = V::load(&near.x[1]) + V::broadcast(shift[1]);
    let z = V::load(&near.x[2]) + V::broadcast(shift[2]);
    let radius = V::load(&near.radius);
    let (limit, aside_limit) = (V::broadcast(REACH), V::broadcast(ASIDE * ASIDE));
    for probe in probes {
        let [i, j, k] = probe.at;
        let low = [i - REACH, j - REACH, k - REACH];
        let high = [i + REACH, j + REACH, k + REACH];
        if !overlap(bounds, low, high) {
            continue;
        }
        let [u, v, w] = probe.outward;
        let (dx, dy, dz) = (
            x - V::broadcast(i),
            y - V::broadcast(j),
            z - V::broadcast(k),
        );
        let along = dx * V::broadcast(u) + dy * V::broadcast(v) + dz * V::broadcast(w);
        let aside = dx * dx + dy * dy + dz * dz - along * along;
        let before = V::load(&probe.reach);
        let value = along + radius;
        let seen = dx.abs().lt(limit) & dy.abs().lt(limit) & dz.abs().lt(limit);
        let farther = seen & aside.lt(aside_limit) & before.lt(value);
        V::select(farther, value, before).store(&mut probe.reach);
    }
}

/// Sixteen particles relative to the centre of their block [cells].
struct ParticleGroup {
    x: [F32x16; 3],
    /// Infinitely negative in unused lanes.
    radius: F32x16,
    /// Box that holds them; empty where there are none.
    bounds: [[f32; 3]; 2],
}

impl ParticleGroup {
    fn new(x: &[F32x16; 3], radius: F32x16) -> Self {
        let mut bounds = [[0.0; 3]; 2];
        for a in 0..3 {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for (&x, &radius) in x[a].0.iter().zip(&radius.0) {
                let used = radius > f32::NEG_INFINITY;
                low = if used & (x < low) { x } else { low };
                high = if used & (x > high) { x } else { high };
            }
            (bounds[0][a], bounds[1][a]) = (low, high);
        }
        let x = *x;
        Self { x, radius, bounds }
    }

    /// The box from elsewhere: rounding keeps the order of numbers, so it holds what is moved with it.
    #[inline(always)]
    fn bounds(&self, shift: [f32; 3]) -> [[f32; 3]; 2] {
        let mut bounds = self.bounds;
        for a in 0..3 {
            bounds[0][a] += shift[a];
            bounds[1][a] += shift[a];
        }
        bounds
    }
}

/// Whether two boxes have points in common.
#[inline(always)]
fn overlap([low, high]: &[[f32; 3]; 2], min: [f32; 3], max: [f32; 3]) -> bool {
    let mut overlap = true;
    for a in 0..3 {
        overlap &= (low[a] < max[a]) & (high[a] > min[a]);
    }
    overlap
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

/// Radii of the particles of a part [cells].
pub(crate) struct Radii {
    /// Of one unit of mass at rest [cells].
    volume: f64,
    /// The last mass that was asked for, and its radius: neighbours mostly have the same.
    known: (f32, f64),
}

impl Radii {
    /// Of a part of which one unit of mass has this volume at rest [cells].
    pub fn new(volume: f64) -> Self {
        Self {
            volume,
            known: (0.0, 0.0),
        }
    }

    /// That of a particle with a mass above 0.
    #[inline]
    pub fn of(&mut self, mass: f32) -> f64 {
        if self.known.0 != mass {
            self.known = (mass, radius_of(self.volume * f64::from(mass)));
        }
        self.known.1
    }
}

/// Half the edge of a cube of this volume [cells].
fn radius_of(volume: f64) -> f64 {
    if volume >= (2.0 * LARGEST_RADIUS).powi(3) {
        return LARGEST_RADIUS;
    }
    0.5 * cube_root(volume)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        colliders::{Boundaries, Paths},
        grid::FieldPass,
        mat3::{dot, unit},
        particles::NO_PARTICLE,
        step::sort::{Newcomer, place},
        test_scenes::{empty, random},
    };

    /// Two clouds that overlap, with some particles far out of their blocks, and the grid around them.
    fn clouds(seed: &mut u64) -> (Particles, Grid) {
        let newcomers: Vec<Newcomer> = (0..400)
            .map(|id| Newcomer {
                id,
                part: id % 2,
                x: std::array::from_fn(|a| {
                    6.0 * random(seed) + if a == 0 { f64::from(id % 2) } else { 0.0 }
                }),
                v: [0.0; 3],
                c: [0.0; 9],
                mass: (0.6 + 0.4 * random(seed)) as f32,
            })
            .collect();
        let mut particles = place(&newcomers, &[0, 1]);
        let drift = [0, 1, 2].map(|_| (0.9 * random(seed)) as f32);
        for (group, fixed) in particles.groups.iter_mut().zip(&particles.fixed) {
            for (x, drift) in group.x.iter_mut().zip(drift) {
                for lane in (0..LANES).filter(|&lane| fixed.id[lane] != NO_PARTICLE) {
                    x.0[lane] += drift;
                }
            }
        }
        let boundaries = Boundaries::new(&empty(1.0), 1.0);
        let mut grid = Grid::default();
        grid.rebuild(
            &particles.blocks,
            &boundaries.fixed_on_nodes(&Paths::default()),
        );
        for (block, cells) in particles.blocks.iter().zip(&mut grid.cells) {
            for g in block.groups.clone() {
                for lane in (0..LANES).filter(|&lane| particles.fixed[g].id[lane] != NO_PARTICLE) {
                    for (a, range) in cells.iter_mut().enumerate() {
                        let cell = (particles.groups[g].x[a].0[lane] + 1.5).round() as i32;
                        *range = match range.0 > 4 {
                            true => (cell, cell),
                            false => (range.0.min(cell), range.1.max(cell)),
                        };
                    }
                }
            }
        }
        (particles, grid)
    }

    /// Sites wherever the fields share node blocks, with random nodes and normals.
    fn sites(grid: &Grid, seed: &mut u64) -> ContactBlocks {
        let mut all = ContactBlocks::default();
        for (shared, here) in grid.shared.iter().enumerate() {
            let nodes: Vec<Node> = (0..64)
                .filter(|_| random(seed) > 0.5)
                .collect::<Vec<usize>>()
                .into_iter()
                .map(|at| Node {
                    at,
                    mass: [1.0; 2],
                    normal: unit(std::array::from_fn(|_| random(seed))),
                    gap: f64::NEG_INFINITY,
                })
                .collect();
            let sharers = &grid.sharers[here.nodes.clone()];
            all.sites.push(ContactBlock {
                shared,
                fields: [0, 1],
                index: here.index,
                blocks: [sharers[0] as usize, sharers[1] as usize],
                mask: nodes.iter().map(|node| 1_u64 << node.at).sum(),
                first: all.nodes.len(),
                passes: [FieldPass::of(1.0); 2],
            });
            all.nodes.extend(nodes);
        }
        all
    }

    /// How far particles of a field reach beyond a place, asked of every one of them; `slack` widens what counts.
    fn reach(
        particles: &Particles,
        field: u32,
        place: [f64; 3],
        outward: [f64; 3],
        slack: f64,
    ) -> f64 {
        let mut most = f64::NEG_INFINITY;
        for block in particles.blocks.iter().filter(|b| b.field == field) {
            for g in block.groups.clone() {
                for lane in (0..LANES).filter(|&lane| particles.fixed[g].id[lane] != NO_PARTICLE) {
                    let d: [f64; 3] = std::array::from_fn(|a| {
                        let centre = f64::from(BLOCK * block.index[a]) + 1.5;
                        centre + f64::from(particles.groups[g].x[a].0[lane]) - place[a]
                    });
                    let along = dot(d, outward);
                    let aside = dot(d, d) - along * along;
                    let near = d.iter().all(|d| d.abs() < f64::from(REACH) + slack);
                    if near && aside < f64::from(ASIDE * ASIDE) + slack {
                        let mass = f64::from(particles.fixed[g].mass.0[lane]);
                        most = most.max(along + radius_of(0.2 * mass));
                    }
                }
            }
        }
        most
    }

    #[test]
    fn gaps_are_those_of_a_search_among_all_particles() {
        let mut seed = 7;
        let (mut measured, mut found) = (0, 0);
        for _ in 0..12 {
            let (particles, grid) = clouds(&mut seed);
            let mut all = sites(&grid, &mut seed);
            let wanted: Vec<bool> = all.nodes.iter().map(|_| random(&mut seed) > 0.0).collect();
            for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
                measure_gaps(&mut all, &wanted, &particles, &grid, &[0.2, 0.2], isa);
                for site in &all.sites {
                    for n in site.range().filter(|&n| wanted[n]) {
                        let node = &all.nodes[n];
                        let at = site.position(node.at);
                        let gap = |slack: f64| {
                            let a = reach(&particles, 0, at, node.normal, slack);
                            -(a + reach(&particles, 1, at, node.normal.map(|n| -n), slack))
                        };
                        // Single precision, some cells from the block's centre; who is just in reach may differ.
                        let (most, least) = (gap(-1e-5) + 1e-5, gap(1e-5) - 1e-5);
                        let within = (least..=most).contains(&node.gap) || node.gap == most;
                        assert!(within, "{isa}: {} in {least}..{most}", node.gap);
                        measured += 1;
                        found += usize::from(node.gap.is_finite());
                    }
                }
            }
        }
        // Most nodes see one side only. Each instruction set adds as many.
        assert!(
            measured > 10_000 && found > 500,
            "{found} of {measured} with both sides"
        );
    }

    #[test]
    fn the_radius_is_half_the_edge_up_to_half_a_cell() {
        for edge in [0.05, 0.25, 1.0 / 3.0, 0.5, 0.99] {
            let found = radius_of(edge * edge * edge);
            assert!((found - 0.5 * edge).abs() < 1e-12, "{found} for {edge}");
        }
        assert_eq!(radius_of(8.0), 0.5);
    }
}
