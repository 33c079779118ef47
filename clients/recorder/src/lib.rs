//! Recorder client: every published step into an MCAP file, and the way back.
//!
//! Reading order: what a message looks like ([`messages`], [`point_cloud`], [`ply`]), how a file is written
//! ([`writer`]), read ([`reader`], from any place on with [`chunks`]), played in any order with [`tape`], understood
//! ([`runs`]) and repaired ([`recover`](mod@recover)), and the process that does it live ([`client`]). The file format is `docs/recording-format.md`.

mod checkpoints;
mod chunk_records;
pub mod chunks;
pub mod client;
pub mod compact;
mod decoder;
mod error;
mod file_records;
pub mod files;
mod kept;
mod latency;
pub mod messages;
mod packed;
pub mod parts;
mod pipeline;
pub mod ply;
pub mod point_cloud;
pub mod reader;
mod records;
pub mod recover;
pub mod runs;
mod segments;
mod source;
pub mod tape;
mod time_line;
pub mod topics;
mod write_behind;
pub mod writer;

pub use error::{Damage, RecordingError};
