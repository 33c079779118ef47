//! What several cases read from their runs: ends of series, periods, slopes.

use crate::trial::Outcome;

/// Period of an oscillation about zero: twice the mean distance of its zeros, between samples by straight lines.
pub fn period(series: &[(f64, f64)]) -> f64 {
    let crossing = |w: &[(f64, f64)]| {
        let ((t0, y0), (t1, y1)) = (w[0], w[1]);
        (y0 * y1 < 0.0).then(|| t0 + (t1 - t0) * y0 / (y0 - y1))
    };
    let zeros: Vec<f64> = series.windows(2).filter_map(crossing).collect();
    match zeros.as_slice() {
        [first, .., last] => 2.0 * (last - first) / (zeros.len() - 1) as f64,
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

/// First value of a series, not a number where there is none.
pub fn first(series: &[(f64, f64)]) -> f64 {
    series.first().map_or(f64::NAN, |p| p.1)
}

/// Largest value of a series, at least 0.
pub fn largest(series: &[(f64, f64)]) -> f64 {
    series.iter().fold(0.0, |a: f64, (_, value)| a.max(*value))
}

/// The value that a key has in the last frame, as a measure.
pub fn last(pointer: &'static str) -> impl Fn(&Outcome) -> anyhow::Result<f64> {
    move |run| run.last(pointer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_has_its_period_and_a_line_its_slope() {
        let wave = |n: u32| {
            let t = f64::from(n) * 0.1;
            (t, (t * 0.7).cos())
        };
        let series: Vec<_> = (0..1000).map(wave).collect();
        // Straight lines miss the zeros of a cosine by (0.07)^3 / 10 of a radian at most.
        assert!((period(&series) / (2.0 * std::f64::consts::PI / 0.7) - 1.0).abs() < 1e-5);
        assert!(period(&series[..2]).is_nan());
        assert!((slope(&[(0.0, 1.0), (1.0, -1.0), (3.0, -5.0)]) + 2.0).abs() < 1e-12);
        assert_eq!(
            passes(&[(0.0, -1.0), (1.0, 1.0), (2.0, 3.0)], 2.0),
            Some(1.5)
        );
        assert_eq!(passes(&[(0.0, -1.0), (1.0, 1.0)], 2.0), None);
    }
}
