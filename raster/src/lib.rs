//! CPU tile rasteriser: what of every Gaussian shows at every pixel of a camera.
//!
//! In reading order: [`camera`] says where the picture is taken from, [`ellipse`] projects a Gaussian to an ellipse in
//! pixels, [`splats`] sorts the ellipses into tiles, [`tile`] blends them front to back and hands the weights to a
//! [`Sink`]. A renderer sums colours with them, a lifter sums what pixels say about each Gaussian. [`sh`] gives a Gaussian
//! its colour in a direction; [`composite`](mod@composite) draws any values, and [`adjoint`](mod@adjoint) takes gradients
//! of such a picture back to the Gaussians.

#![allow(unsafe_code, reason = "vector instructions")]

pub mod adjoint;
pub mod camera;
pub mod composite;
pub mod ellipse;
pub mod pick;
pub mod sh;
pub mod splats;
pub mod tile;

pub use adjoint::{Adjoint, ScreenGradient, SpatialGradient, adjoint};
pub use camera::Camera;
pub use composite::{Picture, composite};
pub use ellipse::{Ellipse, Projection};
pub use sh::Harmonics;
pub use splats::Splats;
pub use tile::{Row, SIZE, Sink};

#[cfg(test)]
mod tests;
