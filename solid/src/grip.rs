//! What a surface point holds on to while it sticks.

use serde::{Deserialize, Serialize};

/// Nothing is touched.
pub(super) const NOTHING: u32 = u32::MAX;
/// From here on numbers of springs are those of objects, and before those of colliders.
pub(super) const OBJECTS: u32 = 1 << 31;

/// From here on numbers are those of held regions, the last first.
const REGIONS: u32 = NOTHING - (1 << 16);

/// What a solid may come in contact with in a span of time. Its substeps are for that from the first on: where they change with contact,
/// leapfrog feeds the fastest motions, whatever contact itself does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    /// What the contact holds, pressed in and stretched [J]. Less than nothing where it gave more than it took, which the next contact keeps.
    pub energy: f64,
    /// Normal force [N].
    pub pressure: f64,
    /// How deep it is in a collider or a body, beyond the depth that it was put in with [m].
    pub depth: f64,
    /// Outward normal of the face of a thin collider that it came through; zero of others.
    pub side: [f32; 3],
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

    /// Whether it holds on to a held region.
    pub fn is_on_region(&self) -> bool {
        (REGIONS..NOTHING).contains(&self.with)
    }

    /// No contact.
    pub const NONE: Self = Self {
        with: NOTHING,
        stretch: [0.0; 3],
        energy: 0.0,
        pressure: 0.0,
        depth: 0.0,
        side: [0.0; 3],
    };

    /// No contact, after one that gave back more than it took by so much [J].
    pub fn parted(debt: f64) -> Self {
        Self {
            energy: -debt,
            ..Self::NONE
        }
    }
}
