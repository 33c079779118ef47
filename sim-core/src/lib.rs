//! Material-point solver of cosplat: a [`Scene`] of typed constants, and the [`World`] that steps it.
//!
//! This crate knows no file format and no transport, opens no file and prints nothing.

#![allow(
    unsafe_code,
    reason = "vector instructions, and particles that threads share by index"
)]

mod bodies;
mod coherence;
mod colliders;
pub mod command;
mod contact;
mod contact_com;
pub mod distance;
pub mod expression;
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
pub mod simd;
mod step;
#[cfg(test)]
mod test_scenes;
mod world;

pub use command::{Action, Command, CommandError};
pub use reference::ReferenceWorld;
pub use report::{ContactEpisode, DtLimit, ObjectState, StepReport, Work};
pub use scene::Scene;
pub use simd::Isa;
pub use world::{CheckpointError, World, WorldError};
