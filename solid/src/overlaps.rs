//! What points of a solid were put into, as a solid keeps it: `overlap.rs` says how it goes on.

use serde::{Deserialize, Serialize};

/// A point of a solid that was put into something.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// Its number.
    pub point: u32,
    /// What it is in, as a [`Grip`] names it.
    pub with: u32,
    /// Depth up to which that does not press on it [m].
    pub depth: f64,
    /// How fast that gets less [m/s].
    pub speed: f64,
}

/// All such points of a solid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Overlaps {
    /// Whether they have yet to be looked for: the solid was put where it is.
    pub are_due: bool,
    /// By point, then by what it is in.
    pub all: Vec<Overlap>,
}

impl Overlaps {
    /// Of a solid that was put where it is.
    pub const DUE: Self = Self {
        are_due: true,
        all: vec![],
    };

    /// Depth up to which something does not press on a point [m].
    #[inline(always)]
    pub fn depth(&self, point: usize, with: u32) -> f64 {
        if self.all.is_empty() {
            return 0.0;
        }
        let place = |one: &Overlap| (one.point, one.with);
        let found = self.all.binary_search_by_key(&(point as u32, with), place);
        found.map_or(0.0, |n| self.all[n].depth)
    }

    /// Whether they are of so many points, in order, and depths are lengths.
    pub fn are_sound(&self, points: usize) -> bool {
        let place = |one: &Overlap| (one.point, one.with);
        let is_sound = |one: &Overlap| {
            let numbers = [one.depth, one.speed];
            let are_sound = numbers.iter().all(|x| x.is_finite() && *x >= 0.0);
            (one.point as usize) < points && are_sound
        };
        self.all.iter().all(is_sound) && self.all.is_sorted_by(|a, b| place(a) < place(b))
    }
}
