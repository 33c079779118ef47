//! Sixteen lanes as a plain array, for every processor.

use std::{
    array,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub},
};

use super::{F32x16, LANES, Lanes};
use crate::num::{Real, exp_f32, ln_f32};

/// Sixteen lanes.
#[derive(Clone, Copy)]
pub struct Portable([f32; LANES]);

/// One truth value per lane.
#[derive(Clone, Copy)]
pub struct Mask([bool; LANES]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Self(array::from_fn(|i| f(self.0[i])))
    }
}

impl Add for Portable {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Portable {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Portable {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Div for Portable {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
}

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(array::from_fn(|i| self.0[i] & other.0[i]))
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(array::from_fn(|i| self.0[i] | other.0[i]))
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.map(|m| !m))
    }
}

impl Real for Portable {
    type Mask = Mask;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value as f32; LANES])
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self(array::from_fn(|i| self.0[i].mul_add(a.0[i], b.0[i])))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.map(ln_f32)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.map(exp_f32)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask {
        Mask(array::from_fn(|i| self.0[i] < other.0[i]))
    }
    #[inline(always)]
    fn select(mask: Mask, a: Self, b: Self) -> Self {
        Self(array::from_fn(|i| if mask.0[i] { a.0[i] } else { b.0[i] }))
    }
    #[inline(always)]
    fn any(mask: Mask) -> bool {
        mask.0.contains(&true)
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn load(from: &F32x16) -> Self {
        Self(from.0)
    }
    #[inline(always)]
    fn store(self, to: &mut F32x16) {
        to.0 = self.0;
    }
    #[inline(always)]
    fn broadcast(value: f32) -> Self {
        Self([value; LANES])
    }
    /// # Safety
    /// As [`Lanes::load_at`] asks.
    #[inline(always)]
    unsafe fn load_at(from: *const f32) -> Self {
        // SAFETY: the caller vouches for 16 floats; the read is unaligned.
        Self(unsafe { from.cast::<[f32; LANES]>().read_unaligned() })
    }
    /// # Safety
    /// As [`Lanes::store_at`] asks.
    #[inline(always)]
    unsafe fn store_at(self, to: *mut f32) {
        // SAFETY: the caller vouches for 16 floats; the write is unaligned.
        unsafe { to.cast::<[f32; LANES]>().write_unaligned(self.0) };
    }
    /// # Safety
    /// As [`Lanes::stream`] asks.
    #[inline(always)]
    unsafe fn stream(self, to: &mut F32x16) {
        self.store(to);
    }
    #[inline(always)]
    fn fence() {}
    /// # Safety
    /// As [`Lanes::repeat_quarter`] asks.
    #[inline(always)]
    unsafe fn repeat_quarter(from: *const f32) -> Self {
        // SAFETY: the caller vouches for 4 floats; the read is unaligned.
        let quarter = unsafe { from.cast::<[f32; 4]>().read_unaligned() };
        Self(array::from_fn(|i| quarter[i % 4]))
    }
    #[inline(always)]
    fn spread(self) -> Self {
        Self(array::from_fn(|i| self.0[i / 4 * 4 + i / 4]))
    }
    #[inline(always)]
    fn fourth(self) -> Self {
        Self(array::from_fn(|i| self.0[i / 4 * 4 + 3]))
    }
    #[inline(always)]
    fn larger_magnitude(self, other: Self) -> Self {
        self.zip(other, |a, b| {
            f32::from_bits((a.to_bits() & 0x7fff_ffff).max(b.to_bits() & 0x7fff_ffff))
        })
    }
    #[inline(always)]
    fn sum_quarters(of: [Self; 4]) -> Self {
        Self(array::from_fn(|i| {
            let (v, c) = (&of[i / 4].0, i % 4);
            (v[c] + v[8 + c]) + (v[4 + c] + v[12 + c])
        }))
    }
    #[inline(always)]
    fn transpose_quarters(rows: [Self; 4]) -> [Self; 4] {
        array::from_fn(|r| Self(array::from_fn(|i| rows[i % 4].0[i / 4 * 4 + r])))
    }
    #[inline(always)]
    fn shift_in_quarters<const N: i32>(self, next: Self) -> Self {
        let n = N as usize;
        Self(array::from_fn(|i| {
            let from = if i % 4 + n < 4 { &self } else { &next };
            from.0[i / 4 * 4 + (i + n) % 4]
        }))
    }
    #[inline(always)]
    fn shift_quarters<const N: i32>(self, next: Self) -> Self {
        let n = 4 * N as usize;
        Self(array::from_fn(|i| {
            let from = if i + n < LANES { &self } else { &next };
            from.0[(i + n) % LANES]
        }))
    }
    #[inline(always)]
    fn transpose(rows: &[F32x16; LANES]) -> [Self; LANES] {
        array::from_fn(|r| Self(array::from_fn(|i| rows[i].0[r])))
    }
    #[inline(always)]
    fn store_bits(self, to: &mut [u32; LANES]) {
        *to = self.0.map(f32::to_bits);
    }
    #[inline(always)]
    fn mask_bits(mask: Mask) -> u32 {
        (0..LANES).map(|i| u32::from(mask.0[i]) << i).sum()
    }
}
