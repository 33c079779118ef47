//! Recordings run again. The one place where the solver and a recording meet.
//!
//! [`walk`] divides a recording into the runs of its servers, `outlook` finds where they can be taken up. [`survey`] counts what they hold; [`rerun`] simulates one of
//! them again; [`verify`](mod@verify) compares every step; [`branch`] goes on from one; [`player`] publishes what was
//! recorded as a session. Nothing here prints.

pub mod branch;
mod differences;
mod error;
mod outlook;
pub mod player;
pub mod rerun;
pub mod survey;
pub mod verify;
pub mod walk;

pub use error::ReplayError;
