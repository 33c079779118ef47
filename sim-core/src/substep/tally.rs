//! What substeps cost.

use std::time::Instant;

use super::limit::Limit;
use crate::report::{Timings, Work};

/// Time and operations of a frame, those taken back included.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Wall time per phase.
    pub timings: Timings,
    /// Operations.
    pub work: Work,
    /// What moving solids came to.
    pub solids: Moved,
}

/// What moving solids came to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moved {
    /// Substeps of the one that took most.
    pub substeps: u64,
    /// The smallest substep, where there is more than one.
    pub limit: Limit,
    /// Spans that were undone.
    pub rollbacks: u32,
}

impl Default for Moved {
    fn default() -> Self {
        Self {
            substeps: 0,
            limit: Limit::FRAME,
            rollbacks: 0,
        }
    }
}

/// Adds the wall time of a phase to a sum [s].
pub(crate) fn timed<T>(sum: &mut f64, phase: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = phase();
    *sum += start.elapsed().as_secs_f64();
    result
}
