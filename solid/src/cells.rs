//! Which cells of a solid have matter, and which beside them: asked for every place that contact looks at.

use std::collections::BTreeMap;

/// Cells along one edge of a block.
pub const CELLS: i32 = 4;

/// Entries of the table per block at most; a solid that is sparser in its box is searched.
const DENSE: usize = 512;

/// Place of a cell.
type Cell = [i32; 3];

/// The cells of a block: one bit per cell that has matter, `16 x + 4 y + z`, and per cell one bit for each of the 27 in and beside it
/// that has, `9 x + 3 y + z`.
pub type Filled = (u64, [u32; 64]);

/// The cells with matter, found by their places.
#[derive(Clone, Debug, Default)]
pub(crate) struct FilledCells {
    /// Blocks of points, then those beside them.
    blocks: Vec<Filled>,
    /// Smallest place of all, and how many there are along each axis.
    first: Cell,
    size: [usize; 3],
    /// Number of the block at every place of the box plus one, z fastest; empty for a sparse solid.
    table: Vec<u32>,
    /// The same of a sparse solid.
    sparse: BTreeMap<Cell, u32>,
}

/// Block of a cell, and which cell of it.
#[inline(always)]
fn split(cell: Cell) -> (Cell, usize) {
    let [x, y, z] = cell.map(|c| c.rem_euclid(CELLS) as usize);
    (cell.map(|c| c.div_euclid(CELLS)), 16 * x + 4 * y + z)
}

/// The 27 places in and beside one, z fastest.
fn beside(at: Cell) -> impl Iterator<Item = Cell> {
    (0..27).map(move |n| {
        let o = [n / 9, n / 3 % 3, n % 3];
        std::array::from_fn(|a| at[a].saturating_add(o[a] - 1))
    })
}

impl FilledCells {
    /// Of blocks of points in lexicographic order with the cells that they have.
    pub fn new(points: &[Cell], filled: &[u64]) -> Self {
        let mut numbers: BTreeMap<Cell, u32> = (0..).zip(points).map(|(n, &at)| (at, n)).collect();
        for at in points.iter().flat_map(|&at| beside(at)) {
            let next = numbers.len() as u32;
            numbers.entry(at).or_insert(next);
        }
        let mut blocks: Vec<Filled> = vec![(0, [0; 64]); numbers.len()];
        for (n, (at, &bits)) in points.iter().zip(filled).enumerate() {
            blocks[n].0 = bits;
            for number in (0..64).filter(|number| bits >> number & 1 == 1) {
                let o = [number / 16, number / 4 % 4, number % 4];
                let cell = std::array::from_fn(|a| CELLS * at[a] + o[a]);
                // What is beside it has it on the opposite side.
                for (n, next) in beside(cell).enumerate() {
                    let (block, number) = split(next);
                    if let Some(&block) = numbers.get(&block) {
                        blocks[block as usize].1[number] |= 1 << (26 - n);
                    }
                }
            }
        }
        let bound = |a: usize, pick: fn(i32, i32) -> i32, none: i32| {
            numbers.keys().map(|block| block[a]).fold(none, pick)
        };
        let first: Cell = std::array::from_fn(|a| bound(a, i32::min, i32::MAX));
        let last: Cell = std::array::from_fn(|a| bound(a, i32::max, i32::MIN));
        let size: [usize; 3] = std::array::from_fn(|a| {
            usize::try_from(last[a].saturating_sub(first[a])).unwrap_or(0) + 1
        });
        let volume = size.iter().try_fold(1_usize, |n, &s| n.checked_mul(s));
        let mut new = Self {
            table: match volume {
                Some(volume) if volume <= DENSE * blocks.len() => vec![0; volume],
                _ => vec![],
            },
            blocks,
            first,
            size,
            sparse: BTreeMap::new(),
        };
        if new.table.is_empty() {
            new.sparse = numbers;
            return new;
        }
        for (at, number) in numbers {
            if let Some(place) = new.place(at) {
                new.table[place] = number + 1;
            }
        }
        new
    }

    /// Place of a block in the table.
    #[inline(always)]
    fn place(&self, block: Cell) -> Option<usize> {
        let at: [usize; 3] =
            std::array::from_fn(|a| block[a].wrapping_sub(self.first[a]) as u32 as usize);
        let inside = (0..3).all(|a| at[a] < self.size[a]);
        inside.then(|| (at[0] * self.size[1] + at[1]) * self.size[2] + at[2])
    }

    /// Number of the block at a place.
    #[inline(always)]
    fn block(&self, block: Cell) -> Option<u32> {
        match self.table.is_empty() {
            true => self.sparse.get(&block).copied(),
            false => self.table[self.place(block)?].checked_sub(1),
        }
    }

    /// The cell with matter that a place [cells] is in, or else the nearest to it of those beside its cell: its block, which cell of
    /// it, and its place.
    #[inline(always)]
    pub fn nearest(&self, at: [f64; 3], cell: Cell) -> Option<(u32, u8, Cell)> {
        let (block, number) = split(cell);
        let block = self.block(block)?;
        let (filled, beside) = &self.blocks[block as usize];
        if filled >> number & 1 == 1 {
            return Some((block, number as u8, cell));
        }
        let mut squared = [[0.0; 3]; 3];
        for a in 0..3 {
            let off = at[a] - f64::from(cell[a]) - 0.5;
            squared[a] = [
                (off + 1.0) * (off + 1.0),
                off * off,
                (off - 1.0) * (off - 1.0),
            ];
        }
        let mut bits = beside[number];
        let (mut best, mut least) = (None, f64::INFINITY);
        while bits != 0 {
            let n = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let off = squared[0][n / 9] + squared[1][n / 3 % 3] + squared[2][n % 3];
            if off < least {
                (best, least) = (Some(n as i32), off);
            }
        }
        let n = best?;
        let o = [n / 9, n / 3 % 3, n % 3];
        let mut found = cell;
        for a in 0..3 {
            found[a] = cell[a].saturating_add(o[a] - 1);
        }
        let (block, number) = self.find(found)?;
        Some((block, number, found))
    }

    /// The block of a cell with matter, and which cell of it.
    #[inline(always)]
    pub fn find(&self, cell: Cell) -> Option<(u32, u8)> {
        let (block, number) = split(cell);
        let block = self.block(block)?;
        (self.blocks[block as usize].0 >> number & 1 == 1).then_some((block, number as u8))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_found_in_dense_and_in_sparse_solids() {
        let bit = |[x, y, z]: [i32; 3]| 1_u64 << (16 * x + 4 * y + z);
        for far in [1, 40_000] {
            let blocks = vec![[-1, 0, 2], [0, 0, 2], [far, far, far]];
            let filled = vec![bit([3, 0, 1]), bit([0, 2, 3]), bit([1, 1, 1])];
            let cells = FilledCells::new(&blocks, &filled);
            assert_eq!(cells.table.is_empty(), far > 1);
            assert_eq!(cells.find([-1, 0, 9]), Some((0, 49)));
            assert_eq!(cells.find([0, 2, 11]), Some((1, 11)));
            assert_eq!(cells.find([4 * far + 1; 3]), Some((2, 21)));
            for none in [
                [-2, 0, 9],
                [0, 0, 0],
                [4 * far; 3],
                [i32::MAX; 3],
                [i32::MIN; 3],
            ] {
                assert_eq!(cells.find(none), None);
            }
            // Beside two of them, nearer to one.
            assert_eq!(
                cells.nearest([-0.2, 1.4, 10.4], [-1, 1, 10]),
                Some((0, 49, [-1, 0, 9]))
            );
            assert_eq!(
                cells.nearest([0.2, 1.6, 10.6], [0, 1, 10]),
                Some((1, 11, [0, 2, 11]))
            );
            assert_eq!(cells.nearest([2.5, 1.5, 10.5], [2, 1, 10]), None);
        }
    }
}
