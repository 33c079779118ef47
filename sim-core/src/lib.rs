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

mod coherence;
pub mod command;
mod contact;
mod contact_com;
pub mod cost;
mod coupling;
mod grid;
mod model;
pub mod moments;
pub mod notices;
mod particles;
pub mod pose;
pub mod probe;
pub mod report;
mod state;
mod step;
mod substep;
pub mod test_scenes;
mod world;

use cosplat_matter::timed::timed;
pub use cosplat_matter::{
    Scene, expression, kinematics, mat3, materials, num, rotation, scene,
    simd::{self, Isa},
};
use cosplat_rigid::{bodies, episodes, ledger, motion};

pub use cosplat_rigid::{
    colliders, distance,
    interruption::{self, Interruption},
};
use cosplat_solid as solid;

pub use command::{Action, Command, CommandError, HoldChange, Patch, Place};
pub use cosplat_solid::vibrating::VibratingBlock;
pub use report::{Contact, ContactEpisode, ContactPartner, DtLimit, ObjectState, StepReport, Work};
pub use world::{CheckpointError, Form, Placed, Visible, World, WorldError};
