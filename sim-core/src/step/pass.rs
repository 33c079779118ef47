//! What a particle pass reads, works on and finds.

use super::constitutive::PartLaw;
use crate::{
    colliders::touch::ParticleConditions,
    grid::{Cells, Tile},
    ledger::ColliderImpulses,
    particles::{Block, Fixed, Flags, Group, Motion, Run, Shape},
    simd::F32x16,
};

/// What a particle pass does. A segment of substeps begins with a scatter, goes on fused, ends with a gather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Particle velocities to the grid; what a substep changes of a particle is copied to `backup` on the way.
    Scatter,
    /// Grid to particles, advance, particles to grid: velocities never leave the registers.
    Fused,
    /// Grid to particles, advance, velocities written out.
    Gather,
}

/// Everything a particle pass reads besides particles and grid.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass<'a> {
    /// Which part of a segment this is.
    pub stage: Stage,
    /// Substep that gathered velocities are advanced with [s].
    pub dt: f32,
    /// How long the forces that are scattered act [s].
    pub kick: f64,
    /// Velocity that all others are relative to [cells/s].
    pub frame_velocity: [f64; 3],
    /// The same after the next transfer.
    pub next_frame_velocity: [f64; 3],
    /// What damping leaves of velocities in the next transfer, 0..=1.
    pub next_keep: f64,
    /// What the next transfer makes of affine velocities, see [`Conditions`](crate::scene::Conditions::affine_kept).
    pub affine_kept: Option<[f64; 2]>,
    /// Per part.
    pub laws: &'a [PartLaw],
    /// Largest `dt |C|` (Frobenius) that passes the guard.
    pub max_strain: f32,
    /// Largest speed [cells/s] and `|C|` [1/s] that a segment may start with.
    pub max_speed: f32,
    /// See `max_speed`.
    pub max_rate: f32,
    /// Smallest and largest position [cells].
    pub domain: [[f64; 3]; 2],
    /// What acts on single particles, when anything does.
    pub touch: Option<&'a ParticleConditions<'a>>,
    /// Per block, whether a rule may name one of its particles; empty when there is no rule.
    pub concerned: &'a [bool],
}

/// The parts of a block that one task owns.
pub(super) struct Work<'a> {
    pub block: &'a Block,
    /// Node blocks around this block and those after it.
    pub nodes_of: &'a [[u32; 27]],
    pub runs: &'a mut [Run],
    pub groups: &'a mut [Group],
    pub memory: &'a mut [F32x16],
    pub shapes: &'a mut [Shape],
    pub backup: Backed<'a>,
    pub motion: &'a mut [Motion],
    pub fixed: &'a [Fixed],
    pub flags: &'a mut [Flags],
    pub tile: &'a mut Tile,
    /// Whether a rule may name one of the block's particles.
    pub concerned: bool,
    pub cells: &'a mut Cells,
    /// What colliders give to its particles [mass units, cells, s]; nothing yet.
    pub given: &'a mut ColliderImpulses,
}

/// Where a block's particles are copied to.
pub(super) struct Backed<'a> {
    pub groups: &'a mut [Group],
    pub memory: &'a mut [F32x16],
    pub shapes: &'a mut [Shape],
}

/// Whether the pass met lanes that [`Flags`] now names.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Findings {
    /// Some lane is bad: the substep must be rolled back.
    pub bad: bool,
    /// Some lane left the domain.
    pub outside: bool,
}
