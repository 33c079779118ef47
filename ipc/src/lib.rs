//! Wire types and iceoryx2 services of cosplat: everything a client needs, and nothing of the solver.
//!
//! Processes of a [`Domain`] see each other's sessions. A [`ServerPorts`] serves a session; a [`Client`]
//! attaches to it.

#![allow(
    unsafe_code,
    reason = "loans are filled in place, and services of dead nodes removed by name"
)]

pub mod assembly;
#[cfg(test)]
mod bindings;
pub mod client;
#[cfg(test)]
mod documentation;
mod domain;
mod limits;
mod management;
mod remains;
pub mod schema;
pub mod server;
mod session;
mod shm;
mod sweeper;

pub use client::Client;
pub use domain::{Domain, DomainError, MAX_ROOT_LENGTH};
pub use limits::LimitReached;

pub use server::ServerPorts;
pub use session::{BadSessionName, SessionInfo, list_sessions, session_name};

/// Ports are `Send` and `Sync`, so that a monitor thread can serve late joiners while a step runs.
pub(crate) type Service = iceoryx2::prelude::ipc_threadsafe::Service;

/// The release that both ends of a service must share.
pub(crate) const ICEORYX2_VERSION: &str = "0.10.0";

/// `CLOCK_MONOTONIC` [ns], the clock of `publish_ns` and `heartbeat_ns`.
pub fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}
