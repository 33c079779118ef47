//! Rigid bodies as bodies: a pose each, impulses between them, nothing per particle.
//!
//! [`Shape`](shape::Shape) is what never changes of a body, [`Body`](body::Body) what does; [`engine::step`] moves all bodies of a scene
//! through one substep. Contact is that of rapier (`world`): its broad phase, its solver. Ours are shapes that it has none of (`sampled`),
//! impacts that give back (`impacts`), seams of flush solids (`seams`), and the flight of what nothing touches.

pub mod actor;
mod ball;
pub mod body;
mod by_points;
mod candidates;
mod cylinder;
mod dispatcher;
mod distance;
pub mod engine;
mod exchange;
mod field;
pub mod grain;
mod hooks;
mod impacts;
mod manifolds;
pub mod pairs;
mod points;
mod probes;
mod sampled;
mod seams;
pub mod shape;
pub mod solve;
mod surface;
#[cfg(test)]
mod tests;
pub mod vector;
pub mod warm_start;
mod world;
