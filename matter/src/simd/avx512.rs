//! Sixteen lanes in one AVX-512 register.
//!
//! The methods are safe to call by type, but only code under an entry point that checked
//! [`Isa::is_available`](super::Isa::is_available) names this type; each SAFETY comment below leans on that.

use std::{
    arch::x86_64::*,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub},
};

use super::{F32x16, LANES, Lanes};
use crate::num::{Real, exp_f32, ln_f32};

/// Sixteen lanes.
#[derive(Clone, Copy)]
pub struct Avx512(__m512);

/// One truth value per lane.
#[derive(Clone, Copy)]
pub struct Mask(__mmask16);

macro_rules! binary {
    ($($trait:ident $op:ident $intrinsic:ident),*) => {$(
        impl $trait for Avx512 {
            type Output = Self;
            #[inline(always)]
            fn $op(self, other: Self) -> Self {
                // SAFETY: AVX-512 was detected (module text).
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    )*};
}
binary!(Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);

impl Neg for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_xor_ps(self.0, _mm512_set1_ps(-0.0)) })
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Avx512 {
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

impl Real for Avx512 {
    type Mask = Mask;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self::broadcast(value as f32)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_fmadd_ps(self.0, a.0, b.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_sqrt_ps(self.0) })
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
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_abs_ps(self.0) })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text). Takes the second operand unless the first is smaller.
        Self(unsafe { _mm512_min_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text). Takes the second operand unless the first is larger.
        Self(unsafe { _mm512_max_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask {
        // SAFETY: AVX-512 was detected (module text).
        Mask(unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) })
    }
    #[inline(always)]
    fn select(mask: Mask, a: Self, b: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_mask_blend_ps(mask.0, b.0, a.0) })
    }
    #[inline(always)]
    fn any(mask: Mask) -> bool {
        mask.0 != 0
    }
}

impl Lanes for Avx512 {
    #[inline(always)]
    fn load(from: &F32x16) -> Self {
        // SAFETY: AVX-512 was detected (module text); the reference is valid and aligned to 64 bytes.
        Self(unsafe { _mm512_load_ps(from.0.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut F32x16) {
        // SAFETY: AVX-512 was detected (module text); the reference is valid and aligned to 64 bytes.
        unsafe { _mm512_store_ps(to.0.as_mut_ptr(), self.0) };
    }
    #[inline(always)]
    fn broadcast(value: f32) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_set1_ps(value) })
    }
    /// # Safety
    /// As [`Lanes::load_at`] asks.
    #[inline(always)]
    unsafe fn load_at(from: *const f32) -> Self {
        // SAFETY: AVX-512 was detected (module text); the caller vouches for 16 floats.
        Self(unsafe { _mm512_loadu_ps(from) })
    }
    /// # Safety
    /// As [`Lanes::store_at`] asks.
    #[inline(always)]
    unsafe fn store_at(self, to: *mut f32) {
        // SAFETY: AVX-512 was detected (module text); the caller vouches for 16 floats.
        unsafe { _mm512_storeu_ps(to, self.0) };
    }
    /// # Safety
    /// As [`Lanes::stream`] asks.
    #[inline(always)]
    unsafe fn stream(self, to: &mut F32x16) {
        // SAFETY: AVX-512 was detected (module text); the reference is valid and aligned to 64 bytes; the caller vouches
        // for the fence.
        unsafe { _mm512_stream_ps(to.0.as_mut_ptr(), self.0) };
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
        // SAFETY: AVX-512 was detected (module text); the caller vouches for 4 floats.
        Self(unsafe { _mm512_broadcast_f32x4(_mm_loadu_ps(from)) })
    }
    #[inline(always)]
    fn spread(self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe {
            let lane = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
            _mm512_permutevar_ps(self.0, lane)
        })
    }
    #[inline(always)]
    fn fourth(self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe { _mm512_permute_ps::<0b11_11_11_11>(self.0) })
    }
    #[inline(always)]
    fn larger_magnitude(self, other: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe {
            let a = _mm512_castps_si512(_mm512_abs_ps(self.0));
            let b = _mm512_castps_si512(_mm512_abs_ps(other.0));
            _mm512_castsi512_ps(_mm512_max_epu32(a, b))
        })
    }
    #[inline(always)]
    fn sum_quarters([a, b, c, d]: [Self; 4]) -> Self {
        // SAFETY: AVX-512 was detected (module text). Quarters are named q: ab = a0+a2 a1+a3 b0+b2 b1+b3.
        Self(unsafe {
            let halves = |x: __m512, y: __m512| {
                _mm512_add_ps(
                    _mm512_shuffle_f32x4::<0b01_00_01_00>(x, y),
                    _mm512_shuffle_f32x4::<0b11_10_11_10>(x, y),
                )
            };
            let (ab, cd) = (halves(a.0, b.0), halves(c.0, d.0));
            _mm512_add_ps(
                _mm512_shuffle_f32x4::<0b10_00_10_00>(ab, cd),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(ab, cd),
            )
        })
    }
    #[inline(always)]
    fn transpose_quarters([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        // SAFETY: AVX-512 was detected (module text).
        unsafe {
            let ab_lo = _mm512_unpacklo_ps(a.0, b.0);
            let ab_hi = _mm512_unpackhi_ps(a.0, b.0);
            let cd_lo = _mm512_unpacklo_ps(c.0, d.0);
            let cd_hi = _mm512_unpackhi_ps(c.0, d.0);
            [
                Self(_mm512_shuffle_ps::<0b01_00_01_00>(ab_lo, cd_lo)),
                Self(_mm512_shuffle_ps::<0b11_10_11_10>(ab_lo, cd_lo)),
                Self(_mm512_shuffle_ps::<0b01_00_01_00>(ab_hi, cd_hi)),
                Self(_mm512_shuffle_ps::<0b11_10_11_10>(ab_hi, cd_hi)),
            ]
        }
    }
    #[inline(always)]
    fn shift_in_quarters<const N: i32>(self, next: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe {
            let (a, b) = (_mm512_castps_si512(self.0), _mm512_castps_si512(next.0));
            _mm512_castsi512_ps(match N {
                1 => _mm512_alignr_epi8::<4>(b, a),
                2 => _mm512_alignr_epi8::<8>(b, a),
                _ => _mm512_alignr_epi8::<12>(b, a),
            })
        })
    }
    #[inline(always)]
    fn shift_quarters<const N: i32>(self, next: Self) -> Self {
        // SAFETY: AVX-512 was detected (module text).
        Self(unsafe {
            let (a, b) = (_mm512_castps_si512(self.0), _mm512_castps_si512(next.0));
            _mm512_castsi512_ps(match N {
                1 => _mm512_alignr_epi32::<4>(b, a),
                2 => _mm512_alignr_epi32::<8>(b, a),
                _ => _mm512_alignr_epi32::<12>(b, a),
            })
        })
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
            let [a, b, c, d] = [inner[0][r].0, inner[1][r].0, inner[2][r].0, inner[3][r].0];
            // SAFETY: AVX-512 was detected (module text).
            unsafe {
                let ab_lo = _mm512_shuffle_f32x4::<0b01_00_01_00>(a, b);
                let ab_hi = _mm512_shuffle_f32x4::<0b11_10_11_10>(a, b);
                let cd_lo = _mm512_shuffle_f32x4::<0b01_00_01_00>(c, d);
                let cd_hi = _mm512_shuffle_f32x4::<0b11_10_11_10>(c, d);
                out[r] = Self(_mm512_shuffle_f32x4::<0b10_00_10_00>(ab_lo, cd_lo));
                out[4 + r] = Self(_mm512_shuffle_f32x4::<0b11_01_11_01>(ab_lo, cd_lo));
                out[8 + r] = Self(_mm512_shuffle_f32x4::<0b10_00_10_00>(ab_hi, cd_hi));
                out[12 + r] = Self(_mm512_shuffle_f32x4::<0b11_01_11_01>(ab_hi, cd_hi));
            }
        }
        out
    }
    #[inline(always)]
    fn store_bits(self, to: &mut [u32; LANES]) {
        // SAFETY: AVX-512 was detected (module text); the reference is valid, the store unaligned.
        unsafe { _mm512_storeu_si512(to.as_mut_ptr().cast(), _mm512_castps_si512(self.0)) };
    }
    #[inline(always)]
    fn mask_bits(mask: Mask) -> u32 {
        u32::from(mask.0)
    }
}
