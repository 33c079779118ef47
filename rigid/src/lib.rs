//! What does not deform: colliders ([`colliders`]), rigid bodies ([`bodies`]), and the account of what contact gave ([`ledger`]).
//!
//! Knows scenes and their numbers, and no matter that deforms.

pub mod bodies;
pub mod colliders;
pub mod distance;
pub mod ledger;

#[cfg(test)]
use cosplat_matter::{Scene, test_scenes};
use cosplat_matter::{expression, mat3, materials, rotation, scene};
