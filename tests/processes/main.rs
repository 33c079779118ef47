//! Stories across processes: real servers and clients, killed, restarted, starved and misled.

mod attach;
mod checkpoint;
mod commands;
mod crashes;
mod demo;
mod output;
mod python;
mod recording;
mod restart;
mod shutdown;
mod stage;
