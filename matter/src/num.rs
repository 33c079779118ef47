//! The number type that material laws are written over: `f64` in the reference path, 16 `f32` lanes in the
//! fast path, one text for both.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// A real number or a vector of independent real lanes.
///
/// Every operation on `f32` lanes is correctly rounded or, for [`ln`](Self::ln) and [`exp`](Self::exp), built
/// from such operations in a fixed order ([`ln_f32`], [`exp_f32`]), so that a law gives the same bits on every
/// instruction set. `f64` is the reference path's type and takes `ln` and `exp` from the platform.
pub trait Real:
    Copy
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// One truth value per lane.
    type Mask: Copy
        + BitAnd<Output = Self::Mask>
        + BitOr<Output = Self::Mask>
        + Not<Output = Self::Mask>;

    /// Distance from 1 to the next number: how many terms of a series pay.
    const EPSILON: f64 = f32::EPSILON as f64;

    /// The same value in every lane.
    fn splat(value: f64) -> Self;
    /// `self * a + b`; of `f32` lanes rounded once.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Lane-wise smaller value.
    fn min(self, other: Self) -> Self;
    /// Lane-wise larger value.
    fn max(self, other: Self) -> Self;
    /// Lane-wise `self < other`; false where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lane-wise `mask ? a : b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Whether any lane is true.
    fn any(mask: Self::Mask) -> bool;
}

impl Real for f64 {
    type Mask = bool;
    const EPSILON: f64 = Self::EPSILON;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // Rounded twice on purpose: where the baseline of the target lacks the instruction, fusing is a library call.
        self * a + b
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.ln()
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.exp()
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }
}

impl Real for f32 {
    type Mask = bool;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self.mul_add(a, b)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn ln(self) -> Self {
        ln_f32(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        exp_f32(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }
}

/// Natural logarithm of one `f32` lane without branches, within 2 ulp; NaN below zero, `-inf` at zero.
///
/// Minimax polynomial for `ln(1 + f)`, `sqrt(1/2) <= 1 + f < sqrt(2)`, of Cephes `logf` (Moshier), evaluated
/// with fused multiply-adds.
#[inline(always)]
pub fn ln_f32(x: f32) -> f32 {
    let subnormal = x < f32::MIN_POSITIVE;
    let scaled = if subnormal { x * 8_388_608.0 } else { x };
    let exponent_shift = if subnormal { -23.0 } else { 0.0 };
    // Adding the distance from sqrt(1/2) to 1 makes the exponent field change at sqrt(1/2) * 2^k.
    let bits = scaled.to_bits().wrapping_add(0x3f80_0000 - 0x3f35_04f3);
    let k = ((bits >> 23) as i32 - 127) as f32 + exponent_shift;
    let f = f32::from_bits((bits & 0x007f_ffff) + 0x3f35_04f3) - 1.0;
    let z = f * f;
    let p = 7.037_683_6e-2_f32
        .mul_add(f, -1.151_461e-1)
        .mul_add(f, 1.167_699_9e-1)
        .mul_add(f, -1.242_014_1e-1)
        .mul_add(f, 1.424_932_3e-1)
        .mul_add(f, -1.666_805_8e-1)
        .mul_add(f, 2.000_071_5e-1)
        .mul_add(f, -2.499_999_4e-1)
        .mul_add(f, 3.333_333e-1);
    // ln 2 in two parts: the first has so few bits that its product with k is exact.
    let tail = k.mul_add(-2.121_944_4e-4, (f * z) * p);
    let value = k.mul_add(0.693_359_4, f + (-0.5_f32).mul_add(z, tail));
    let value = if x < f32::INFINITY { value } else { x };
    let value = if x > 0.0 { value } else { f32::NAN };
    if x == 0.0 { f32::NEG_INFINITY } else { value }
}

/// Exponential of one `f32` lane without branches, within 2 ulp; overflows to `inf`, underflows gradually to 0.
///
/// Polynomial of Cephes `expf` (Moshier) on `|r| <= ln(2) / 2`, evaluated with fused multiply-adds.
#[inline(always)]
pub fn exp_f32(x: f32) -> f32 {
    let clamped = if x > 89.0 { 89.0 } else { x };
    let clamped = if clamped < -104.0 { -104.0 } else { clamped };
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the low mantissa bits.
    let shifted = clamped.mul_add(std::f32::consts::LOG2_E, 12_582_912.0);
    let k = shifted - 12_582_912.0;
    let r = k.mul_add(-0.693_359_4, clamped);
    let r = k.mul_add(2.121_944_4e-4, r);
    let p = 1.987_569_1e-4_f32
        .mul_add(r, 1.398_2e-3)
        .mul_add(r, 8.333_452e-3)
        .mul_add(r, 4.166_579_6e-2)
        .mul_add(r, 1.666_666_5e-1)
        .mul_add(r, 0.5);
    let value = (r * r).mul_add(p, r) + 1.0;
    // Two factors, so that subnormal results round once and 2^128 never appears.
    let k = shifted.to_bits().wrapping_sub(12_582_912.0_f32.to_bits()) as i32;
    let half = k >> 1;
    let power = |n: i32| f32::from_bits((n.wrapping_add(127) as u32) << 23);
    value * power(half) * power(k.wrapping_sub(half))
}

/// Cube root of a number of at least 0, to round-off: an eighth of the library's time, which rounds correctly.
pub fn cube_root(x: f64) -> f64 {
    // A third of the exponent, within 6 %.
    let mut root = f64::from_bits(x.to_bits() / 3 + 0x2a9f_7893_0000_0000);
    if x < f64::MIN_POSITIVE {
        return 0.0;
    }
    // Halley's iteration: each makes three digits of one.
    for _ in 0..3 {
        let cubed = root * root * root;
        root *= (cubed + 2.0 * x) / (2.0 * cubed + x);
    }
    root
}

/// Numbers between -1 and 1 by a fixed linear congruence.
pub fn random(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distance from the exact value in units of the last place of the f32 result.
    fn ulp_error(approximate: f32, exact: f64) -> f64 {
        let nearest = exact as f32;
        let ulp = f64::from(nearest.abs().max(f32::MIN_POSITIVE).next_up())
            - f64::from(nearest.abs().max(f32::MIN_POSITIVE));
        (f64::from(approximate) - exact).abs() / ulp
    }

    #[test]
    fn logarithm_is_within_two_ulp_over_all_positive_floats() {
        let mut worst = 0.0_f64;
        for bits in (1..f32::INFINITY.to_bits()).step_by(509) {
            let x = f32::from_bits(bits);
            worst = worst.max(ulp_error(ln_f32(x), f64::from(x).ln()));
        }
        // Around 1 the result is small: every float there, not a sample.
        for bits in 0.99_f32.to_bits()..1.01_f32.to_bits() {
            let x = f32::from_bits(bits);
            worst = worst.max(ulp_error(ln_f32(x), f64::from(x).ln()));
        }
        assert!(worst <= 2.0, "worst error {worst} ulp");
    }

    #[test]
    fn exponential_is_within_two_ulp_over_its_whole_range() {
        let mut worst = 0.0_f64;
        for step in -10_400_000..8_872_000 {
            let x = step as f32 * 1e-5;
            worst = worst.max(ulp_error(exp_f32(x), f64::from(x).exp()));
        }
        assert!(worst <= 2.0, "worst error {worst} ulp");
    }

    #[test]
    fn cube_root_is_the_library_s_to_round_off() {
        let mut seed = 3;
        for n in 0..100_000 {
            let x = (0.5 + 0.5 * random(&mut seed)) * 10.0_f64.powi(n % 40 - 37);
            let off = (cube_root(x) / x.cbrt() - 1.0).abs();
            assert!(off < 3.0 * f64::EPSILON, "{off} of {x}");
        }
        assert_eq!([0.0, 1.0, 8.0].map(cube_root), [0.0, 1.0, 2.0]);
    }

    #[test]
    fn special_values_follow_the_mathematical_limits() {
        assert_eq!(ln_f32(1.0), 0.0);
        assert_eq!(ln_f32(0.0), f32::NEG_INFINITY);
        assert_eq!(ln_f32(f32::INFINITY), f32::INFINITY);
        assert!(ln_f32(-1.0).is_nan() && ln_f32(f32::NAN).is_nan());
        assert_eq!(exp_f32(0.0), 1.0);
        assert_eq!(exp_f32(f32::INFINITY), f32::INFINITY);
        assert_eq!(exp_f32(f32::NEG_INFINITY), 0.0);
        assert!(exp_f32(f32::NAN).is_nan());
    }
}
