//! Volumes of quadrature points as the kernel reads them, sixteen cells at a time.

use std::{collections::BTreeMap, ops::Range};

use crate::simd::F32x16;

/// Volume of every point of a block [cells]: `[2 y + z][x cell][x].0[4 z cell + y cell]`.
pub(crate) type Volumes = [[[F32x16; 2]; 4]; 4];

/// Cells of one part in a block: which of it, and the volumes of their points [cells].
type Cells = Vec<(u8, [f32; 8])>;

/// Cells of a block of points, per index of the object's laws.
pub(crate) type BlockParts = BTreeMap<u16, Cells>;

/// Part of a solid in a block of points: indices of its law, and of the points' volumes.
#[derive(Clone, Copy, Debug)]
struct Part {
    law: u16,
    volumes: u32,
    filled: Filled,
}

/// Which rows of sixteen cells have matter: one bit per `4 (2 y + z) + x cell`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filled(u16);

impl Filled {
    fn of(volumes: &Volumes) -> Self {
        let mut bits = 0;
        for (n, row) in volumes.as_flattened().iter().enumerate() {
            let any = row.iter().any(|points| points.0.iter().any(|&v| v > 0.0));
            bits |= u16::from(any) << n;
        }
        Self(bits)
    }

    /// Whether a row has any.
    #[inline(always)]
    pub fn has(self, q: usize, x: usize) -> bool {
        self.0 >> (4 * q + x) & 1 == 1
    }
}

/// Volumes of all points of a solid.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// Parts of every block of points, one after the other.
    parts: Vec<Part>,
    /// Those of each block.
    of_block: Vec<Range<u32>>,
    /// Different volumes; the first are those of a full block.
    volumes: Vec<Volumes>,
}

impl Parts {
    /// Of blocks of points with these cells.
    pub fn new(blocks: &[BlockParts]) -> Self {
        let none: Volumes = [[[F32x16::ZERO; 2]; 4]; 4];
        let full: Volumes = [[[F32x16::splat(0.125); 2]; 4]; 4];
        let mut new = Self {
            volumes: vec![full],
            ..Self::default()
        };
        for parts in blocks {
            let start = new.parts.len() as u32;
            for (&law, cells) in parts {
                let mut volumes = none;
                for (number, of_points) in cells {
                    let [x, y, z] = [16, 4, 1].map(|n| usize::from(*number) / n % 4);
                    for (n, &volume) in of_points.iter().enumerate() {
                        volumes[n % 4][x][n / 4].0[4 * z + y] = volume;
                    }
                }
                let filled = Filled::of(&volumes);
                let number = if volumes == full {
                    0
                } else {
                    new.volumes.push(volumes);
                    new.volumes.len() as u32 - 1
                };
                new.parts.push(Part {
                    law,
                    volumes: number,
                    filled,
                });
            }
            new.of_block.push(start..new.parts.len() as u32);
        }
        new
    }

    /// Laws and volumes of a block of points, and which of them are none.
    #[inline(always)]
    pub fn of(&self, block: usize) -> impl Iterator<Item = (u16, &Volumes, Filled)> {
        let range = &self.of_block[block];
        let parts = &self.parts[range.start as usize..range.end as usize];
        let of = |part: &Part| (part.law, &self.volumes[part.volumes as usize], part.filled);
        parts.iter().map(of)
    }
}
