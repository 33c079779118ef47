//! Rigid bodies as bodies: a pose each, impulses between them, nothing per particle.
//!
//! [`Shape`](shape::Shape) is what never changes of a body, [`Body`](body::Body) what does; [`engine::step`] moves
//! all bodies of a scene through one substep: impacts at their moment, forces of resting contact, flight.

pub(crate) mod actor;
mod ball;
pub(crate) mod body;
mod cylinder;
mod distance;
pub(crate) mod engine;
mod feature;
mod field;
pub(crate) mod grain;
pub(crate) mod impact_time;
mod meet;
mod overlap;
mod points;
mod rims;
pub(crate) mod shape;
pub(crate) mod solve;
mod surface;
#[cfg(test)]
mod tests;
mod touch;
pub(crate) mod vector;
