//! Material-point solver, scenes and splat assets of cosplat.
//!
//! Reading order is execution order: an asset is read, a scene file is parsed, objects are filled with
//! particles and Gaussians bound to them, and the [`World`] steps them.
//! This crate knows no transport, opens no file and prints nothing.

pub mod assets;
pub mod binding;
mod bodies;
mod coherence;
mod colliders;
pub mod command;
mod contact;
mod contact_com;
pub mod diagram;
pub mod expression;
pub mod fill;
mod grid;
pub mod kinematics;
pub mod mat3;
pub mod materials;
pub mod moments;
pub mod notices;
pub mod num;
mod particles;
pub mod pose;
pub mod probe;
pub mod reference;
pub mod report;
pub mod scene;
pub mod scene_file;
pub mod simd;
mod step;
pub mod summary;
#[cfg(test)]
mod test_scenes;
mod world;

pub use command::{Action, Command, CommandError};
pub use reference::ReferenceWorld;
pub use report::{ContactEpisode, DtLimit, ObjectState, StepReport, Work};
pub use scene::Scene;
pub use simd::Isa;
pub use world::{CheckpointError, World, WorldError};
