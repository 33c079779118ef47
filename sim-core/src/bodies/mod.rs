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
mod field;
mod impact_time;
mod meet;
pub(crate) mod near;
pub(crate) mod nodes;
mod overlap;
mod points;
mod rims;
pub(crate) mod shape;
mod solve;
mod surface;
#[cfg(test)]
mod tests;
mod touch;
mod vector;
