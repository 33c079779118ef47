//! Controller client: commands to a running simulation, with acknowledgements.

pub mod order;
pub mod script;
