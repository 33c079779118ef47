//! Multirate: which objects take coarse substeps, and how many fine ones there are to one.

/// How an object takes substeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rate {
    /// Fine ones, as most do.
    Fine,
    /// Coarse ones, where nothing that takes fine ones is near.
    Isolated,
    /// Coarse ones, with velocities that stay on the grid in between and meet others there.
    Coupled,
}

/// The rates of all objects in a segment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Rates {
    /// Fine substeps to a coarse one; 1 where all are fine.
    pub per_coarse: u32,
    /// Per object; fine where there is none.
    of: Vec<Rate>,
}

impl Rates {
    /// Rates per object, with so many fine substeps to a coarse one.
    pub fn new(per_coarse: u32, of: Vec<Rate>) -> Self {
        Self { per_coarse, of }
    }

    /// All fine.
    pub fn fine() -> Self {
        Self::new(1, vec![])
    }

    /// The rate of an object.
    pub fn of(&self, object: usize) -> Rate {
        self.of.get(object).copied().unwrap_or(Rate::Fine)
    }

    /// Fine substeps to one of the object.
    pub fn substeps_of(&self, object: usize) -> f64 {
        match self.of(object) {
            Rate::Fine => 1.0,
            Rate::Isolated | Rate::Coupled => f64::from(self.per_coarse),
        }
    }
}
