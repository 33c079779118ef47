//! Particle pass: gather, advance, constitutive law, scatter, block by block in parallel.

use rayon::prelude::*;

use super::{block::block, constitutive::PartLaw};
use crate::{
    colliders::touch::Touch,
    grid::{Cells, Grid, Tile, Velocities},
    particles::{Backup, Block, Fixed, Flags, Group, Motion, Particles, Run, Shape},
    simd::{F32x16, Isa, Portable},
};

#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};

/// Particle blocks per task, at least and at most: where one thread is held up, others must find work to take over.
const TASK: [usize; 2] = [4, 16];

/// What a particle pass does. A segment of substeps begins with a scatter, goes on fused, ends with a gather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Particle velocities to the grid; what a substep changes of a particle is copied to `backup` on the way.
    Scatter,
    /// Grid to particles, advance, particles to grid: velocities never leave the registers.
    Fused,
    /// Grid to particles, advance, velocities written out.
    Gather,
    /// What stress adds to velocities, alone, to the grid; particles stay as they are.
    Forces,
}

/// Everything a particle pass reads besides particles and grid.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass<'a> {
    /// Which part of a segment this is.
    pub stage: Stage,
    /// Substep that gathered velocities are advanced with [s].
    pub dt: f32,
    /// Velocity that all others are relative to [cells/s].
    pub carrier: [f64; 3],
    /// The same after the next transfer.
    pub next_carrier: [f64; 3],
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
    pub touch: Option<&'a Touch<'a>>,
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

/// Takes the first `count` entries off a slice.
fn take<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (mine, others) = std::mem::take(rest).split_at_mut(count);
    *rest = others;
    mine
}

/// Runs one stage over the particles of fields that have a pass: `of` says which of `passes`, all of one stage. `backup`
/// receives them as they were in [`Stage::Scatter`]; `motion_out` the velocities in [`Stage::Gather`].
pub(crate) fn particle_pass(
    isa: Isa,
    passes: &[Pass<'_>],
    of: &[Option<usize>],
    particles: &mut Particles,
    backup: &mut Backup,
    motion_out: &mut [Motion],
    grid: &mut Grid,
) -> Findings {
    let Grid {
        tiles,
        cells,
        nodes_of,
        velocities,
        ..
    } = grid;
    let velocities = velocities.as_slice();
    let mut runs = particles.runs.as_mut_slice();
    let mut groups = particles.groups.as_mut_slice();
    let mut memory = particles.memory.as_mut_slice();
    let mut shapes = particles.shapes.as_mut_slice();
    let mut backup_groups = backup.groups.as_mut_slice();
    let mut backup_memory = backup.memory.as_mut_slice();
    let mut backup_shapes = backup.shapes.as_mut_slice();
    let gathers = passes.iter().all(|pass| pass.stage == Stage::Gather);
    let mut motion = match gathers {
        true => motion_out,
        false => particles.motion.as_mut_slice(),
    };
    let mut flags = particles.flags.as_mut_slice();
    let mut work = Vec::with_capacity(particles.blocks.len());
    let targets = tiles.iter_mut().zip(cells);
    for ((n, block), (tile, cells)) in particles.blocks.iter().enumerate().zip(targets) {
        let (count, shape_count) = (block.groups.len(), block.shapes.len());
        let mine = Work {
            block,
            nodes_of: &nodes_of[n..],
            runs: take(&mut runs, block.runs.len()),
            groups: take(&mut groups, count),
            memory: take(&mut memory, count),
            shapes: take(&mut shapes, shape_count),
            backup: Backed {
                groups: take(&mut backup_groups, count),
                memory: take(&mut backup_memory, count),
                shapes: take(&mut backup_shapes, shape_count),
            },
            motion: take(&mut motion, count),
            fixed: &particles.fixed[block.groups.clone()],
            flags: take(&mut flags, count),
            tile,
            concerned: false,
            cells,
        };
        if let Some(pass) = of[block.field as usize] {
            let pass = &passes[pass];
            let concerned = pass.concerned.get(n).copied().unwrap_or(false);
            work.push((pass, Work { concerned, ..mine }));
        }
    }
    work.into_par_iter()
        .with_min_len(TASK[0])
        .with_max_len(TASK[1])
        .map(|(pass, mut work)| match isa {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a world is only made with an instruction set that the processor has.
            Isa::Avx512 => unsafe { block_avx512(pass, &mut work, velocities) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a world is only made with an instruction set that the processor has.
            Isa::Avx2 => unsafe { block_avx2(pass, &mut work, velocities) },
            _ => block::<Portable>(pass, &mut work, velocities),
        })
        .reduce(Findings::default, |a, b| Findings {
            bad: a.bad | b.bad,
            outside: a.outside | b.outside,
        })
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,fma")]
unsafe fn block_avx512(pass: &Pass<'_>, work: &mut Work<'_>, nodes: &[Velocities]) -> Findings {
    block::<Avx512>(pass, work, nodes)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn block_avx2(pass: &Pass<'_>, work: &mut Work<'_>, nodes: &[Velocities]) -> Findings {
    block::<Avx2>(pass, work, nodes)
}
