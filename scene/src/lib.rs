//! Scene text and splat assets of cosplat: files to the [`Scene`](cosplat_sim_core::Scene) that the solver steps.
//!
//! Reading order is execution order: an asset is read, a scene file is parsed, objects are filled with particles and
//! Gaussians bound to them; a summary and a diagram tell what came of it.
//! Bytes are given to this crate by its caller: it opens no file, prints nothing, and knows nothing of time.

pub mod assets;
pub mod binding;
pub mod diagram;
pub mod fill;
pub mod scene_file;
pub mod summary;
