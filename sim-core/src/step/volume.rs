//! What the grid knows about the volume of fluids, between two segments of substeps.
//!
//! Errors of `J` add up as long as a fluid moves, and the pool sinks into itself. Where the grid holds more
//! fluid than `J` admits, `J` gives way by [`CORRECTION`] of the difference; where it holds less there may be a
//! surface, and nothing is done.

use rayon::prelude::*;

use super::{
    block::load_velocities,
    constitutive::PartLaw,
    gather::gather,
    lanes::{cells_in_use, load3},
    scatter::Accumulator,
    stencil::Stencil,
};
use crate::{
    grid::{Cells, Grid, Tile, node_means},
    mat3::Mat3,
    particles::{Block, Fixed, Group, Particles, Run},
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Share of the difference to the grid that the volume ratio of a fluid gives way by.
const CORRECTION: f64 = 0.2;
/// Smallest volume ratio that the grid may ask of a fluid.
const LEAST: f64 = 0.9;

/// One block of particles.
struct Work<'a> {
    runs: &'a [Run],
    /// First group of the block.
    origin: usize,
    groups: &'a mut [Group],
    memory: &'a mut [F32x16],
    fixed: &'a [Fixed],
}

/// Lets the volume ratio of fluids give way to what the grid holds.
pub(crate) fn correct_fluid_volume(
    isa: Isa,
    laws: &[PartLaw],
    particles: &mut Particles,
    grid: &mut Grid,
) {
    if !laws.iter().any(|law| law.law.is_fluid()) {
        return;
    }
    let mut work = split(particles);
    work.par_iter()
        .zip(&mut grid.tiles)
        .zip(&mut grid.cells)
        .for_each(|((work, tile), cells)| give_with_isa(isa, laws, work, tile, cells));
    node_means(isa, grid);
    let Grid {
        cells,
        nodes_of,
        velocities,
        ..
    } = grid;
    work.par_iter_mut()
        .zip(&*nodes_of)
        .zip(&*cells)
        .for_each(|((work, nodes_of), cells)| {
            if !work.runs.iter().any(|run| laws[run.part].law.is_fluid()) {
                return;
            }
            let mut means = Tile::ZERO;
            load_velocities(nodes_of, velocities, cells, &mut means);
            take_with_isa(isa, laws, work, &means)
        });
}

fn split(particles: &mut Particles) -> Vec<Work<'_>> {
    let Particles {
        blocks,
        runs,
        groups,
        memory,
        fixed,
        ..
    } = particles;
    let (mut rest, mut memory) = (groups.as_mut_slice(), memory.as_mut_slice());
    let mut work = Vec::with_capacity(blocks.len());
    for Block {
        runs: r, groups: g, ..
    } in blocks.iter()
    {
        let (mine, others) = std::mem::take(&mut rest).split_at_mut(g.len());
        rest = others;
        let (remembered, later) = std::mem::take(&mut memory).split_at_mut(g.len());
        memory = later;
        work.push(Work {
            runs: &runs[r.clone()],
            origin: g.start,
            groups: mine,
            memory: remembered,
            fixed: &fixed[g.clone()],
        });
    }
    work
}

on_isa! {
    fn give_with_isa = give(laws: &[PartLaw], work: &Work<'_>, tile: &mut Tile, cells: &mut Cells)
}

on_isa! {
    fn take_with_isa = take(laws: &[PartLaw], work: &mut Work<'_>, means: &Tile)
}

/// Scatters the mass of one block.
#[inline(always)]
fn give<V: Lanes>(laws: &[PartLaw], work: &Work<'_>, packed: &mut Tile, used: &mut Cells) {
    let mut tile = Tile::ZERO;
    let zero = V::broadcast(0.0);
    let mut cells = [(V::splat(4.0), V::splat(-1.0)); 3];
    let mut accumulator = Accumulator::<V>::new();
    for run in work.runs {
        if !laws[run.part].law.is_fluid() {
            continue;
        }
        for g in run.groups.start - work.origin..run.groups.end - work.origin {
            let stencil = Stencil::<V>::new(load3(&work.groups[g].x));
            for a in 0..3 {
                cells[a].0 = cells[a].0.min(stencil.cell[a]);
                cells[a].1 = cells[a].1.max(stencil.cell[a]);
            }
            let mass = V::load(&work.fixed[g].mass);
            let nothing = Mat3([[zero; 3]; 3]);
            accumulator.scatter(&mut tile, &stencil, mass, [zero; 3], &nothing);
        }
    }
    accumulator.flush(&mut tile);
    *used = cells_in_use(cells);
    tile.pack::<V>(used, packed);
}

/// Gathers the mass per cell, and lets the volume ratio of the particles of one block give way to it.
#[inline(always)]
fn take<V: Lanes>(laws: &[PartLaw], work: &mut Work<'_>, means: &Tile) {
    let (zero, one) = (V::broadcast(0.0), V::broadcast(1.0));
    for run in work.runs {
        let law = &laws[run.part];
        if !law.law.is_fluid() {
            continue;
        }
        for g in run.groups.start - work.origin..run.groups.end - work.origin {
            let found = gather(means, &Stencil::<V>::new(load3(&work.groups[g].x)));
            let live = zero.lt(V::load(&work.fixed[g].mass));
            let memory = V::load(&work.memory[g]);
            let crowding = found.mass * V::splat(law.cells_per_rest_mass);
            let shown = (one / crowding.max(one)).max(V::splat(LEAST)) - one;
            let corrected = V::splat(CORRECTION).mul_add(shown - memory, memory);
            let denser = live & one.lt(crowding) & shown.lt(memory);
            V::select(denser, corrected, memory).store(&mut work.memory[g]);
        }
    }
}
