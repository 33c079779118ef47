//! Material-point solver of cosplat: a [`Scene`] of typed constants, and the [`World`] that steps it.
//!
//! A frame, [`World::step`]: commands, model levels, segments of substeps, report. One substep, `substep.rs`:
//!
//! 1. P2G: particles give mass and momentum to tiles (`step`).
//! 2. Grid pass: tiles to velocities, gravity, boundary conditions (`grid`, `colliders`).
//! 3. Contact between the fields of objects (`contact`).
//! 4. Rigid bodies: at nodes, at each other, at colliders (`bodies`).
//! 5. G2P: nodes give velocities to particles, which move and deform; their laws answer (`step`, [`materials`]).
//! 6. Guard: what breaks a bound is undone and taken again with less `dt` (`substep`).
//!
//! This crate knows no file format and no transport, opens no file and prints nothing.

#![allow(
    unsafe_code,
    reason = "vector instructions, and particles that threads share by index"
)]

mod bodies;
mod coherence;
pub mod colliders;
pub mod command;
mod contact;
mod contact_com;
mod coupling;
pub mod distance;
pub mod expression;
mod grid;
pub mod kinematics;
pub mod mat3;
pub mod materials;
mod model;
pub mod moments;
pub mod notices;
pub mod num;
mod particles;
pub mod pose;
pub mod probe;
pub mod report;
pub mod rotation;
pub mod scene;
pub mod simd;
mod solid;
mod state;
mod step;
mod substep;
pub mod test_scenes;
mod world;

pub use command::{Action, Command, CommandError, HoldChange, Patch, Place};
pub use report::{Contact, ContactEpisode, ContactPartner, DtLimit, ObjectState, StepReport, Work};
pub use scene::Scene;
pub use simd::Isa;
pub use solid::vibrating::VibratingBlock;
pub use world::{CheckpointError, Form, Placed, Visible, World, WorldError};
