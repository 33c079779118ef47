//! Quantiles of many latencies in little memory.

/// Steps per factor of two: a quantile is exact to 1/64.
const STEPS: u32 = 64;

/// Counts of latencies on a logarithmic scale.
pub(crate) struct Latencies {
    counts: Vec<u64>,
    total: u64,
}

impl Default for Latencies {
    fn default() -> Self {
        Self {
            counts: vec![0; (u64::BITS * STEPS) as usize],
            total: 0,
        }
    }
}

impl Latencies {
    /// Counts a latency [ns].
    pub(crate) fn add(&mut self, ns: u64) {
        let octave = ns.max(1).ilog2();
        // The bits below the leading one, as many as the scale resolves.
        let shift = octave.saturating_sub(STEPS.ilog2());
        let step = ((ns.max(1) >> shift) as u32) & (STEPS - 1);
        self.counts[(octave * STEPS + step) as usize] += 1;
        self.total += 1;
    }

    /// The latency [us] that a fraction `q` of all does not exceed; `None` without any.
    pub(crate) fn quantile_us(&self, q: f64) -> Option<f64> {
        let rank = ((self.total as f64 * q).ceil() as u64).max(1);
        let mut sum = 0;
        for (index, count) in self.counts.iter().enumerate() {
            sum += count;
            if sum >= rank {
                let (octave, step) = (index as u32 / STEPS, index as u32 % STEPS);
                let shift = octave.saturating_sub(STEPS.ilog2());
                let low = match octave >= STEPS.ilog2() {
                    true => u64::from(STEPS + step) << shift,
                    false => u64::from(step),
                };
                return Some(low as f64 / 1e3);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_exact_to_the_scale() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.quantile_us(0.5), None);
        (1..=100_000).for_each(|us| latencies.add(us * 1000));
        for (q, exact) in [(0.01, 1e3), (0.5, 5e4), (0.99, 9.9e4), (1.0, 1e5)] {
            let found = latencies.quantile_us(q).unwrap();
            assert!(
                found <= exact && found >= exact * (1.0 - 1.0 / f64::from(STEPS)),
                "{q}: {found}, exact {exact}"
            );
        }
        let mut extremes = Latencies::default();
        [0, 1, 63, u64::MAX]
            .into_iter()
            .for_each(|ns| extremes.add(ns));
        assert_eq!(extremes.quantile_us(0.5), Some(1e-3));
        assert_eq!(extremes.quantile_us(0.75), Some(63e-3));
        assert!(extremes.quantile_us(1.0).unwrap() > 1.8e16);
    }
}
