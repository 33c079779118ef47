//! Stories across processes: real servers and clients, killed, restarted, starved and misled.

mod attach;
mod checkpoint;
mod commands;
mod crashes;
mod demo;
mod doctor;
mod lockstep;
mod output;
mod python;
mod recording;
mod replay;
mod restart;
mod shutdown;
mod stage;
mod verify;
