//! Controller client: commands to a running simulation, with acknowledgements.

mod controller;
pub mod order;
pub mod script;

pub use controller::{Answer, ControlError, Controller};
