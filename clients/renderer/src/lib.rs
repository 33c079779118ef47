//! Renderer client: a CPU tile rasteriser over the shared frame, PNG and MP4 out.
//!
//! In reading order: [`camera`] says where the picture is taken from, [`sh`] gives a Gaussian its colour in that
//! direction, [`project`] turns it into an ellipse in pixels, [`raster`] sorts and blends the ellipses; [`client`] does
//! so for the frames of a running session and hands the pictures to [`png`](mod@png) and [`mp4`].

#![allow(unsafe_code, reason = "vector instructions")]

pub mod camera;
pub mod client;
mod courtesy;
pub mod image;
pub mod mp4;
mod output;
pub mod png;
pub mod project;
pub mod raster;
pub mod sh;
mod source;
mod tile;

pub use camera::Camera;
pub use client::run;
pub use image::Image;
pub use raster::{Projected, picture};
pub use sh::Harmonics;

#[cfg(test)]
mod tests;
