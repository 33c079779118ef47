//! What a scene is made of: its typed constants, the laws of its matter, and the numbers that those are written in.
//!
//! [`Scene`] is checked by whoever makes a world of it. [`materials`] are laws in any [`num::Real`]: `f64`, `f32`, or sixteen
//! lanes of it ([`simd`]). [`expression`] are formulas of place and time, [`mat3`], [`rotation`] and [`kinematics`] the algebra.
//!
//! This crate knows nothing that moves.

#![allow(unsafe_code, reason = "vector instructions")]

pub mod expression;
pub mod kinematics;
pub mod mat3;
pub mod materials;
pub mod num;
pub mod rotation;
pub mod scene;
pub mod simd;
pub mod test_scenes;
pub mod timed;

pub use scene::Scene;
