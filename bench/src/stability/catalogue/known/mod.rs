//! The cases of the catalogue: scenes whose right value is a formula, a law of conservation, or what anyone sees.

mod bodies;
mod matter;
mod walls;

use super::cases::Case;

/// All of them; the first two take no time.
pub fn all() -> impl Iterator<Item = &'static Case> {
    matter::ALL.iter().chain(&walls::ALL).chain(&bodies::ALL)
}
