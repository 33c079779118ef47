//! The constant side of a solid: its grid, the quadrature points in it, and the mass of nodes.

use std::{collections::BTreeMap, ops::Range};

use super::{
    basis::weights_f64,
    cells::{CELLS, FilledCells},
    extension::Extension,
    held::HELD_PART,
    lattice::{Lattice, Seed},
    nodes::{Bears, NODES, place, slot},
    off_diagonal::{OffDiagonalMass, SHARE},
    volumes::{BlockParts, Parts},
};
use crate::simd::F32x16;

/// No block.
pub(crate) const NO_BLOCK: u32 = u32::MAX;
/// Gauss points of a cell: so far from its centre along each axis [cells].
pub(crate) const GAUSS: f64 = 0.288_675_134_594_812_9;
/// Largest deviation of an octant's volume from that of a full one, relative.
const FULL: f64 = 1e-3;
/// How near to the middle a place is amid two corners of a cell [cells].
const AMID: f64 = 1e-6;

/// Matter of one material in a cell: eight quadrature points at the places of Gauss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Which of its block, `16 x + 4 y + z`.
    pub number: u8,
    /// Index of the object's laws; the largest number where matter is held.
    pub part: u16,
    /// Rest volume of each point [cells], the point `4 x + 2 y + z`, lower ones first; 0 where there is no matter.
    pub volumes: [f32; 8],
}

/// Points of 4x4x4 cells. Cell `c` has, along each axis, the nodes `c`, `c + 1` and `c + 2`, the middle one at its centre.
#[derive(Clone, Debug, PartialEq)]
pub struct PointBlock {
    /// Node blocks at and behind it along each axis, `4 x + 2 y + z`.
    pub nodes: [u32; 8],
    /// Its cells.
    pub cells: Range<usize>,
}

/// Cells of every block, each with its density [kg/m^3].
type Blocks = BTreeMap<[i32; 3], Vec<(Cell, f64)>>;

/// A solid's grid.
#[derive(Clone, Debug)]
pub struct SolidModel {
    /// Cell size [m].
    pub dx: f64,
    /// The lattice of its matter, whose axes are those of the grid.
    pub lattice: Lattice,
    /// Rest position of the node (0, 0, 0) along them [m].
    origin: [f64; 3],
    /// Place of every block of nodes, in lexicographic order.
    pub node_blocks: Vec<[i32; 3]>,
    /// Per block of nodes the blocks of points before and at it, in the order of x, y, z; `NO_BLOCK` where there is none.
    pub point_blocks_of: Vec<[u32; 8]>,
    /// Blocks of points, in lexicographic order.
    pub point_blocks: Vec<PointBlock>,
    /// Cells with matter, block after block.
    pub cells: Vec<Cell>,
    /// Mass of every node [kg], by its number; 0 of one that follows others.
    pub mass: Vec<f64>,
    /// Cell size over the mass of the matter about every node [m/kg], be it inner or outer; 0 where there is none.
    pub spread: Vec<[F32x16; 4]>,
    /// Nodes that follow others.
    pub extension: Extension,
    /// Mass between nodes.
    pub off_diagonal: OffDiagonalMass,
    /// Mass of the solid [kg].
    pub total_mass: f64,
    /// Where there are cells with matter.
    filled: FilledCells,
    /// Volumes of the points as the kernel reads them.
    pub parts: Parts,
}

/// A place in a cell with matter, or beyond it: fields go on there as they are in the cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellPoint {
    /// Index of the block of points.
    pub block: u32,
    /// Which cell of it, `16 x + 4 y + z`.
    pub number: u8,
    /// Place from the centre of the cell [cells].
    pub d: [f64; 3],
}

impl SolidModel {
    /// The grid of some matter, at least one piece of it, with cells of `dx` [m].
    pub fn new(dx: f64, seeds: &[Seed]) -> Self {
        let lattice = Lattice::of(dx, seeds);
        let pieces = lattice.seeds(seeds);
        Self::of_pieces(dx, lattice, &pieces)
    }

    /// The grid of pieces of matter along the axes of a lattice.
    pub(super) fn of_pieces(dx: f64, lattice: Lattice, seeds: &[Seed]) -> Self {
        let face = first_cell(dx, &lattice, seeds);
        let mut matter: BTreeMap<([i32; 3], u16), Matter> = BTreeMap::new();
        for seed in seeds {
            let cell = cell_of(dx, face, seed);
            let at = |a: usize| (seed.position[a] - face[a]) / dx;
            let d = std::array::from_fn(|a| at(a) - f64::from(cell[a]) - 0.5);
            let here = matter.entry((cell, seed.part)).or_default();
            here.add(seed.volume / dx.powi(3), seed.density, d);
        }
        let mut blocks: Blocks = BTreeMap::new();
        for ((cell, part), matter) in matter {
            let [x, y, z] = cell.map(|c| c.rem_euclid(CELLS) as u8);
            let cells = blocks.entry(cell.map(|c| c.div_euclid(CELLS))).or_default();
            let volumes = matter.fitted();
            // What is taken for full is so but for rounding; its mass stays.
            let volume: f64 = volumes.iter().map(|&v| f64::from(v)).sum();
            let cell = Cell {
                number: 16 * x + 4 * y + z,
                part,
                volumes,
            };
            cells.push((cell, matter.mass / volume));
        }
        Self::of_blocks(dx, lattice, face, blocks)
    }

    fn of_blocks(dx: f64, lattice: Lattice, face: [f64; 3], blocks: Blocks) -> Self {
        let around = |b: &[i32; 3], sign: i32| -> [[i32; 3]; 8] {
            std::array::from_fn(|n| {
                let o = [n / 4, n / 2 % 2, n % 2].map(|o| sign * o as i32);
                std::array::from_fn(|a| b[a] + o[a])
            })
        };
        let mut node_blocks: Vec<[i32; 3]> = blocks.keys().flat_map(|b| around(b, 1)).collect();
        node_blocks.sort_unstable();
        node_blocks.dedup();
        let find = |list: &[[i32; 3]], b: &[i32; 3]| {
            list.binary_search(b).map_or(NO_BLOCK, |found| found as u32)
        };
        let at: Vec<[i32; 3]> = blocks.keys().copied().collect();
        let point_blocks_of = node_blocks.iter();
        let point_blocks_of = point_blocks_of
            .map(|b| {
                let mut before = around(b, -1);
                before.reverse();
                before.map(|b| find(&at, &b))
            })
            .collect();
        let mut model = Self {
            dx,
            origin: face.map(|x| x - 0.5 * dx),
            lattice,
            mass: vec![0.0; NODES * node_blocks.len()],
            spread: vec![[F32x16::ZERO; 4]; node_blocks.len()],
            extension: Extension::default(),
            off_diagonal: OffDiagonalMass::default(),
            point_blocks_of,
            point_blocks: vec![],
            cells: vec![],
            total_mass: 0.0,
            filled: filled_cells(&blocks),
            parts: Parts::default(),
            node_blocks,
        };
        let mut filled = vec![0.0; model.mass.len()];
        let mut along: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; model.mass.len()]);
        for (block, mut cells) in blocks {
            let nodes = around(&block, 1).map(|b| find(&model.node_blocks, &b));
            let start = model.cells.len();
            cells.sort_by_key(|(cell, _)| (cell.number, cell.part));
            for (cell, density) in cells {
                model.add_matter(&nodes, &cell, density, (&mut filled, &mut along));
                model.cells.push(cell);
            }
            model.point_blocks.push(PointBlock {
                nodes,
                cells: start..model.cells.len(),
            });
        }
        model.total_mass = model.mass.iter().sum();
        for (slot, &mass) in model.mass.iter().enumerate() {
            let w = if mass > 0.0 { dx / mass } else { 0.0 };
            model.spread[slot / NODES][slot / 16 % 4].0[slot % 16] = w as f32;
        }
        model.extension = Extension::new(&model.node_blocks, &mut model.mass, &filled);
        let nodes = (&model.mass[..], &filled[..]);
        model.off_diagonal = OffDiagonalMass::new(&model.node_blocks, &along, nodes, dx);
        model.parts = Parts::new(&model.parts_of_blocks());
        model
    }

    /// Per block of points its parts, with the cells of each.
    fn parts_of_blocks(&self) -> Vec<BlockParts> {
        let blocks = self.point_blocks.iter();
        let parts = blocks.map(|block| {
            let mut parts = BlockParts::new();
            let cells = self.cells[block.cells.clone()].iter();
            for cell in cells.filter(|cell| cell.part != HELD_PART) {
                let part = parts.entry(cell.part).or_default();
                part.push((cell.number, cell.volumes));
            }
            parts
        });
        parts.collect()
    }

    /// Spreads the mass of a cell, and its volume [cells], over the nodes, and its mass between each and that two cells behind it `along` each axis.
    fn add_matter(
        &mut self,
        nodes: &[u32; 8],
        cell: &Cell,
        density: f64,
        (filled, along): (&mut [f64], &mut [Vec<f64>; 3]),
    ) {
        for (n, volume) in cell.volumes.into_iter().enumerate() {
            let volume = f64::from(volume);
            let mass = volume * density * self.dx.powi(3);
            let d = gauss_point(n);
            let weights = d.map(|d| weights_f64(d).0);
            for (at, (slot, weight)) in stencil(nodes, cell.number, d).into_iter().enumerate() {
                self.mass[slot] += weight * mass;
                filled[slot] += weight * volume;
                let place = [at / 9, at / 3 % 3, at % 3];
                for (axis, along) in along.iter_mut().enumerate().filter(|a| place[a.0] == 0) {
                    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                    let across = weights[b][place[b]] * weights[c][place[c]];
                    along[slot] += SHARE * mass * across;
                }
            }
        }
    }

    /// Volume of the solid [m^3].
    pub fn volume(&self) -> f64 {
        let cells = self.cells.iter().flat_map(|cell| cell.volumes);
        cells.map(f64::from).sum::<f64>() * self.dx.powi(3)
    }

    /// Rest position of a node by its number [cells], from the node (0, 0, 0).
    pub fn node_position(&self, slot: usize) -> [f64; 3] {
        let block = self.node_blocks[slot / NODES];
        let (x, lane) = (slot / 16 % 4, slot % 16);
        let local = [x, lane % 4, lane / 4];
        std::array::from_fn(|a| f64::from(CELLS * block[a]) + local[a] as f64)
    }

    /// Rest position of a node by its number [m].
    pub fn node_in_world(&self, slot: usize) -> [f64; 3] {
        self.world_of(self.node_position(slot))
    }

    /// Rest position of a place along the axes of the grid [cells] from the node (0, 0, 0) [m].
    #[inline(always)]
    pub fn world_of(&self, at: [f64; 3]) -> [f64; 3] {
        let mut x = self.origin;
        for a in 0..3 {
            x[a] += self.dx * at[a];
        }
        self.lattice.world(x)
    }

    /// Rest position of a site [m].
    #[inline(always)]
    pub fn place_of(&self, site: &CellPoint) -> [f64; 3] {
        let blocks = &self.point_blocks[site.block as usize].nodes;
        let (block, cell) = (
            &self.node_blocks[blocks[0] as usize],
            cell_of_number(site.number),
        );
        self.world_of(std::array::from_fn(|a| {
            f64::from(CELLS * block[a]) + cell[a] as f64 + 1.0 + site.d[a]
        }))
    }

    /// Nodes with matter about them, inner and outer ones, by their numbers.
    pub fn nodes(&self) -> impl Iterator<Item = usize> + '_ {
        let has_matter = |&n: &usize| self.spread[n / NODES][n / 16 % 4].0[n % 16] > 0.0;
        (0..self.mass.len()).filter(has_matter)
    }

    /// A rest position [m] along the axes of the grid [cells], from the node (0, 0, 0).
    pub fn in_cells(&self, x: [f64; 3]) -> [f64; 3] {
        let x = self.lattice.place(x);
        std::array::from_fn(|a| (x[a] - self.origin[a]) / self.dx)
    }

    /// A rest position [m] in cells, and the cell that it is in.
    #[inline(always)]
    fn cell_of(&self, x: [f64; 3]) -> ([f64; 3], [i32; 3]) {
        let x = self.lattice.place(x);
        let at: [f64; 3] = std::array::from_fn(|a| (x[a] - self.origin[a]) / self.dx - 0.5);
        let mut cell = [0; 3];
        for a in 0..3 {
            // The next lower integer; a call of the library on processors without an instruction for it.
            let whole = at[a] as i32;
            cell[a] = whole.saturating_sub(i32::from(f64::from(whole) > at[a]));
        }
        (at, cell)
    }

    /// Corners of cells that a rest position [m] is nearest to, or amid: one or two along each axis.
    pub(super) fn corners_about(&self, x: [f64; 3]) -> Vec<[i32; 3]> {
        let at = self.cell_of(x).0;
        let sides = at.map(|x| [x - AMID, x + AMID].map(|x| x.round() as i32));
        let mut corners: Vec<[i32; 3]> = (0..8)
            .map(|n| std::array::from_fn(|a| sides[a][n >> a & 1]))
            .collect();
        corners.sort_unstable();
        corners.dedup();
        corners
    }

    /// The site of a place [cells] in a cell; none where that has no matter.
    #[inline(always)]
    fn site_in(&self, at: [f64; 3], cell: [i32; 3]) -> Option<CellPoint> {
        let (block, number) = self.filled.find(cell)?;
        let mut d = at;
        for a in 0..3 {
            d[a] -= f64::from(cell[a]) + 0.5;
        }
        Some(CellPoint { block, number, d })
    }

    /// The site of a rest position [m], in the cell of `owner` [m]; none where that has no matter.
    pub fn site(&self, x: [f64; 3], owner: [f64; 3]) -> Option<CellPoint> {
        self.site_in(self.cell_of(x).0, self.cell_of(owner).1)
    }

    /// The site of a rest position [m] in its cell, or in the nearest cell with matter beside it.
    #[inline(always)]
    pub fn site_near(&self, x: [f64; 3]) -> Option<CellPoint> {
        let (at, cell) = self.cell_of(x);
        let (block, number, cell) = self.filled.nearest(at, cell)?;
        let mut d = at;
        for a in 0..3 {
            d[a] -= f64::from(cell[a]) + 0.5;
        }
        Some(CellPoint { block, number, d })
    }

    /// Nodes that bear a force at a site.
    pub fn bears(&self, site: &CellPoint) -> Bears {
        self.stencil_at(site)
            .map(|(slot, w)| (slot as u32, w as f32))
    }

    /// Inner nodes that bear a force at a site, each once. `shares` is per node NaN, and is so again.
    pub fn borne_by(&self, bears: &Bears, shares: &mut [f32]) -> Vec<(u32, f32)> {
        let mut all: Vec<(u32, f32)> = Vec::with_capacity(2 * bears.len());
        for &(slot, w) in bears {
            for (inner, e) in self.extension.borne_by(slot) {
                let share = &mut shares[inner as usize];
                if share.is_nan() {
                    *share = w * e;
                    all.push((inner, 0.0));
                } else {
                    *share += w * e;
                }
            }
        }
        for (slot, share) in &mut all {
            *share = std::mem::replace(&mut shares[*slot as usize], f32::NAN);
        }
        // Nodes without mass bear nothing.
        all.retain(|&(slot, _)| self.mass[slot as usize] > 0.0);
        all
    }

    /// Nodes about a site with weights.
    pub fn stencil_at(&self, site: &CellPoint) -> [(usize, f64); 27] {
        let nodes = &self.point_blocks[site.block as usize].nodes;
        stencil(nodes, site.number, site.d)
    }
}

/// The cells of some blocks.
fn filled_cells(blocks: &Blocks) -> FilledCells {
    let filled = blocks.values().map(|cells| {
        let bits = cells.iter().map(|(cell, _)| 1_u64 << cell.number);
        bits.fold(0, |all, bit| all | bit)
    });
    let places: Vec<[i32; 3]> = blocks.keys().copied().collect();
    FilledCells::new(&places, &filled.collect::<Vec<u64>>())
}

/// Number of each of the 27 nodes of a cell of a block, and its weight at a place from the centre of the cell [cells].
pub fn stencil(nodes: &[u32; 8], number: u8, d: [f64; 3]) -> [(usize, f64); 27] {
    let cell = cell_of_number(number);
    let axes = d.map(|d| weights_f64(d).0);
    std::array::from_fn(|n| {
        let o = [n / 9, n / 3 % 3, n % 3];
        let at: [usize; 3] = std::array::from_fn(|a| cell[a] + o[a]);
        let block = nodes[4 * (at[0] / 4) + 2 * (at[1] / 4) + at[2] / 4] as usize;
        let weight = axes[0][o[0]] * axes[1][o[1]] * axes[2][o[2]];
        (slot(block, place(at[0] % 4, at[1] % 4, at[2] % 4)), weight)
    })
}

/// Place of a cell in its block.
#[inline(always)]
pub(crate) fn cell_of_number(number: u8) -> [usize; 3] {
    let c = usize::from(number);
    [c / 16, c / 4 % 4, c % 4]
}

/// Place of a Gauss point from the centre of its cell [cells].
pub fn gauss_point(n: usize) -> [f64; 3] {
    [n / 4, n / 2 % 2, n % 2].map(|o| GAUSS * (2.0 * o as f64 - 1.0))
}

/// The lower corner of the first cell [m], all along the axes of the lattice: its faces are faces of cells, of which there are as few
/// along each axis as that allows, so that there are few blocks.
fn first_cell(dx: f64, lattice: &Lattice, seeds: &[Seed]) -> [f64; 3] {
    let &Lattice {
        edge, corner: face, ..
    } = lattice;
    let pieces = (dx / edge).round().max(1.0) as u32;
    std::array::from_fn(|a| {
        let places = || seeds.iter().map(|seed| seed.position[a]);
        let least = places().fold(f64::INFINITY, f64::min);
        let most = places().fold(f64::NEG_INFINITY, f64::max);
        let cells = |n: u32| {
            let start = face[a] - f64::from(n) * edge;
            [least, most].map(|x| ((x - start) / dx).floor())
        };
        let count = |&n: &u32| {
            let [first, last] = cells(n);
            (last - first) as u64
        };
        // Of equal ones the first: faces are where they were.
        let best = (0..pieces).min_by_key(count).unwrap_or(0);
        face[a] - f64::from(best) * edge + cells(best)[0] * dx
    })
}

/// The cell of a piece whose place is along the axes of a lattice [m], where the first has its lower corner at `face` [m].
fn cell_of(dx: f64, face: [f64; 3], seed: &Seed) -> [i32; 3] {
    std::array::from_fn(|a| ((seed.position[a] - face[a]) / dx).floor() as i32)
}

/// How many cells a grid of pieces along the axes of a lattice has.
pub(super) fn count_cells(dx: f64, lattice: &Lattice, seeds: &[Seed]) -> usize {
    let face = first_cell(dx, lattice, seeds);
    let cells = seeds.iter();
    let mut cells: Vec<_> = cells
        .map(|seed| (cell_of(dx, face, seed), seed.part))
        .collect();
    cells.sort_unstable();
    cells.dedup();
    cells.len()
}

/// Matter of one material in a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Matter {
    /// Volume of every octant [cells].
    octants: [f64; 8],
    /// First moment of volume about the centre [cells^4].
    moment: [f64; 3],
    /// Volume times density [cells kg/m^3].
    mass: f64,
}

impl Matter {
    fn add(&mut self, volume: f64, density: f64, d: [f64; 3]) {
        let [x, y, z] = d.map(|d| usize::from(d > 0.0));
        self.octants[4 * x + 2 * y + z] += volume;
        for a in 0..3 {
            self.moment[a] += volume * d[a];
        }
        self.mass += volume * density;
    }

    /// Volumes of the Gauss points, none negative, with the matter's volume, and with its centroid as far as that allows.
    fn fitted(&self) -> [f32; 8] {
        if self.octants.iter().all(|v| (8.0 * v - 1.0).abs() < FULL) {
            return [0.125; 8];
        }
        let side = |n: usize, a: usize| gauss_point(n)[a].signum();
        let slope: [f64; 3] = std::array::from_fn(|a| {
            let has: f64 = (0..8).map(|n| self.octants[n] * side(n, a)).sum();
            (self.moment[a] / GAUSS - has) / 8.0
        });
        let change: [f64; 8] = std::array::from_fn(|n| (0..3).map(|a| slope[a] * side(n, a)).sum());
        let mut share = 1.0_f64;
        for n in 0..8 {
            if self.octants[n] + change[n] < 0.0 {
                share = share.min(self.octants[n] / -change[n]);
            }
        }
        std::array::from_fn(|n| (self.octants[n] + share * change[n]).max(0.0) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{ball, lattice};

    #[test]
    fn a_small_ball_is_one_block_wherever_it_is() {
        // Eight pieces across, the outermost ones cut: four cells.
        for center in [[0.0; 3], [0.31, -0.17, 0.005]] {
            let model = SolidModel::new(0.03, &ball(0.03, center, 0.055));
            assert_eq!(model.point_blocks.len(), 1);
        }
    }

    #[test]
    fn faces_of_a_box_are_faces_of_cells() {
        let model = SolidModel::new(0.1, &lattice(0.1, [0.35, 0.0, -0.2], [4, 3, 2], |_| true));
        assert_eq!(model.cells.len(), 24);
        assert_eq!(model.point_blocks.len(), 1);
        assert!(model.cells.iter().all(|cell| cell.volumes == [0.125; 8]));
    }
}
