//! Wall time of phases.

use std::time::Instant;

/// Adds the wall time of a phase to a sum [s].
pub fn timed<T>(sum: &mut f64, phase: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = phase();
    *sum += start.elapsed().as_secs_f64();
    result
}
