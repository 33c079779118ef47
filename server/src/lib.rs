//! The simulation process: ingest commands, step, write each frame into loaned shared memory, publish, pace.

pub mod allowance;
pub mod convert;
pub mod ingest;
pub mod late;
pub mod lockstep;
pub mod outcome;
pub mod pace;
pub mod publish;
pub mod serve;
pub mod steering;
