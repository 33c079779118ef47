//! Rigid bodies as bodies: a pose each, impulses between them, nothing per particle.
//!
//! [`Shape`](shape::Shape) is what never changes of a body, [`Body`](body::Body) what does; [`engine::step`] moves
//! all bodies of a scene through one substep: impacts at their moment, forces of resting contact, flight.

pub mod actor;
mod ball;
pub mod body;
mod cylinder;
mod distance;
mod edges;
pub mod engine;
mod feature;
mod field;
pub mod grain;
pub mod impact_time;
mod meet;
mod overlap;
mod passing;
mod points;
mod rims;
mod seams;
pub mod shape;
pub mod solve;
mod surface;
#[cfg(test)]
mod tests;
mod touch;
pub mod vector;
