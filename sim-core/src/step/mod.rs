//! The phases of a substep, one file each.

pub(crate) mod gather;
pub(crate) mod particle_pass;
pub(crate) mod scatter;
pub(crate) mod sort;
pub(crate) mod stencil;
