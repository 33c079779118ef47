//! Scalar 3x3 algebra of the yardstick.

/// Row-major 3x3 matrix.
pub type Matrix = [f32; 9];

/// Symmetric 3x3 matrix, order xx xy xz yy yz zz.
pub type Symmetric = [f32; 6];

/// The identity.
pub const IDENTITY: Matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// Sweeps of [`eigen`] at most.
const SWEEPS: usize = 8;

/// `a + s b`.
#[inline(always)]
pub fn add_product(a: &Matrix, s: f32, b: &Matrix) -> Matrix {
    let mut sum = *a;
    for n in 0..9 {
        sum[n] = s.mul_add(b[n], a[n]);
    }
    sum
}

/// `a b`.
#[inline(always)]
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = [0.0; 9];
    for i in 0..3 {
        for j in 0..3 {
            let last = a[3 * i + 2] * b[6 + j];
            c[3 * i + j] = a[3 * i].mul_add(b[j], a[3 * i + 1].mul_add(b[3 + j], last));
        }
    }
    c
}

/// `a b^T` where that is symmetric.
#[inline(always)]
pub fn symmetric_product(a: &Matrix, b: &Matrix) -> Symmetric {
    let mut c = [0.0; 6];
    for (n, (i, j)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
        .into_iter()
        .enumerate()
    {
        let last = a[3 * i + 2] * b[3 * j + 2];
        c[n] = a[3 * i].mul_add(b[3 * j], a[3 * i + 1].mul_add(b[3 * j + 1], last));
    }
    c
}

/// Cofactors; the first row times that of `m` is the determinant.
#[inline(always)]
pub fn cofactor(m: &Matrix) -> Matrix {
    [
        m[4] * m[8] - m[5] * m[7],
        m[5] * m[6] - m[3] * m[8],
        m[3] * m[7] - m[4] * m[6],
        m[2] * m[7] - m[1] * m[8],
        m[0] * m[8] - m[2] * m[6],
        m[1] * m[6] - m[0] * m[7],
        m[1] * m[5] - m[2] * m[4],
        m[2] * m[3] - m[0] * m[5],
        m[0] * m[4] - m[1] * m[3],
    ]
}

/// `det m` from its cofactors.
#[inline(always)]
pub fn determinant(m: &Matrix, cofactor: &Matrix) -> f32 {
    m[0].mul_add(cofactor[0], m[1].mul_add(cofactor[1], m[2] * cofactor[2]))
}

/// `u diag(d) u^T`.
#[inline(always)]
pub fn spectral(u: &Matrix, d: [f32; 3]) -> Symmetric {
    let mut scaled = *u;
    for n in 0..9 {
        scaled[n] *= d[n % 3];
    }
    symmetric_product(&scaled, u)
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix: cyclic Jacobi, which near a multiple of the
/// identity needs two or three sweeps.
#[inline(always)]
pub fn eigen(b: &Symmetric) -> ([f32; 3], Matrix) {
    let [mut xx, mut xy, mut xz, mut yy, mut yz, mut zz] = *b;
    let mut u = IDENTITY;
    for _ in 0..SWEEPS {
        let off = xy * xy + xz * xz + yz * yz;
        if off < 1e-14 * (xx * xx + yy * yy + zz * zz) {
            break;
        }
        rotate::<0, 1>(&mut xx, &mut yy, &mut xy, &mut xz, &mut yz, &mut u);
        rotate::<0, 2>(&mut xx, &mut zz, &mut xz, &mut xy, &mut yz, &mut u);
        rotate::<1, 2>(&mut yy, &mut zz, &mut yz, &mut xy, &mut xz, &mut u);
    }
    ([xx, yy, zz], u)
}

/// Makes the entry `pq` zero; `rp` and `rq` are the other two entries off the diagonal.
#[inline(always)]
fn rotate<const P: usize, const Q: usize>(
    pp: &mut f32,
    qq: &mut f32,
    pq: &mut f32,
    rp: &mut f32,
    rq: &mut f32,
    u: &mut Matrix,
) {
    // tan of the smaller angle; written so that equal diagonals need no case of their own.
    let difference = 0.5 * (*qq - *pp);
    let root = difference.mul_add(difference, *pq * *pq).sqrt();
    let t = *pq / (difference + root.copysign(difference) + f32::MIN_POSITIVE);
    let c = 1.0 / t.mul_add(t, 1.0).sqrt();
    let s = c * t;
    *pp -= t * *pq;
    *qq += t * *pq;
    *pq = 0.0;
    (*rp, *rq) = (c * *rp - s * *rq, s * *rp + c * *rq);
    for r in 0..3 {
        let (p, q) = (u[3 * r + P], u[3 * r + Q]);
        u[3 * r + P] = c * p - s * q;
        u[3 * r + Q] = s * p + c * q;
    }
}
