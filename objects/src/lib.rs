//! Stage 1 as commands: `cosplat views`, `lift`, `refine` and `objects`, from a splat to its objects.
//!
//! The methods are those of `cosplat-semantics`; here are their options, their files, and what a person reads.

mod find;
pub mod lift;
mod materials;
mod page;
pub mod pick;
mod prepared;
pub mod refine;
