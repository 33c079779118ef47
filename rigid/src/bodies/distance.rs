//! Distance of every node of a grid from a surface of triangles.

use super::{
    surface::Lattice,
    vector::{Vec3, along, sub},
};
use crate::mat3::dot;

/// No triangle yet.
const NONE: u32 = u32::MAX;

/// Squared distance of a point from a triangle (Ericson 2005, section 5.1.5).
fn to_triangle(p: Vec3, [a, b, c]: &[Vec3; 3]) -> f64 {
    let (ab, ac, ap) = (sub(*b, *a), sub(*c, *a), sub(p, *a));
    let to = |x: Vec3| {
        let d = sub(p, x);
        dot(d, d)
    };
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return to(*a);
    }
    let bp = sub(p, *b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return to(*b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return to(along(*a, d1 / (d1 - d3), ab));
    }
    let cp = sub(p, *c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return to(*c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return to(along(*a, d2 / (d2 - d6), ac));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let way = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return to(along(*b, way, sub(*c, *b)));
    }
    let scale = 1.0 / (va + vb + vc);
    to(along(along(*a, vb * scale, ab), vc * scale, ac))
}

/// Distance of every node [m]: exact next to the surface; farther off that from the nearest of the triangles that are
/// nearest to its neighbours, found by sweeps in all eight directions.
pub(super) fn distances(lattice: &Lattice, triangles: &[[Vec3; 3]]) -> Vec<f64> {
    let mut nearest = vec![(f64::INFINITY, NONE); lattice.len()];
    for (n, triangle) in (0..).zip(triangles) {
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let at = triangle.map(|x| (x[a] - lattice.origin[a]) / lattice.h);
            let low = at.into_iter().fold(f64::INFINITY, f64::min);
            let high = at.into_iter().fold(0.0, f64::max);
            first[a] = (low - 1.0).floor().max(0.0) as usize;
            last[a] = ((high + 1.0).ceil() as usize).min(lattice.size[a] - 1);
        }
        for i in first[0]..=last[0] {
            for j in first[1]..=last[1] {
                for k in first[2]..=last[2] {
                    let square = to_triangle(lattice.place([i, j, k]), triangle);
                    let at = &mut nearest[lattice.index([i, j, k])];
                    if square < at.0 {
                        *at = (square, n);
                    }
                }
            }
        }
    }
    for direction in 0..16 {
        sweep(lattice, triangles, direction % 8, &mut nearest);
    }
    nearest.iter().map(|(square, _)| square.sqrt()).collect()
}

/// Hands nearest triangles on, along axes in the directions that the three bits tell.
fn sweep(lattice: &Lattice, triangles: &[[Vec3; 3]], direction: usize, nearest: &mut [(f64, u32)]) {
    let size = lattice.size;
    let along = |n: usize, a: usize| match direction >> a & 1 {
        0 => n,
        _ => size[a] - 1 - n,
    };
    for i in 0..size[0] {
        for j in 0..size[1] {
            for k in 0..size[2] {
                let node = [along(i, 0), along(j, 1), along(k, 2)];
                let at = lattice.index(node);
                let behind = [i, j, k];
                for a in (0..3).filter(|&a| behind[a] > 0) {
                    let mut other = node;
                    other[a] = along(behind[a] - 1, a);
                    let triangle = nearest[lattice.index(other)].1;
                    if triangle == NONE || triangle == nearest[at].1 {
                        continue;
                    }
                    let square = to_triangle(lattice.place(node), &triangles[triangle as usize]);
                    if square < nearest[at].0 {
                        nearest[at] = (square, triangle);
                    }
                }
            }
        }
    }
}
