//! Which cells of a solid have matter: asked for every place that contact looks at.

/// Cells along one edge of a block.
pub(crate) const CELLS: i32 = 4;

/// Entries of the table per block of points at most; a solid that is sparser in its box is searched.
const DENSE: usize = 512;

/// The cells with matter, found by their places.
#[derive(Clone, Debug, Default)]
pub(crate) struct FilledCells {
    /// Places of the blocks of points, in lexicographic order.
    blocks: Vec<[i32; 3]>,
    /// One bit per cell of each, `16 x + 4 y + z`.
    filled: Vec<u64>,
    /// Smallest place, and how many there are along each axis.
    first: [i32; 3],
    size: [usize; 3],
    /// Number of the block at every place of the box plus one, z fastest; empty for a sparse solid.
    table: Vec<u32>,
}

impl FilledCells {
    /// Of blocks in lexicographic order with the cells that they have.
    pub fn new(blocks: Vec<[i32; 3]>, filled: Vec<u64>) -> Self {
        let bound = |a: usize, pick: fn(i32, i32) -> i32, none: i32| {
            blocks.iter().map(|block| block[a]).fold(none, pick)
        };
        let first: [i32; 3] = std::array::from_fn(|a| bound(a, i32::min, i32::MAX));
        let last: [i32; 3] = std::array::from_fn(|a| bound(a, i32::max, i32::MIN));
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
            filled,
            first,
            size,
        };
        if !new.table.is_empty() {
            for n in 0..new.blocks.len() {
                if let Some(at) = new.place(new.blocks[n]) {
                    new.table[at] = n as u32 + 1;
                }
            }
        }
        new
    }

    /// Place of a block in the table.
    #[inline(always)]
    fn place(&self, block: [i32; 3]) -> Option<usize> {
        let at: [usize; 3] =
            std::array::from_fn(|a| block[a].wrapping_sub(self.first[a]) as u32 as usize);
        let inside = (0..3).all(|a| at[a] < self.size[a]);
        inside.then(|| (at[0] * self.size[1] + at[1]) * self.size[2] + at[2])
    }

    /// The cell with matter nearest to a place [cells] of those in and beside a cell: its block, which cell of it, and its place.
    #[inline(always)]
    pub fn nearest(&self, at: [f64; 3], cell: [i32; 3]) -> Option<(u32, u8, [i32; 3])> {
        // Along every axis: block, place in it, and squared distance of the place from the centre.
        let mut axes = [[(0, 0_u8, 0.0); 3]; 3];
        for a in 0..3 {
            for n in 0..3 {
                let c = cell[a].saturating_add(n as i32 - 1);
                let off = at[a] - f64::from(c) - 0.5;
                axes[a][n] = (c.div_euclid(CELLS), c.rem_euclid(CELLS) as u8, off * off);
            }
        }
        let (mut best, mut least) = (None, f64::INFINITY);
        for x in 0..3 {
            for y in 0..3 {
                let (mut block, mut bits) = (0, None);
                for z in 0..3 {
                    let place = [axes[0][x], axes[1][y], axes[2][z]];
                    if z == 0 || place[2].0 != axes[2][z - 1].0 {
                        bits = self.block(place.map(|p| p.0)).map(|found| {
                            block = found;
                            self.filled[found as usize]
                        });
                    }
                    let number = 16 * place[0].1 + 4 * place[1].1 + place[2].1;
                    let off = place[0].2 + place[1].2 + place[2].2;
                    if off < least && bits.is_some_and(|bits| bits >> number & 1 == 1) {
                        let mut found = cell;
                        for (a, n) in [x, y, z].into_iter().enumerate() {
                            found[a] = cell[a].saturating_add(n as i32 - 1);
                        }
                        (best, least) = (Some((block, number, found)), off);
                    }
                }
            }
        }
        best
    }

    /// Number of the block at a place.
    #[inline(always)]
    fn block(&self, block: [i32; 3]) -> Option<u32> {
        match self.table.is_empty() {
            true => Some(self.blocks.binary_search(&block).ok()? as u32),
            false => self.table[self.place(block)?].checked_sub(1),
        }
    }

    /// The block of a cell with matter, and which cell of it.
    #[inline(always)]
    pub fn find(&self, cell: [i32; 3]) -> Option<(u32, u8)> {
        let found = self.block(cell.map(|c| c.div_euclid(CELLS)))?;
        let [x, y, z] = cell.map(|c| c.rem_euclid(CELLS) as u8);
        let number = 16 * x + 4 * y + z;
        (self.filled[found as usize] >> number & 1 == 1).then_some((found, number))
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
            let cells = FilledCells::new(blocks, filled);
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
