//! What substeps cost.

use std::time::Instant;

use crate::report::{Timings, Work};

/// Time and operations of a frame, those taken back included.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Wall time per phase.
    pub timings: Timings,
    /// Operations.
    pub work: Work,
}

/// Adds the wall time of a phase to a sum [s].
pub(crate) fn timed<T>(sum: &mut f64, phase: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = phase();
    *sum += start.elapsed().as_secs_f64();
    result
}
