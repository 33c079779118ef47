//! Radii of particles: half the edge of a cube of their volume at rest.

use crate::num::cube_root;

/// Largest radius of a particle [cells].
pub(super) const LARGEST_RADIUS: f64 = 0.5;

/// Radii of the particles of a part [cells].
pub(super) struct Radii {
    /// Of one unit of mass at rest [cells].
    volume: f64,
    /// The last mass that was asked for, and its radius: neighbours mostly have the same.
    known: (f32, f64),
}

impl Radii {
    /// Of a part of which one unit of mass has this volume at rest [cells].
    pub fn new(volume: f64) -> Self {
        Self {
            volume,
            known: (0.0, 0.0),
        }
    }

    /// That of a particle with a mass above 0.
    #[inline]
    pub fn of(&mut self, mass: f32) -> f64 {
        if self.known.0 != mass {
            self.known = (mass, radius_of(self.volume * f64::from(mass)));
        }
        self.known.1
    }
}

/// Half the edge of a cube of this volume [cells].
fn radius_of(volume: f64) -> f64 {
    if volume >= (2.0 * LARGEST_RADIUS).powi(3) {
        return LARGEST_RADIUS;
    }
    0.5 * cube_root(volume)
}
