//! Stories across processes: real servers and clients, killed, restarted, starved and misled.

mod attach;
mod browser;
mod checkpoint;
mod commands;
mod crashes;
mod demo;
mod doctor;
mod edits;
mod export;
mod hand;
mod kept;
mod lift;
mod lockstep;
mod objects;
mod output;
mod page_edits;
mod python;
mod recording;
mod replay;
mod restart;
mod shares;
mod shutdown;
mod stage;
mod strokes;
mod verify;
mod web;
