//! Quantiles of samples.

/// Value below which a part of all lies, the nearest sample; not a number where there are none.
pub fn quantile(mut values: Vec<f64>, part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    let at = (last as f64 * part).round() as usize;
    values.get(at).copied().unwrap_or(f64::NAN)
}

/// Median and 99 % of samples, in their unit.
#[derive(Clone, Copy, serde::Serialize)]
pub struct Quantiles {
    pub p50: f64,
    pub p99: f64,
}

impl Quantiles {
    pub fn of(values: Vec<f64>) -> Self {
        Self {
            p50: quantile(values.clone(), 0.5),
            p99: quantile(values, 0.99),
        }
    }
}
