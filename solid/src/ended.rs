//! What acted on solids where a span ended. Velocities come level with positions there, and nothing has moved when the next span
//! begins: what depends on places alone is found once for both.

use crate::ledger::Ledger;

/// What acted on a solid where its latest span ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Ended {
    /// All that moved together, by the numbers of objects.
    pub group: Vec<usize>,
    /// What contact gave them; nothing but with the first of them.
    pub given: Ledger,
    /// How long it acted [s].
    pub kick: f64,
    /// Forces on nodes throughout the span, over the squared cell size [Pa].
    pub steady: Vec<(usize, [f32; 3])>,
    /// Regions that held faces of it, with their velocities [m/s].
    pub faces: Vec<(usize, [f64; 3])>,
}
