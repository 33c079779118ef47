//! The simulation process: ingest commands, step, write each frame into loaned shared memory, publish, pace.

pub mod allowance;
pub mod checkpoints;
pub mod convert;
pub mod ingest;
pub mod pace;
pub mod publish;
pub mod serve;
pub mod steering;
