//! Controller client: commands to a running simulation, with acknowledgements.
