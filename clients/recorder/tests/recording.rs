//! Stories about recordings: written, read back, cut off, damaged, repaired, read by others.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, where a panic is the message"
)]

mod recording {
    pub mod damage;
    pub mod elsewhere;
    pub mod killed;
    pub mod live;
    pub mod moved;
    pub mod older;
    pub mod parted;
    pub mod played;
    pub mod read_back;
    pub mod synthetic;
}
