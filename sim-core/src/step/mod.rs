//! The phases of a substep, one file each.

mod advance;
mod block;
pub(crate) mod constitutive;
pub(crate) mod gather;
mod lanes;
pub(crate) mod particle_pass;
pub(crate) mod pass;
mod prefetch;
pub(crate) mod scatter;
pub(crate) mod shapes;
pub(crate) mod sort;
pub(crate) mod stencil;
pub(crate) mod touch;
pub(crate) mod volume;
