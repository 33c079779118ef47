//! The cases.

mod contact;
mod elastic;
mod fidelity;
mod flow;

use super::case::Case;

/// All of them.
pub const ALL: [&Case; 9] = [
    &elastic::BAR,
    &elastic::SPIN,
    &elastic::CANTILEVER,
    &contact::ROLLING,
    &contact::SPHERES,
    &contact::BOUNCE,
    &flow::DAM_BREAK,
    &flow::SAND,
    &fidelity::VASES,
];
