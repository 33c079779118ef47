//! What quadrature points remember of plastic flow, sixteen at a time: nothing where no law flows.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use super::{kernel::SolidLaw, model::SolidModel};
use crate::{
    mat3::Mat3,
    materials::hencky_piola::Point,
    simd::{F32x16, Lanes, Pair},
};

/// Numbers that a point remembers: `F_p^-1 - I`, row by row, and its law's own.
const NUMBERS: usize = 10;
/// Equivalent plastic strain of a point beyond which a solid goes over to the spatial grid.
pub const LARGEST_STRAIN: f64 = 2.0;
/// The law's own, of the plastic laws here the equivalent plastic strain.
const OWN: usize = 9;

/// What the points of one part in a block remember: `[2 y + z][x cell][number][x]`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub struct PartMemory(pub [[[[F32x16; 2]; NUMBERS]; 4]; 4]);

/// What a block of points remembers, part after part: nothing where no law of its parts flows.
pub(crate) type BlockMemory = Vec<PartMemory>;

impl PartMemory {
    /// What has never flowed.
    pub const REST: Self = Self([[[[F32x16::ZERO; 2]; NUMBERS]; 4]; 4]);

    /// Reads the points of a row of cells.
    #[inline(always)]
    pub fn load<V: Lanes>(&self, q: usize, x: usize) -> Point<Pair<V>> {
        let row = &self.0[q][x];
        let mut point = Point::rest();
        for a in 0..3 {
            for b in 0..3 {
                point.plastic.0[a][b] = read(&row[3 * a + b]);
            }
        }
        point.memory = read(&row[OWN]);
        point
    }

    /// Writes the points of a row of cells.
    #[inline(always)]
    pub fn store<V: Lanes>(&mut self, q: usize, x: usize, point: &Point<Pair<V>>) {
        let row = &mut self.0[q][x];
        let Mat3(plastic) = &point.plastic;
        for a in 0..3 {
            for b in 0..3 {
                write(plastic[a][b], &mut row[3 * a + b]);
            }
        }
        write(point.memory, &mut row[OWN]);
    }

    /// What the point at an octant of a cell remembers, by their numbers.
    pub fn point(&self, cell: u8, octant: usize) -> Point<f64> {
        let [x, y, z] = [16, 4, 1].map(|n| usize::from(cell) / n % 4);
        let row = &self.0[octant % 4][x];
        let number = |n: usize| f64::from(row[n][octant / 4].0[4 * z + y]);
        Point {
            plastic: Mat3(std::array::from_fn(|a| {
                std::array::from_fn(|b| number(3 * a + b))
            })),
            memory: number(OWN),
        }
    }

    /// Largest equivalent plastic strain of its points.
    fn most(&self) -> f32 {
        let rows = self.0.as_flattened().iter();
        let all = rows.flat_map(|row| row[OWN].iter().flat_map(|lanes| lanes.0));
        all.fold(0.0, f32::max)
    }
}

#[inline(always)]
fn read<V: Lanes>(from: &[F32x16; 2]) -> Pair<V> {
    Pair(V::load(&from[0]), V::load(&from[1]))
}

#[inline(always)]
fn write<V: Lanes>(Pair(one, other): Pair<V>, to: &mut [F32x16; 2]) {
    one.store(&mut to[0]);
    other.store(&mut to[1]);
}

/// Memory for the blocks that have none and need it.
pub fn remember(model: &SolidModel, laws: &[SolidLaw], memory: &mut [BlockMemory]) {
    if !laws.iter().any(|law| law.law.is_plastic()) {
        return;
    }
    for (n, block) in memory.iter_mut().enumerate() {
        let parts = model.parts.of(n);
        let mut flowing = parts.filter(|(law, ..)| laws[usize::from(*law)].law.is_plastic());
        if block.is_empty() && flowing.next().is_some() {
            block.resize(model.parts.of(n).count(), PartMemory::REST);
        }
    }
}

/// Sets the law's own number of all points of a part to that at rest: its law is another one. Their shape stays.
pub fn forget(model: &SolidModel, law: u16, memory: &mut [BlockMemory]) {
    for (n, block) in memory.iter_mut().enumerate() {
        let parts = model.parts.of(n).zip(block);
        for (_, memory) in parts.filter(|((own, ..), _)| *own == law) {
            for row in memory.0.as_flattened_mut() {
                row[OWN] = [F32x16::ZERO; 2];
            }
        }
    }
}

/// Largest equivalent plastic strain of any point.
pub fn largest_strain(memory: &[BlockMemory]) -> f64 {
    let strains = memory.iter().flatten().map(PartMemory::most);
    f64::from(strains.fold(0.0, f32::max))
}
