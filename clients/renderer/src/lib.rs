//! Renderer client: pictures of the shared frame by the rasteriser of `cosplat-raster`, PNG and MP4 out.
//!
//! In reading order: [`camera`] says where the picture is taken from, [`sh`] gives a Gaussian its colour in that
//! direction, [`raster`] blends the Gaussians; [`path`] has the camera go somewhere, [`drawing`] hands the pictures to [`png`](mod@png) and [`mp4`], and
//! [`client`] takes the frames of a running session.

pub mod client;
mod courtesy;
pub mod drawing;
mod idle;
pub mod image;
pub mod mp4;
mod output;
mod painter;
pub mod path;
pub mod png;
pub mod raster;
mod shade;
mod source;
mod taker;

pub use client::run;
pub use cosplat_raster::{
    camera::{self, Camera},
    sh::{self, Harmonics},
};
pub use image::Image;
pub use raster::{Picked, Projected, pick, picture, project};

#[cfg(test)]
mod tests;
