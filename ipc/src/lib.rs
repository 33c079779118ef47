//! Wire types and iceoryx2 services of cosplat: everything a client needs, and nothing of the solver.

pub mod schema;
