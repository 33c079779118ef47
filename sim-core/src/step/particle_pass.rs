//! Particle pass: gather, advance, constitutive law, scatter, block by block in parallel.

use rayon::prelude::*;

use super::{
    block::block,
    pass::{Backed, Findings, Pass, Stage, Work},
};
use crate::{
    grid::{Grid, Velocities},
    ledger::ColliderImpulses,
    particles::{Backup, Motion, Particles},
    simd::{Isa, on_isa},
};

/// Particle blocks per task, at least and at most: where one thread is held up, others must find work to take over.
const TASK: [usize; 2] = [4, 16];

/// Takes the first `count` entries off a slice.
fn take<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (mine, others) = std::mem::take(rest).split_at_mut(count);
    *rest = others;
    mine
}

/// Runs one stage over all particles. `backup` receives them as they were in [`Stage::Scatter`]; `motion_out` the velocities
/// in [`Stage::Gather`].
pub(crate) fn particle_pass(
    isa: Isa,
    pass: &Pass<'_>,
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
        given_to_particles,
        ..
    } = grid;
    given_to_particles.resize_with(particles.blocks.len(), ColliderImpulses::default);
    let velocities = velocities.as_slice();
    let mut runs = particles.runs.as_mut_slice();
    let mut groups = particles.groups.as_mut_slice();
    let mut memory = particles.memory.as_mut_slice();
    let mut shapes = particles.shapes.as_mut_slice();
    let mut backup_groups = backup.groups.as_mut_slice();
    let mut backup_memory = backup.memory.as_mut_slice();
    let mut backup_shapes = backup.shapes.as_mut_slice();
    let mut motion = match pass.stage {
        Stage::Gather => motion_out,
        Stage::Scatter | Stage::Fused => particles.motion.as_mut_slice(),
    };
    let mut flags = particles.flags.as_mut_slice();
    let mut work = Vec::with_capacity(particles.blocks.len());
    let targets = tiles.iter_mut().zip(cells).zip(given_to_particles);
    for ((n, block), ((tile, cells), given)) in particles.blocks.iter().enumerate().zip(targets) {
        given.clear();
        let (count, shape_count) = (block.groups.len(), block.shapes.len());
        work.push(Work {
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
            concerned: pass.concerned.get(n).copied().unwrap_or(false),
            cells,
            given,
        });
    }
    work.into_par_iter()
        .with_min_len(TASK[0])
        .with_max_len(TASK[1])
        .map(|mut work| block_with_isa(isa, pass, &mut work, velocities))
        .reduce(Findings::default, |a, b| Findings {
            bad: a.bad | b.bad,
            outside: a.outside | b.outside,
        })
}

on_isa! {
    fn block_with_isa = block(pass: &Pass<'_>, work: &mut Work<'_>, nodes: &[Velocities]) -> Findings
}
