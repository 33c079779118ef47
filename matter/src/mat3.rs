//! 3x3 matrices over [`Real`]: plain values in the reference path, 16 matrices at once in the fast path.

use crate::num::Real;

/// Row-major 3x3 matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat3<R>(pub [[R; 3]; 3]);

/// Symmetric 3x3 matrix, order xx xy xz yy yz zz.
pub type Sym3<R> = [R; 6];

/// `a . b` of 3-vectors, fused, summed from the last component to the first.
#[inline(always)]
pub fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Length of a vector.
#[inline]
pub fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

/// A vector of length 1 in the same direction; zero where there is none.
#[inline]
pub fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = length(v);
    if length > 0.0 && length.is_finite() {
        v.map(|v| v / length)
    } else {
        [0.0; 3]
    }
}

/// `a x b` of 3-vectors.
#[inline(always)]
pub fn cross<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    [
        a[1].mul_add(b[2], -(a[2] * b[1])),
        a[2].mul_add(b[0], -(a[0] * b[2])),
        a[0].mul_add(b[1], -(a[1] * b[0])),
    ]
}

/// `a x + b y` of 3-vectors.
#[inline(always)]
fn blend3<R: Real>(x: [R; 3], y: [R; 3], a: R, b: R) -> [R; 3] {
    [
        x[0].mul_add(a, y[0] * b),
        x[1].mul_add(a, y[1] * b),
        x[2].mul_add(a, y[2] * b),
    ]
}

#[inline(always)]
fn sub3<R: Real>(x: [R; 3], y: [R; 3]) -> [R; 3] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

/// Lane-wise `mask ? a : b` of 3-vectors.
#[inline(always)]
pub fn select3<R: Real>(mask: R::Mask, a: [R; 3], b: [R; 3]) -> [R; 3] {
    [
        R::select(mask, a[0], b[0]),
        R::select(mask, a[1], b[1]),
        R::select(mask, a[2], b[2]),
    ]
}

impl<R: Real> Mat3<R> {
    /// Rotation matrix of a unit quaternion xyzw.
    #[inline(always)]
    pub fn from_quaternion([x, y, z, w]: [R; 4]) -> Self {
        let (one, two) = (R::splat(1.0), R::splat(2.0));
        Self([
            [
                one - two * (y * y + z * z),
                two * (x * y - w * z),
                two * (x * z + w * y),
            ],
            [
                two * (x * y + w * z),
                one - two * (x * x + z * z),
                two * (y * z - w * x),
            ],
            [
                two * (x * z - w * y),
                two * (y * z + w * x),
                one - two * (x * x + y * y),
            ],
        ])
    }

    /// The identity.
    #[inline(always)]
    pub fn identity() -> Self {
        Self::diagonal([R::splat(1.0); 3])
    }

    /// A diagonal matrix.
    #[inline(always)]
    pub fn diagonal(d: [R; 3]) -> Self {
        let o = R::splat(0.0);
        Self([[d[0], o, o], [o, d[1], o], [o, o, d[2]]])
    }

    /// Column `j`.
    #[inline(always)]
    pub fn column(&self, j: usize) -> [R; 3] {
        [self.0[0][j], self.0[1][j], self.0[2][j]]
    }

    /// The matrix with these columns.
    #[inline(always)]
    pub fn from_columns(a: [R; 3], b: [R; 3], c: [R; 3]) -> Self {
        Self([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]])
    }

    /// Transpose.
    #[inline(always)]
    pub fn transpose(&self) -> Self {
        let [a, b, c] = self.0;
        Self::from_columns(a, b, c)
    }

    /// Entry-wise combination `self * a + other * b`.
    #[inline(always)]
    pub fn blend(&self, a: R, other: &Self, b: R) -> Self {
        Self([
            blend3(self.0[0], other.0[0], a, b),
            blend3(self.0[1], other.0[1], a, b),
            blend3(self.0[2], other.0[2], a, b),
        ])
    }

    /// `self - other`.
    #[inline(always)]
    pub fn sub(&self, other: &Self) -> Self {
        Self([
            sub3(self.0[0], other.0[0]),
            sub3(self.0[1], other.0[1]),
            sub3(self.0[2], other.0[2]),
        ])
    }

    /// `self * v`.
    #[inline(always)]
    pub fn mul_vec(&self, v: [R; 3]) -> [R; 3] {
        [dot(self.0[0], v), dot(self.0[1], v), dot(self.0[2], v)]
    }

    /// `self * other`.
    #[inline(always)]
    pub fn mul(&self, other: &Self) -> Self {
        self.mul_transposed(&other.transpose())
    }

    /// `self * other^T`.
    #[inline(always)]
    pub fn mul_transposed(&self, other: &Self) -> Self {
        Self([
            other.mul_vec(self.0[0]),
            other.mul_vec(self.0[1]),
            other.mul_vec(self.0[2]),
        ])
    }

    /// Upper triangle of `self * other^T`, for products known to be symmetric.
    #[inline(always)]
    pub fn mul_transposed_sym(&self, other: &Self) -> Sym3<R> {
        let [a, b, c] = self.0;
        let [d, e, f] = other.0;
        [
            dot(a, d),
            dot(a, e),
            dot(a, f),
            dot(b, e),
            dot(b, f),
            dot(c, f),
        ]
    }

    /// Cofactor matrix: `det(self) * self^-T` where the inverse exists.
    #[inline(always)]
    pub fn cofactor(&self) -> Self {
        let [a, b, c] = self.0;
        Self([cross(b, c), cross(c, a), cross(a, b)])
    }

    /// Determinant.
    #[inline(always)]
    pub fn det(&self) -> R {
        let [a, b, c] = self.0;
        dot(a, cross(b, c))
    }

    /// Sum of the diagonal.
    #[inline(always)]
    pub fn trace(&self) -> R {
        self.0[0][0] + self.0[1][1] + self.0[2][2]
    }

    /// Sum of squared entries.
    #[inline(always)]
    pub fn norm_squared(&self) -> R {
        let [a, b, c] = self.0;
        dot(a, a) + (dot(b, b) + dot(c, c))
    }

    /// Lane-wise `mask ? a : b`.
    #[inline(always)]
    pub fn select(mask: R::Mask, a: &Self, b: &Self) -> Self {
        Self([
            select3::<R>(mask, a.0[0], b.0[0]),
            select3::<R>(mask, a.0[1], b.0[1]),
            select3::<R>(mask, a.0[2], b.0[2]),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Mat3<f64> = Mat3([[1.0, 2.0, -1.0], [0.5, -3.0, 4.0], [2.0, 1.0, 0.25]]);
    const B: Mat3<f64> = Mat3([[0.0, 1.0, 3.0], [-2.0, 0.5, 1.0], [1.0, 1.0, -4.0]]);

    #[test]
    fn cofactor_times_transpose_is_the_determinant() {
        let product = A.cofactor().mul_transposed(&A);
        let expected = Mat3::diagonal([A.det(); 3]);
        // Exact up to round-off of a handful of products of order 10.
        assert!(product.sub(&expected).norm_squared().sqrt() < 1e-14);
    }

    #[test]
    fn determinant_of_a_product_is_the_product_of_determinants() {
        assert!((A.mul(&B).det() - A.det() * B.det()).abs() < 1e-12);
    }

    #[test]
    fn transposed_products_agree() {
        assert_eq!(A.mul_transposed(&B), A.mul(&B.transpose()));
        let b = A.mul_transposed(&A);
        assert_eq!(
            A.mul_transposed_sym(&A),
            [
                b.0[0][0], b.0[0][1], b.0[0][2], b.0[1][1], b.0[1][2], b.0[2][2]
            ]
        );
    }
}
