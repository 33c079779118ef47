//! `hello`: who serves a session, readable by clients of every wire version.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::{
    WIRE_VERSION, schema_hash,
    text::{TextError, padded, str_from_padded},
};

/// Who serves the session. Service and type name carry no version, and this layout never changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.Hello")]
#[repr(C)]
pub struct Hello {
    /// The server's [`WIRE_VERSION`].
    pub wire_version: u32,
    /// The server's process id.
    pub pid: u32,
    /// Hash of the server's layout table.
    pub schema_hash: u64,
    /// Grows with every start of a server.
    pub epoch: u64,
    /// Release of the server, UTF-8, zero-padded.
    pub server_version: [u8; 24],
    /// First step of the recording that the server replays; 0 where it simulates.
    pub recorded_first: u64,
    /// Last step of that recording; 0 where it simulates.
    pub recorded_last: u64,
}

impl Hello {
    /// This program as the server of a run identified by `epoch`.
    pub fn of_this_program(epoch: u64) -> Self {
        Self {
            wire_version: WIRE_VERSION,
            pid: std::process::id(),
            schema_hash: schema_hash(),
            epoch,
            server_version: padded(env!("CARGO_PKG_VERSION")),
            recorded_first: 0,
            recorded_last: 0,
        }
    }

    /// Release of the server.
    pub fn server_version(&self) -> Result<&str, TextError> {
        str_from_padded(&self.server_version)
    }
}
