//! Signed distance of a body's surface on a grid.

use std::collections::BTreeMap;

use super::{
    distance::distances,
    surface::{Lattice, Surface},
    vector::{Vec3, unit},
};
use crate::mat3::dot;

/// Distance grid in the body's frame [m].
#[derive(Clone, Debug)]
pub struct Field {
    lattice: Lattice,
    values: Vec<f64>,
}

impl Field {
    /// The distance from a surface, and points of that.
    pub fn new(surface: Surface) -> (Self, Vec<Vec3>) {
        let Surface {
            lattice,
            heights,
            triangles,
        } = surface;
        let signed = distances(&lattice, &triangles).into_iter().zip(&heights);
        let values = signed.map(|(distance, height)| match distance.is_finite() {
            true => distance.copysign(*height),
            false => height * lattice.h,
        });
        let values = values.collect();
        let points = thin(&triangles, &lattice);
        (Self { lattice, values }, points)
    }

    /// Distance between its nodes, and about that between the points of its surface [m].
    pub fn spacing(&self) -> f64 {
        self.lattice.h
    }

    /// Depth of the deepest node [m].
    pub fn depth(&self) -> f64 {
        -self.values.iter().copied().fold(0.0, f64::min)
    }

    /// Signed distance [m]; beyond the grid at most too large by the distance from it.
    pub fn distance(&self, x: Vec3) -> f64 {
        let Lattice { origin, h, size } = &self.lattice;
        let (mut cell, mut part, mut beyond) = ([0; 3], [0.0; 3], [0.0; 3]);
        for a in 0..3 {
            let last = (size[a] - 1) as f64;
            let at = (x[a] - origin[a]) / h;
            let inside = at.clamp(0.0, last);
            beyond[a] = (at - inside) * h;
            let low = inside.floor().min(last - 1.0);
            (cell[a], part[a]) = (low as usize, inside - low);
        }
        let [i, j, k] = cell;
        let [u, v, w] = part;
        let at = self.lattice.index([i, j, k]);
        let (x, y) = (size[1] * size[2], size[2]);
        let row = |n: usize| {
            let (a, b) = (self.values[n], self.values[n + 1]);
            a + w * (b - a)
        };
        let (near, far) = (
            row(at) + v * (row(at + y) - row(at)),
            row(at + x) + v * (row(at + x + y) - row(at + x)),
        );
        near + u * (far - near) + dot(beyond, beyond).sqrt()
    }

    /// Outward unit normal.
    pub fn normal(&self, x: Vec3) -> Vec3 {
        let step = 0.5 * self.lattice.h;
        let gradient = [0, 1, 2].map(|a| {
            let (mut low, mut high) = (x, x);
            low[a] -= step;
            high[a] += step;
            self.distance(high) - self.distance(low)
        });
        unit(gradient, unit(x, [0.0, 0.0, 1.0]))
    }
}

/// Of all corners of triangles the farthest from the origin per cell.
fn thin(triangles: &[[Vec3; 3]], lattice: &Lattice) -> Vec<Vec3> {
    let mut kept: BTreeMap<[i64; 3], (f64, Vec3)> = BTreeMap::new();
    for &x in triangles.iter().flatten() {
        let cell = [0, 1, 2].map(|a| ((x[a] - lattice.origin[a]) / lattice.h - 0.5).floor() as i64);
        let far = dot(x, x);
        let entry = kept.entry(cell).or_insert((far, x));
        if far > entry.0 {
            *entry = (far, x);
        }
    }
    kept.into_values().map(|(_, x)| x).collect()
}
