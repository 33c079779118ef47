//! Sixteen `f32` lanes on AVX-512, AVX2 with FMA, and any other processor: same bits on all three.
//!
//! Element-wise arithmetic is correctly rounded everywhere, shuffles move data without rounding, and sums over
//! lanes have one fixed order, so the choice of instruction set never shows in a result.

mod dispatch;
mod isa;
mod pair;
mod peak;
mod portable;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;

#[cfg(test)]
mod tests;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub use dispatch::on_isa;
pub use isa::{Isa, UnknownIsa};
pub use pair::Pair;
pub use peak::multiply_adds;
pub use portable::Portable;

use bytemuck::{Pod, Zeroable};

use crate::num::Real;

/// Lanes of a vector, and particles of a group.
pub const LANES: usize = 16;

/// One vector in memory, aligned to a cache line.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, serde::Serialize, serde::Deserialize)]
#[repr(C, align(64))]
pub struct F32x16(pub [f32; LANES]);

impl F32x16 {
    /// All lanes zero.
    pub const ZERO: Self = Self([0.0; LANES]);

    /// The same value in every lane.
    pub const fn splat(value: f32) -> Self {
        Self([value; LANES])
    }
}

/// A vector register of 16 lanes: the arithmetic of [`Real`] and the few shuffles that transfers need.
///
/// A "quarter" is four neighbouring lanes: x, y, z and a fourth value of one grid node.
pub trait Lanes: Real {
    /// Reads a vector from memory.
    fn load(from: &F32x16) -> Self;
    /// Writes a vector to memory.
    fn store(self, to: &mut F32x16);
    /// The same value in every lane.
    fn broadcast(value: f32) -> Self;
    /// Reads 16 floats at any alignment.
    ///
    /// # Safety
    /// `from` must be valid for reading 16 floats.
    unsafe fn load_at(from: *const f32) -> Self;
    /// Writes 16 floats at any alignment.
    ///
    /// # Safety
    /// `to` must be valid for writing 16 floats.
    unsafe fn store_at(self, to: *mut f32);
    /// Writes a vector past the caches, where the processor can.
    ///
    /// # Safety
    /// [`fence`](Self::fence) must follow on the same thread before anything else reads or writes `to`.
    unsafe fn stream(self, to: &mut F32x16);
    /// Ends a series of [`stream`](Self::stream): what was written is there for everybody.
    fn fence();
    /// Repeats 4 floats in every quarter.
    ///
    /// # Safety
    /// `from` must be valid for reading 4 floats.
    unsafe fn repeat_quarter(from: *const f32) -> Self;
    /// Fills quarter `q` with lane `q` of its own, as needed after [`repeat_quarter`](Self::repeat_quarter).
    fn spread(self) -> Self;
    /// The fourth lane of every quarter, in all its lanes.
    fn fourth(self) -> Self;
    /// Lane-wise larger magnitude, compared as bits: NaN is larger than infinity and never gets lost.
    fn larger_magnitude(self, other: Self) -> Self;
    /// Sums over quarters: result quarter `q` is `(v0 + v2) + (v1 + v3)` of the quarters of argument `q`.
    fn sum_quarters(of: [Self; 4]) -> Self;
    /// Transposes the 4x4 matrix that each quarter position forms across four vectors: vector `r`, quarter `q`
    /// of the result holds lane `4 q + r` of the four arguments.
    fn transpose_quarters(rows: [Self; 4]) -> [Self; 4];
    /// In every quarter, lanes `N..4` and then the first `N` lanes of that quarter of `next`; `N` is 1, 2 or 3.
    fn shift_in_quarters<const N: i32>(self, next: Self) -> Self;
    /// Quarters `N..4` and then the first `N` quarters of `next`; `N` is 1, 2 or 3.
    fn shift_quarters<const N: i32>(self, next: Self) -> Self;
    /// Transposes a 16x16 matrix of rows in memory.
    fn transpose(rows: &[F32x16; LANES]) -> [Self; LANES];
    /// Bits of the lanes as integers, written to memory.
    fn store_bits(self, to: &mut [u32; LANES]);
    /// Largest magnitude of any lane as bits, see [`larger_magnitude`](Self::larger_magnitude).
    #[inline(always)]
    fn largest_magnitude_bits(self) -> u32 {
        let mut bits = [0; LANES];
        self.store_bits(&mut bits);
        bits.into_iter()
            .map(|bits| bits & 0x7fff_ffff)
            .fold(0, u32::max)
    }
    /// One bit per lane, lane 0 lowest.
    fn mask_bits(mask: Self::Mask) -> u32;
}
