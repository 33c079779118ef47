//! Laws and reference pictures of the rasteriser.

mod golden;
mod laws;
mod reference;
mod scenes;
