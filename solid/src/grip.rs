//! What a surface point holds on to while it sticks.

use serde::{Deserialize, Serialize};

use super::penalty::Account;
use crate::mat3::dot;

/// Nothing is touched.
pub(super) const NOTHING: u32 = u32::MAX;
/// From here on numbers of springs are those of objects, and before those of colliders.
pub(super) const OBJECTS: u32 = 1 << 31;

/// From here on numbers are those of held regions, the last first.
const REGIONS: u32 = NOTHING - (1 << 16);

/// What a solid is in contact with, each of more consequence than those before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ContactWith {
    /// Nothing.
    #[default]
    Nothing,
    /// Colliders, which do not give way.
    Walls,
    /// Other objects.
    Objects,
}

/// The tangential spring of a point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grip {
    /// What it holds on to: a collider by its number, an object by [`on_object`](Self::on_object), a held region by
    /// [`on_region`](Self::on_region), or nothing.
    pub with: u32,
    /// How much it is stretched [m].
    pub stretch: [f64; 3],
    /// What the contact holds, pressed in and stretched [J].
    pub energy: f64,
    /// Normal force [N].
    pub pressure: f64,
}

impl Grip {
    /// What a grip on a held region of the scene holds on to, by its number.
    pub fn on_region(number: usize) -> u32 {
        NOTHING - 1 - number as u32
    }

    /// What a grip on an object holds on to.
    pub fn on_object(id: usize) -> u32 {
        OBJECTS + id as u32
    }

    /// What it took in along the normal and has not given back, by a spring of some stiffness [N/m].
    pub fn account(&self, stiffness: f64) -> Account {
        Account {
            energy: self.energy - 0.5 * stiffness * dot(self.stretch, self.stretch),
            pressure: self.pressure,
        }
    }

    /// Whether it holds on to a held region.
    pub fn is_on_region(&self) -> bool {
        (REGIONS..NOTHING).contains(&self.with)
    }

    /// What presses on the point, by what the contact holds.
    pub fn contact(&self) -> ContactWith {
        match (self.pressure != 0.0, self.with < OBJECTS) {
            (false, _) => ContactWith::Nothing,
            (true, true) => ContactWith::Walls,
            (true, false) => ContactWith::Objects,
        }
    }

    /// No contact.
    pub const NONE: Self = Self {
        with: NOTHING,
        stretch: [0.0; 3],
        energy: 0.0,
        pressure: 0.0,
    };
}
