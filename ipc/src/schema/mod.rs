//! The wire contract, version 1: fixed-layout types that cross process borders.
//!
//! Normative text and offset table: `docs/wire-format.md`. Every type is an array of primitives, `#[repr(C)]`
//! without padding, little-endian, reserved bytes zero.

mod changes;
mod command;
mod contacts;
mod frame;
mod hello;
mod layout;
mod objects;
mod scene;
mod status;
mod step;
mod text;

pub use changes::*;
pub use command::*;
pub use contacts::*;
pub use frame::*;
pub use hello::*;
pub use layout::*;
pub use objects::*;
pub use scene::*;
pub use status::*;
pub use step::*;
pub use text::*;

/// Major version of the wire contract; part of every service and type name.
pub const WIRE_VERSION: u32 = 1;
