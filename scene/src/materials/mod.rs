//! Materials by name and in words: what scene files and orders say, and the solver need not know.

pub mod presets;
pub mod stated;
