//! Sixteen lanes in two AVX registers.
//!
//! The methods are safe to call by type, but only code under an entry point that checked
//! [`Isa::is_available`](super::Isa::is_available) names this type; each SAFETY comment below leans on that.

use std::{
    arch::x86_64::*,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub},
};

use super::{F32x16, LANES, Lanes};
use crate::num::{Real, exp_f32, ln_f32};

/// Sixteen lanes, low half first.
#[derive(Clone, Copy)]
pub struct Avx2(__m256, __m256);

/// All bits of a lane set where true.
#[derive(Clone, Copy)]
pub struct Mask(__m256, __m256);

macro_rules! binary {
    ($($type:ident $trait:ident $op:ident $intrinsic:ident),*) => {$(
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $op(self, other: Self) -> Self {
                // SAFETY: AVX2 was detected (module text).
                unsafe { Self($intrinsic(self.0, other.0), $intrinsic(self.1, other.1)) }
            }
        }
    )*};
}
binary!(
    Avx2 Add add _mm256_add_ps, Avx2 Sub sub _mm256_sub_ps,
    Avx2 Mul mul _mm256_mul_ps, Avx2 Div div _mm256_div_ps,
    Mask BitAnd bitand _mm256_and_ps, Mask BitOr bitor _mm256_or_ps
);

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            Self(_mm256_xor_ps(self.0, sign), _mm256_xor_ps(self.1, sign))
        }
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            let ones = _mm256_castsi256_ps(_mm256_set1_epi32(-1));
            Self(_mm256_xor_ps(self.0, ones), _mm256_xor_ps(self.1, ones))
        }
    }
}

impl Avx2 {
    /// Applies a branch-free scalar function to every lane; the compiler turns the loop into vector code.
    #[inline(always)]
    fn lanewise(self, f: impl Fn(f32) -> f32) -> Self {
        let mut lanes = F32x16::ZERO;
        self.store(&mut lanes);
        for lane in &mut lanes.0 {
            *lane = f(*lane);
        }
        Self::load(&lanes)
    }
}

/// [`Lanes::shift_in_quarters`] of eight lanes.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn shift_in_quarters<const N: i32>(a: __m256, b: __m256) -> __m256 {
    // SAFETY: the caller vouches for AVX2.
    unsafe {
        let (a, b) = (_mm256_castps_si256(a), _mm256_castps_si256(b));
        _mm256_castsi256_ps(match N {
            1 => _mm256_alignr_epi8::<4>(b, a),
            2 => _mm256_alignr_epi8::<8>(b, a),
            _ => _mm256_alignr_epi8::<12>(b, a),
        })
    }
}

/// The second half of `a` and the first of `b`.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn middle(a: __m256, b: __m256) -> __m256 {
    // SAFETY: the caller vouches for AVX2.
    unsafe { _mm256_permute2f128_ps::<0x21>(a, b) }
}

impl Real for Avx2 {
    type Mask = Mask;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self::broadcast(value as f32)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: AVX2 and FMA were detected (module text).
        unsafe {
            Self(
                _mm256_fmadd_ps(self.0, a.0, b.0),
                _mm256_fmadd_ps(self.1, a.1, b.1),
            )
        }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe { Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.lanewise(ln_f32)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.lanewise(exp_f32)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            Self(
                _mm256_andnot_ps(sign, self.0),
                _mm256_andnot_ps(sign, self.1),
            )
        }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: AVX2 was detected (module text). Takes the second operand unless the first is smaller.
        unsafe {
            Self(
                _mm256_min_ps(self.0, other.0),
                _mm256_min_ps(self.1, other.1),
            )
        }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: AVX2 was detected (module text). Takes the second operand unless the first is larger.
        unsafe {
            Self(
                _mm256_max_ps(self.0, other.0),
                _mm256_max_ps(self.1, other.1),
            )
        }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            Mask(
                _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0),
                _mm256_cmp_ps::<_CMP_LT_OQ>(self.1, other.1),
            )
        }
    }
    #[inline(always)]
    fn select(mask: Mask, a: Self, b: Self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            Self(
                _mm256_blendv_ps(b.0, a.0, mask.0),
                _mm256_blendv_ps(b.1, a.1, mask.1),
            )
        }
    }
    #[inline(always)]
    fn any(mask: Mask) -> bool {
        Self::mask_bits(mask) != 0
    }
}

impl Lanes for Avx2 {
    #[inline(always)]
    fn load(from: &F32x16) -> Self {
        // SAFETY: the reference is valid for 16 floats.
        unsafe { Self::load_at(from.0.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, to: &mut F32x16) {
        // SAFETY: the reference is valid for 16 floats.
        unsafe { self.store_at(to.0.as_mut_ptr()) };
    }
    #[inline(always)]
    fn broadcast(value: f32) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe { Self(_mm256_set1_ps(value), _mm256_set1_ps(value)) }
    }
    /// # Safety
    /// As [`Lanes::load_at`] asks.
    #[inline(always)]
    unsafe fn load_at(from: *const f32) -> Self {
        // SAFETY: AVX2 was detected (module text); the caller vouches for 16 floats.
        unsafe { Self(_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))) }
    }
    /// # Safety
    /// As [`Lanes::store_at`] asks.
    #[inline(always)]
    unsafe fn store_at(self, to: *mut f32) {
        // SAFETY: AVX2 was detected (module text); the caller vouches for 16 floats.
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm256_storeu_ps(to.add(8), self.1);
        }
    }
    /// # Safety
    /// As [`Lanes::stream`] asks.
    #[inline(always)]
    unsafe fn stream(self, to: &mut F32x16) {
        let to = to.0.as_mut_ptr();
        // SAFETY: AVX2 was detected (module text); the reference is valid and aligned to 64 bytes; the caller vouches for
        // the fence.
        unsafe {
            _mm256_stream_ps(to, self.0);
            _mm256_stream_ps(to.add(8), self.1);
        }
    }
    #[inline(always)]
    fn fence() {
        // SAFETY: part of every x86-64 processor.
        unsafe { _mm_sfence() };
    }
    /// # Safety
    /// As [`Lanes::repeat_quarter`] asks.
    #[inline(always)]
    unsafe fn repeat_quarter(from: *const f32) -> Self {
        // SAFETY: AVX2 was detected (module text); the caller vouches for 4 floats.
        unsafe {
            let quarter = _mm_loadu_ps(from);
            let half = _mm256_set_m128(quarter, quarter);
            Self(half, half)
        }
    }
    #[inline(always)]
    fn spread(self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            Self(
                _mm256_permutevar_ps(self.0, _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1)),
                _mm256_permutevar_ps(self.1, _mm256_setr_epi32(2, 2, 2, 2, 3, 3, 3, 3)),
            )
        }
    }
    #[inline(always)]
    fn fourth(self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            Self(
                _mm256_permute_ps::<0b11_11_11_11>(self.0),
                _mm256_permute_ps::<0b11_11_11_11>(self.1),
            )
        }
    }
    #[inline(always)]
    fn larger_magnitude(self, other: Self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            let max = |a: __m256, b: __m256| {
                let (a, b) = (_mm256_castps_si256(a), _mm256_castps_si256(b));
                _mm256_castsi256_ps(_mm256_max_epu32(a, b))
            };
            let (a, b) = (self.abs(), other.abs());
            Self(max(a.0, b.0), max(a.1, b.1))
        }
    }
    #[inline(always)]
    fn sum_quarters([a, b, c, d]: [Self; 4]) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            // Halves are quarters 0 1 and 2 3: their sum is v0+v2, v1+v3.
            let pair = |x: Self, y: Self| {
                let (x, y) = (_mm256_add_ps(x.0, x.1), _mm256_add_ps(y.0, y.1));
                _mm256_add_ps(
                    _mm256_permute2f128_ps::<0x20>(x, y),
                    _mm256_permute2f128_ps::<0x31>(x, y),
                )
            };
            Self(pair(a, b), pair(c, d))
        }
    }
    #[inline(always)]
    fn transpose_quarters([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            let half = |a: __m256, b: __m256, c: __m256, d: __m256| {
                let ab_lo = _mm256_unpacklo_ps(a, b);
                let ab_hi = _mm256_unpackhi_ps(a, b);
                let cd_lo = _mm256_unpacklo_ps(c, d);
                let cd_hi = _mm256_unpackhi_ps(c, d);
                [
                    _mm256_shuffle_ps::<0b01_00_01_00>(ab_lo, cd_lo),
                    _mm256_shuffle_ps::<0b11_10_11_10>(ab_lo, cd_lo),
                    _mm256_shuffle_ps::<0b01_00_01_00>(ab_hi, cd_hi),
                    _mm256_shuffle_ps::<0b11_10_11_10>(ab_hi, cd_hi),
                ]
            };
            let lo = half(a.0, b.0, c.0, d.0);
            let hi = half(a.1, b.1, c.1, d.1);
            [
                Self(lo[0], hi[0]),
                Self(lo[1], hi[1]),
                Self(lo[2], hi[2]),
                Self(lo[3], hi[3]),
            ]
        }
    }
    #[inline(always)]
    fn shift_in_quarters<const N: i32>(self, next: Self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            Self(
                shift_in_quarters::<N>(self.0, next.0),
                shift_in_quarters::<N>(self.1, next.1),
            )
        }
    }
    #[inline(always)]
    fn shift_quarters<const N: i32>(self, next: Self) -> Self {
        // SAFETY: AVX2 was detected (module text).
        unsafe {
            match N {
                1 => Self(middle(self.0, self.1), middle(self.1, next.0)),
                2 => Self(self.1, next.0),
                _ => Self(middle(self.1, next.0), middle(next.0, next.1)),
            }
        }
    }
    #[inline(always)]
    fn transpose(rows: &[F32x16; LANES]) -> [Self; LANES] {
        // Rows 4g..4g+4 are transposed within quarters, then the 4x4 matrix of quarters across g.
        let mut inner = [[Self::broadcast(0.0); 4]; 4];
        for g in 0..4 {
            inner[g] = Self::transpose_quarters([
                Self::load(&rows[4 * g]),
                Self::load(&rows[4 * g + 1]),
                Self::load(&rows[4 * g + 2]),
                Self::load(&rows[4 * g + 3]),
            ]);
        }
        let mut out = [Self::broadcast(0.0); LANES];
        for r in 0..4 {
            let [a, b, c, d] = [inner[0][r], inner[1][r], inner[2][r], inner[3][r]];
            // SAFETY: AVX2 was detected (module text).
            unsafe {
                out[r] = Self(
                    _mm256_permute2f128_ps::<0x20>(a.0, b.0),
                    _mm256_permute2f128_ps::<0x20>(c.0, d.0),
                );
                out[4 + r] = Self(
                    _mm256_permute2f128_ps::<0x31>(a.0, b.0),
                    _mm256_permute2f128_ps::<0x31>(c.0, d.0),
                );
                out[8 + r] = Self(
                    _mm256_permute2f128_ps::<0x20>(a.1, b.1),
                    _mm256_permute2f128_ps::<0x20>(c.1, d.1),
                );
                out[12 + r] = Self(
                    _mm256_permute2f128_ps::<0x31>(a.1, b.1),
                    _mm256_permute2f128_ps::<0x31>(c.1, d.1),
                );
            }
        }
        out
    }
    #[inline(always)]
    fn store_bits(self, to: &mut [u32; LANES]) {
        // SAFETY: u32 and f32 have one size; the reference is valid for 16 of them.
        unsafe { self.store_at(to.as_mut_ptr().cast()) };
    }
    #[inline(always)]
    fn mask_bits(mask: Mask) -> u32 {
        // SAFETY: AVX2 was detected (module text).
        unsafe { (_mm256_movemask_ps(mask.0) as u32) | ((_mm256_movemask_ps(mask.1) as u32) << 8) }
    }
}
