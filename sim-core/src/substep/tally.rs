//! What substeps cost.

use super::limit::Limit;
use crate::report::{ObjectCost, Timings, Work};

/// Time and operations of a frame, those taken back included.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    /// Wall time per phase.
    pub timings: Timings,
    /// Operations.
    pub work: Work,
    /// What objects cost that have substeps of their own; as many as were asked for.
    pub objects: Vec<ObjectCost>,
    /// What moving solids came to.
    pub solids: Moved,
}

impl Tally {
    /// What an object cost.
    pub fn of_object(&mut self, id: usize) -> &mut ObjectCost {
        if self.objects.len() <= id {
            self.objects.resize(id + 1, ObjectCost::default());
        }
        &mut self.objects[id]
    }
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
