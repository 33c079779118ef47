//! What can be taken away from a recording: splat files, an animated scene, pictures and a film.
//!
//! In reading order: a [`reel`] is a run of a recording, step by step; [`film`] draws it. [`shapes`] gives back the axes and
//! scales of Gaussians, of which a frame has covariances, and [`harmonics`] turns their colours with them; [`ply`],
//! [`glb`] and [`usd`] write both.

mod error;
pub mod film;
pub mod glb;
pub mod harmonics;
pub mod ply;
pub mod reel;
pub mod shapes;
pub mod usd;

pub use error::ExportError;
