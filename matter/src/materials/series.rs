//! Logarithm and exponential of symmetric 3x3 matrices near the identity, without eigenvectors.
//!
//! A function of a 3x3 matrix `A` is `a I + b A + c A^2`. Horner's rule runs on the three coefficients alone,
//! since by Cayley and Hamilton `A^3 = i1 A^2 - i2 A + i3 I`: a term of a series costs three multiplications.

use crate::{mat3::Sym3, num::Real};

/// Largest `|Z|` (Frobenius) for which [`half_log`] is exact to round-off: principal stretches of `exp(+-0.2)`.
pub const LOG_BOUND: f64 = 0.2;

/// Largest `|D|` (Frobenius) for which [`exp_minus_identity`] is exact to round-off: a flow within [`LOG_BOUND`] and a
/// change of `tr eps` up to [`TRACE_BOUND`].
pub const EXP_BOUND: f64 = 0.23;

/// Largest change of `tr eps` that goes with [`EXP_BOUND`].
pub const TRACE_BOUND: f64 = 0.18;

/// Terms of `atanh(Z) = Z + Z^3 / 3 + ...` after the first: the next is below half an ulp at [`LOG_BOUND`].
const fn log_terms(epsilon: f64) -> usize {
    if epsilon > 1e-10 { 5 } else { 11 }
}

/// Highest power in the series of the exponential: the next is below half an ulp at [`EXP_BOUND`].
const fn exp_terms(epsilon: f64) -> usize {
    if epsilon > 1e-10 { 7 } else { 12 }
}

/// `A^2`.
#[inline(always)]
pub fn square<R: Real>(a: &Sym3<R>) -> Sym3<R> {
    let [xx, xy, xz, yy, yz, zz] = *a;
    [
        xx.mul_add(xx, xy.mul_add(xy, xz * xz)),
        xx.mul_add(xy, xy.mul_add(yy, xz * yz)),
        xx.mul_add(xz, xy.mul_add(yz, xz * zz)),
        xy.mul_add(xy, yy.mul_add(yy, yz * yz)),
        xy.mul_add(xz, yy.mul_add(yz, yz * zz)),
        xz.mul_add(xz, yz.mul_add(yz, zz * zz)),
    ]
}

/// Principal invariants `i1 = tr A`, `i2`, `i3 = det A`.
#[inline(always)]
fn invariants<R: Real>(a: &Sym3<R>) -> [R; 3] {
    let [xx, xy, xz, yy, yz, zz] = *a;
    let minor = yy.mul_add(zz, -(yz * yz));
    let i2 = minor + (xx.mul_add(zz, -(xz * xz)) + xx.mul_add(yy, -(xy * xy)));
    let i3 = xx.mul_add(
        minor,
        xy.mul_add(xz.mul_add(yz, -(xy * zz)), xz * xy.mul_add(yz, -(yy * xz))),
    );
    [xx + (yy + zz), i2, i3]
}

/// Coefficients of `(a I + b A + c A^2) A`.
#[inline(always)]
fn times<R: Real>([a, b, c]: [R; 3], [i1, i2, i3]: [R; 3]) -> [R; 3] {
    [c * i3, a - c * i2, b + c * i1]
}

/// `a I + b A + c A^2`.
#[inline(always)]
fn combine<R: Real>([a, b, c]: [R; 3], first: &Sym3<R>, second: &Sym3<R>) -> Sym3<R> {
    let mut sum = [a, R::splat(0.0), R::splat(0.0), a, R::splat(0.0), a];
    for n in 0..6 {
        sum[n] = first[n].mul_add(b, second[n].mul_add(c, sum[n]));
    }
    sum
}

/// `ln(I + X) / 2` and `|Z|^2` with `Z = X (2 I + X)^-1`; exact to round-off where `|Z| <=` [`LOG_BOUND`].
///
/// With `X = F F^T - I` it is the Hencky strain of the stretch `V` of `F = V R`. `Z` is the hyperbolic tangent
/// of that strain, whose inverse converges fast; taking `X` rather than `I + X` keeps the digits of small strains.
#[inline(always)]
pub fn half_log<R: Real>(x: &Sym3<R>) -> (Sym3<R>, R) {
    let two = R::splat(2.0);
    let [i1, i2, i3] = invariants(x);
    // det(2 I + X)
    let det = R::splat(4.0).mul_add(two + i1, two.mul_add(i2, i3));
    let scale = R::splat(1.0) / det;
    let four = R::splat(4.0);
    // X adj(2 I + X), by Cayley and Hamilton
    let z = combine(
        [i3 * scale, two.mul_add(i1, four) * scale, -two * scale],
        x,
        &square(x),
    );
    let z2 = square(&z);
    let norm_squared = z2[0] + (z2[3] + z2[5]);
    let i = invariants(&z);
    let zero = R::splat(0.0);
    let terms = log_terms(R::EPSILON);
    let mut p = [R::splat(1.0 / (2 * terms + 1) as f64), zero, zero];
    for k in (0..terms).rev() {
        p = times(times(p, i), i);
        p[0] = p[0] + R::splat(1.0 / (2 * k + 1) as f64);
    }
    (combine(times(p, i), &z, &z2), norm_squared)
}

/// `exp(D) - I`, exact to round-off where `|D| <=` [`EXP_BOUND`].
#[inline(always)]
pub fn exp_minus_identity<R: Real>(d: &Sym3<R>) -> Sym3<R> {
    let i = invariants(d);
    let zero = R::splat(0.0);
    let one = R::splat(1.0);
    let mut p = [one, zero, zero];
    for k in (2..=exp_terms(R::EPSILON)).rev() {
        let inverse = R::splat(1.0 / k as f64);
        let [a, b, c] = times(p, i);
        p = [a.mul_add(inverse, one), b * inverse, c * inverse];
    }
    combine(times(p, i), d, &square(d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        mat3::Mat3,
        materials::{svd::svd, testing::Random},
    };

    /// `v diag(of(d)) v^T`.
    fn rebuild(v: &Mat3<f64>, d: [f64; 3], of: impl Fn(f64) -> f64) -> Sym3<f64> {
        v.mul(&Mat3::diagonal(d.map(of))).mul_transposed_sym(v)
    }

    fn worst(a: &Sym3<f64>, b: &Sym3<f64>) -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    }

    /// A rotation and strains whose largest is `size`.
    fn strains(random: &mut Random, size: f64) -> (Mat3<f64>, [f64; 3]) {
        let d: [f64; 3] = std::array::from_fn(|_| random.uniform(-1.0, 1.0));
        let largest = d.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
        (random.rotation(), d.map(|x| x * size / largest))
    }

    /// From the bound of the series on.
    #[test]
    fn logarithm_keeps_its_digits_down_to_tiny_strains() {
        let mut random = Random::new(21);
        for case in 0..6_000 {
            let size = [0.115, 1e-2, 1e-4, 1e-7][case % 4];
            let (v, d) = strains(&mut random, size);
            let exact = rebuild(&v, d, |e| e);
            let x = rebuild(&v, d, |e| (2.0 * e).exp_m1());
            let (strain, norm) = half_log(&x);
            assert!(norm < LOG_BOUND * LOG_BOUND);
            // A dozen roundings of numbers of the strain's size.
            assert!(
                worst(&strain, &exact) < 1e-15 * size,
                "{strain:?} {exact:?}"
            );
            let (strain, _) = half_log(&x.map(|x| x as f32));
            let strain = strain.map(f64::from);
            assert!(worst(&strain, &exact) < 6e-7 * size, "{strain:?} {exact:?}");
        }
    }

    /// From the bound of the series on.
    #[test]
    fn exponential_keeps_its_digits_down_to_tiny_strains() {
        let mut random = Random::new(22);
        for case in 0..6_000 {
            let size = [0.132, 1e-2, 1e-4, 1e-7][case % 4];
            let (v, d) = strains(&mut random, size);
            let exact = rebuild(&v, d, f64::exp_m1);
            let d = rebuild(&v, d, |e| e);
            let found = exp_minus_identity(&d);
            assert!(worst(&found, &exact) < 1e-15 * size, "{found:?} {exact:?}");
            let found = exp_minus_identity(&d.map(|x| x as f32)).map(f64::from);
            assert!(worst(&found, &exact) < 6e-7 * size, "{found:?} {exact:?}");
        }
    }

    #[test]
    fn series_and_eigenvectors_agree() {
        let mut random = Random::new(23);
        for _ in 0..2_000 {
            let (f, _) = random.deformation(0.9, 1.12, false);
            let d = svd(&f);
            let exact = rebuild(&d.u, d.sigma, f64::ln);
            let mut x = f.mul_transposed_sym(&f);
            for n in [0, 3, 5] {
                x[n] -= 1.0;
            }
            let (strain, _) = half_log(&x);
            assert!(worst(&strain, &exact) < 1e-14, "{strain:?} {exact:?}");
        }
    }
}
