//! Scene text and splat assets of cosplat: files to the [`Scene`](cosplat_sim_core::Scene) that the solver steps.
//!
//! Reading order is execution order: an asset is read, a scene file is parsed, objects are filled with particles and
//! Gaussians bound to them; a summary and a diagram tell what came of it.
//! [`load`] alone opens files, as [`reading`](cosplat_files::reading) does; nothing here prints, and nothing knows how a scene is stepped.

pub mod assets;
pub mod binding;
mod bounds;
mod components;
pub mod diagram;
pub mod fill;
mod floaters;
pub mod load;
pub mod materials;
pub mod neighbours;
pub mod scene_file;
pub mod settings;
pub mod sources;
pub mod summary;
