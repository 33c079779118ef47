//! How a command prints, shows how far it is, reads times, sizes and numbers of threads, and stops when asked to.

pub mod output;
pub mod progress;
pub mod seconds;
pub mod signals;
pub mod size;
pub mod threads;
