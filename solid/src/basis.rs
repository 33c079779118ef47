//! Quadratic B-splines on the object's own grid.

/// Weights and slopes [1/cell] along one axis of the nodes -1, 0, 1 about the nearest one, for a point `d` beyond it [cells],
/// at most half a cell away.
pub(crate) fn weights_f64(d: f64) -> ([f64; 3], [f64; 3]) {
    let (l, r) = (0.5 - d, 0.5 + d);
    ([0.5 * l * l, 0.75 - d * d, 0.5 * r * r], [-l, -2.0 * d, r])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_reproduce_linear_fields() {
        for n in 0..=20 {
            let d = n as f64 / 20.0 - 0.5;
            let (w, g) = weights_f64(d);
            let at = |k: usize| k as f64 - 1.0;
            let sum =
                |c: [f64; 3], power: i32| -> f64 { (0..3).map(|k| c[k] * at(k).powi(power)).sum() };
            // Round-off of a few terms of order 1.
            assert!((sum(w, 0) - 1.0).abs() < 1e-15 && (sum(w, 1) - d).abs() < 1e-15);
            assert!(sum(g, 0).abs() < 1e-15 && (sum(g, 1) - 1.0).abs() < 1e-15);
        }
    }
}
