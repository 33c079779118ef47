//! Rotations: unit quaternions, scalar last, and rotation vectors.

use crate::mat3::{Mat3, cross, dot};

/// No rotation.
pub const IDENTITY: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

/// Rotation of a vector by a unit quaternion xyzw; exact for the identity.
#[inline]
pub fn rotate([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let q = [x, y, z];
    let t = cross(q, v);
    let s = cross(q, std::array::from_fn(|a| t[a] + w * v[a]));
    std::array::from_fn(|a| v[a] + 2.0 * s[a])
}

/// Inverse of a unit quaternion.
#[inline]
pub fn conjugate([x, y, z, w]: [f64; 4]) -> [f64; 4] {
    [-x, -y, -z, w]
}

/// The rotation `b` followed by `a`, normalised.
#[inline]
pub fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let (u, v) = ([a[0], a[1], a[2]], [b[0], b[1], b[2]]);
    let c = cross(u, v);
    let q = [
        a[3] * v[0] + b[3] * u[0] + c[0],
        a[3] * v[1] + b[3] * u[1] + c[1],
        a[3] * v[2] + b[3] * u[2] + c[2],
        a[3] * b[3] - dot(u, v),
    ];
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / length)
}

/// The rotation by `|r|` about `r` [rad].
#[inline]
pub fn from_rotation_vector(r: [f64; 3]) -> [f64; 4] {
    let angle = dot(r, r).sqrt();
    if angle == 0.0 {
        return IDENTITY;
    }
    let (s, c) = (0.5 * angle).sin_cos();
    [s * r[0] / angle, s * r[1] / angle, s * r[2] / angle, c]
}

/// The shorter rotation vector of a unit quaternion [rad].
#[inline]
pub fn rotation_vector([x, y, z, w]: [f64; 4]) -> [f64; 3] {
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    let s = dot([x, y, z], [x, y, z]).sqrt();
    if s == 0.0 {
        return [0.0; 3];
    }
    let factor = sign * 2.0 * s.atan2(sign * w) / s;
    [factor * x, factor * y, factor * z]
}

/// Unit quaternion xyzw of a rotation matrix, `w >= 0` (Shepperd 1978).
#[inline]
pub fn quaternion(r: &Mat3<f64>) -> [f64; 4] {
    let m = r.0;
    let trace = m[0][0] + m[1][1] + m[2][2];
    // Four times the square of each component; dividing by the largest loses no digits.
    let squares = [
        1.0 + 2.0 * m[0][0] - trace,
        1.0 + 2.0 * m[1][1] - trace,
        1.0 + 2.0 * m[2][2] - trace,
        1.0 + trace,
    ];
    let (x, y, z) = (m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]);
    let (xy, xz, yz) = (m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]);
    let largest = (0..4)
        .max_by(|&a, &b| squares[a].total_cmp(&squares[b]))
        .unwrap_or(3);
    let q = [
        [squares[0], xy, xz, x],
        [xy, squares[1], yz, y],
        [xz, yz, squares[2], z],
        [x, y, z, squares[3]],
    ][largest];
    let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let sign = if q[3] < 0.0 { -1.0 } else { 1.0 };
    q.map(|c| sign * c / norm)
}
