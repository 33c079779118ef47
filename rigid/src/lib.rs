//! What does not deform: colliders ([`colliders`]), rigid bodies ([`bodies`]), the account of what contact gave ([`ledger`]), and the
//! scale of objects as wholes: their [`motion`], and contact from first touch to parting ([`episodes`]).
//!
//! Knows scenes and their numbers, and no matter that deforms.

pub mod bodies;
pub mod colliders;
pub mod distance;
pub mod episodes;
pub mod interruption;
pub mod ledger;
pub mod motion;

#[cfg(test)]
use cosplat_matter::{Scene, materials, test_scenes};
use cosplat_matter::{expression, mat3, rotation, scene};
