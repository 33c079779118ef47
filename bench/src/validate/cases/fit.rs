//! What several cases make of their series: orders of convergence, periods.

/// Order between two errors at two sizes.
pub fn order(coarse: (f64, f64), fine: (f64, f64)) -> f64 {
    (coarse.1 / fine.1).ln() / (coarse.0 / fine.0).ln()
}

/// Moments at which a series (time, value) passes zero, between samples by straight lines.
pub fn zeros(series: &[(f64, f64)]) -> Vec<f64> {
    let crossing = |w: &[(f64, f64)]| {
        let ((t0, y0), (t1, y1)) = (w[0], w[1]);
        (y0 * y1 < 0.0).then(|| t0 + (t1 - t0) * y0 / (y0 - y1))
    };
    series.windows(2).filter_map(crossing).collect()
}

/// Period of an oscillation about zero: twice the mean distance of its zeros.
pub fn period(series: &[(f64, f64)]) -> f64 {
    match zeros(series).as_slice() {
        [first, .., last] => 2.0 * (last - first) / (zeros(series).len() - 1) as f64,
        _ => f64::NAN,
    }
}

/// Moment at which a series first rises past a value, between samples by a straight line.
pub fn passes(series: &[(f64, f64)], value: f64) -> Option<f64> {
    series.windows(2).find_map(|w| {
        let ((t0, y0), (t1, y1)) = (w[0], w[1]);
        (y0 <= value && value < y1).then(|| t0 + (t1 - t0) * (value - y0) / (y1 - y0))
    })
}

/// Slope of the straight line of least squares through a series.
pub fn slope(series: &[(f64, f64)]) -> f64 {
    let n = series.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| series.iter().map(of).sum::<f64>() / n;
    let (t0, y0) = (mean(|p| p.0), mean(|p| p.1));
    let part = |of: &dyn Fn(&(f64, f64)) -> f64| series.iter().map(of).sum::<f64>();
    part(&|(t, y)| (t - t0) * (y - y0)) / part(&|(t, _)| (t - t0).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_has_its_period_and_a_parabola_its_order() {
        let wave = |n: u32| {
            let t = f64::from(n) * 0.1;
            (t, (t * 0.7).cos())
        };
        let series: Vec<_> = (0..1000).map(wave).collect();
        // Straight lines miss the zeros of a cosine by (0.07)^3 / 10 of a radian at most.
        assert!((period(&series) / (2.0 * std::f64::consts::PI / 0.7) - 1.0).abs() < 1e-5);
        assert!((slope(&[(0.0, 1.0), (1.0, -1.0), (3.0, -5.0)]) + 2.0).abs() < 1e-12);
        assert_eq!(
            passes(&[(0.0, -1.0), (1.0, 1.0), (2.0, 3.0)], 2.0),
            Some(1.5)
        );
        assert_eq!(passes(&[(0.0, -1.0), (1.0, 1.0)], 2.0), None);
        assert!((order((0.2, 0.08), (0.1, 0.02)) - 2.0).abs() < 1e-12);
    }
}
