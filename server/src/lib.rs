//! The simulation process: ingest commands, step, write each frame into loaned shared memory, publish, pace.

pub mod changes;
pub mod convert;
pub mod gaussians;
pub mod ingest;
pub mod publish;
pub mod serve;
