//! Quadratic B-splines at two points of a cell, along one axis, and the transposes.
//!
//! The points of a cell are at `-S` and `+S` from its centre node [dx], those of Gauss. With the values `l c r` of the three nodes,
//! `s = l + r`, `t = r - l` and `q = s - 2 c`, the spline at `+-S` is `c + a q +- e t` with `a = 1/8 + S^2/2` and `e = S/2`, and twice
//! its slope is `t +- g q` with `g = 2 S`.

use crate::{mat3::Mat3, simd::Lanes};

/// Distance of the points from the middle of their cell [dx]: those of Gauss, `1 / sqrt(12)`.
pub(super) const S: f64 = 0.288_675_134_594_812_9;

/// The numbers of the rule, in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Rule<V> {
    a: V,
    e: V,
    g: V,
    minus_two: V,
    /// Deformation gradient at rest over the axes of the grid: those axes as columns.
    pub rest: Mat3<V>,
    /// Whether these are not those of the world.
    is_turned: bool,
}

impl<V: Lanes> Rule<V> {
    #[inline(always)]
    pub fn new(axes: &Mat3<f32>) -> Self {
        Self {
            rest: Mat3(axes.0.map(|row| row.map(V::broadcast))),
            is_turned: *axes != Mat3::identity(),
            a: V::splat(0.125 + 0.5 * S * S),
            e: V::splat(0.5 * S),
            g: V::splat(2.0 * S),
            minus_two: V::splat(-2.0),
        }
    }

    /// Axes of the grid, where they are not those of the world.
    #[inline(always)]
    pub fn axes(&self) -> Option<&Mat3<V>> {
        self.is_turned.then_some(&self.rest)
    }

    /// Values at `-S` and `+S`.
    #[inline(always)]
    pub fn values(&self, [l, c, r]: [V; 3]) -> [V; 2] {
        let (s, t) = (l + r, r - l);
        let middle = self.minus_two.mul_add(c, s).mul_add(self.a, c);
        let step = self.e * t;
        [middle - step, middle + step]
    }

    /// Twice the slopes at `-S` and `+S`.
    #[inline(always)]
    pub fn slopes(&self, [l, c, r]: [V; 3]) -> [V; 2] {
        let (s, t) = (l + r, r - l);
        let bend = self.minus_two.mul_add(c, s) * self.g;
        [t - bend, t + bend]
    }

    /// Values and twice the slopes.
    #[inline(always)]
    pub fn both(&self, [l, c, r]: [V; 3]) -> ([V; 2], [V; 2]) {
        let (s, t) = (l + r, r - l);
        let q = self.minus_two.mul_add(c, s);
        let middle = q.mul_add(self.a, c);
        let (step, bend) = (self.e * t, self.g * q);
        ([middle - step, middle + step], [t - bend, t + bend])
    }

    /// Transpose of [`values`](Self::values).
    #[inline(always)]
    pub fn values_transposed(&self, [p, n]: [V; 2]) -> [V; 3] {
        let (sum, difference) = (n + p, n - p);
        let (side, step) = (self.a * sum, self.e * difference);
        [side - step, self.minus_two.mul_add(side, sum), side + step]
    }

    /// Transpose of [`slopes`](Self::slopes).
    #[inline(always)]
    pub fn slopes_transposed(&self, [p, n]: [V; 2]) -> [V; 3] {
        let (sum, bend) = (n + p, self.g * (n - p));
        [bend - sum, self.minus_two * bend, bend + sum]
    }

    /// Sum of the transposes of [`both`](Self::both).
    #[inline(always)]
    pub fn both_transposed(&self, [p, n]: [V; 2], [dp, dn]: [V; 2]) -> [V; 3] {
        let (sum, difference) = (n + p, n - p);
        let side = self.g.mul_add(dn - dp, self.a * sum);
        let step = self.e.mul_add(difference, dn + dp);
        [side - step, self.minus_two.mul_add(side, sum), side + step]
    }
}
