//! Stable counting sort of particles into blocks, objects and cells; first placement.

use rayon::prelude::*;

use crate::{
    grid::NONE,
    particles::{BLOCK, Block, Extremes, Fixed, Flags, Group, Motion, NO_PARTICLE, Particles, Run},
    simd::LANES,
};

/// Blocks per task at least.
const TASK: usize = 8;

/// A particle on its way to its new place.
#[derive(Clone, Copy)]
struct Arrival {
    /// Group and lane it comes from.
    from: u32,
    object: u32,
    /// Block offset (0..27) it moved by, and cell in its new block (0..64).
    offset: u8,
    cell: u8,
}

/// The particles that one new block receives, in their order, and how many of each object.
struct Intake {
    index: [i32; 3],
    arrivals: Vec<Arrival>,
    /// Object and particle count.
    objects: Vec<(u32, usize)>,
}

/// Cell 0..64 within a block and the block's offset per axis, of a position relative to the block's centre.
fn cell_of(x: [f32; 3]) -> (u8, [i32; 3]) {
    let mut cell = 0;
    let offset = x.map(|x| {
        // At most one block away: the drift since the last sort is bounded well below that.
        let n = ((x + 2.0).floor() as i32).clamp(-BLOCK, 2 * BLOCK - 1);
        cell = cell * BLOCK + n.rem_euclid(BLOCK);
        n.div_euclid(BLOCK)
    });
    (cell as u8, offset)
}

fn offset_code(offset: [i32; 3]) -> u8 {
    ((offset[0] + 1) * 9 + (offset[1] + 1) * 3 + offset[2] + 1) as u8
}

fn code_offset(code: u8) -> [i32; 3] {
    let code = i32::from(code);
    [code / 9 - 1, code / 3 % 3 - 1, code % 3 - 1]
}

/// Sorts particles by block, object and cell; among those the order stays as it was. Reads `old`, fills `new`.
pub(crate) fn sort(old: &Particles, new: &mut Particles) {
    // Which blocks lose how many particles into which direction.
    let departures: Vec<[u32; 27]> = old
        .blocks
        .par_iter()
        .with_min_len(TASK)
        .map(|block| {
            let mut count = [0; 27];
            for_each_particle(old, block, |_, x| {
                count[usize::from(offset_code(cell_of(x).1))] += 1;
            });
            count
        })
        .collect();
    let mut flows: Vec<([i32; 3], u32, u8, u32)> = Vec::new();
    for (at, (block, count)) in old.blocks.iter().zip(&departures).enumerate() {
        for code in (0..27).filter(|&code| count[usize::from(code)] > 0) {
            let offset = code_offset(code);
            let index = std::array::from_fn(|a| block.index[a] + offset[a]);
            flows.push((index, at as u32, code, count[usize::from(code)]));
        }
    }
    flows.sort_unstable();
    let intakes: Vec<Intake> = flows
        .chunk_by(|a, b| a.0 == b.0)
        .collect::<Vec<_>>()
        .into_par_iter()
        .with_min_len(TASK)
        .map(|flows| take_in(old, flows))
        .collect();
    lay_out(&intakes, new);
    fill(old, &intakes, new);
}

/// Calls `f(slot, x)` for every particle of a block, in order.
fn for_each_particle(particles: &Particles, block: &Block, mut f: impl FnMut(u32, [f32; 3])) {
    for group in block.groups.clone() {
        let (x, id) = (&particles.groups[group].x, &particles.fixed[group].id);
        for lane in (0..LANES).filter(|&lane| id[lane] != NO_PARTICLE) {
            f(
                (group * LANES + lane) as u32,
                [x[0].0[lane], x[1].0[lane], x[2].0[lane]],
            );
        }
    }
}

/// Collects the particles of one new block and sorts them by object and cell.
fn take_in(old: &Particles, flows: &[([i32; 3], u32, u8, u32)]) -> Intake {
    let mut found = Vec::with_capacity(flows.iter().map(|flow| flow.3 as usize).sum());
    for &(_, at, wanted, _) in flows {
        for run in &old.runs[old.blocks[at as usize].runs.clone()] {
            for group in run.groups.clone() {
                let (x, id) = (&old.groups[group].x, &old.fixed[group].id);
                for lane in (0..LANES).filter(|&lane| id[lane] != NO_PARTICLE) {
                    let (cell, offset) = cell_of([x[0].0[lane], x[1].0[lane], x[2].0[lane]]);
                    if offset_code(offset) == wanted {
                        found.push(Arrival {
                            from: (group * LANES + lane) as u32,
                            object: run.object as u32,
                            offset: wanted,
                            cell,
                        });
                    }
                }
            }
        }
    }
    let mut objects: Vec<(u32, usize)> = Vec::new();
    for arrival in &found {
        match objects.binary_search_by_key(&arrival.object, |o| o.0) {
            Ok(at) => objects[at].1 += 1,
            Err(at) => objects.insert(at, (arrival.object, 1)),
        }
    }
    // Counting sort: one bucket per object and cell.
    let bucket = |arrival: &Arrival| {
        let rank = objects.partition_point(|o| o.0 < arrival.object);
        64 * rank + usize::from(arrival.cell)
    };
    let mut next = vec![0u32; 64 * objects.len() + 1];
    for arrival in &found {
        next[bucket(arrival) + 1] += 1;
    }
    for n in 1..next.len() {
        next[n] += next[n - 1];
    }
    let mut arrivals = found.clone();
    for arrival in &found {
        let place = &mut next[bucket(arrival)];
        arrivals[*place as usize] = *arrival;
        *place += 1;
    }
    Intake {
        index: flows[0].0,
        arrivals,
        objects,
    }
}

/// Blocks, runs and empty groups for the particles to come: every run begins a group of its own.
fn lay_out(intakes: &[Intake], new: &mut Particles) {
    new.blocks.clear();
    new.runs.clear();
    let mut groups = 0;
    for intake in intakes {
        let (first_run, first_group) = (new.runs.len(), groups);
        for &(object, count) in &intake.objects {
            let end = groups + count.div_ceil(LANES);
            new.runs.push(Run {
                object: object as usize,
                groups: groups..end,
                extremes: Extremes::NONE,
            });
            groups = end;
        }
        new.blocks.push(Block {
            index: intake.index,
            runs: first_run..new.runs.len(),
            groups: first_group..groups,
        });
    }
    new.groups.resize(groups, Group::REST);
    new.motion.resize(groups, Motion::REST);
    new.fixed.resize(groups, Fixed::EMPTY);
    new.flags.clear();
    new.flags.resize(groups, Flags::default());
}

/// Moves particle state to its new place.
fn fill(old: &Particles, intakes: &[Intake], new: &mut Particles) {
    let mut rest = (
        new.groups.as_mut_slice(),
        new.motion.as_mut_slice(),
        new.fixed.as_mut_slice(),
    );
    let mut work = Vec::with_capacity(intakes.len());
    for (intake, block) in intakes.iter().zip(&new.blocks) {
        let count = block.groups.len();
        let (groups, more_groups) = rest.0.split_at_mut(count);
        let (motion, more_motion) = rest.1.split_at_mut(count);
        let (fixed, more_fixed) = rest.2.split_at_mut(count);
        rest = (more_groups, more_motion, more_fixed);
        work.push((intake, groups, motion, fixed));
    }
    work.into_par_iter()
        .with_min_len(TASK)
        .for_each(|(intake, groups, motion, fixed)| {
            let mut arrivals = intake.arrivals.as_slice();
            let mut group = 0;
            for &(_, count) in &intake.objects {
                let (mine, others) = arrivals.split_at(count);
                arrivals = others;
                for chunk in mine.chunks(LANES) {
                    groups[group] = Group::REST;
                    motion[group] = Motion::REST;
                    fixed[group] = Fixed::EMPTY;
                    for (lane, arrival) in chunk.iter().enumerate() {
                        let (from, at) =
                            (arrival.from as usize / LANES, arrival.from as usize % LANES);
                        let (g, m, c) = (&old.groups[from], &old.motion[from], &old.fixed[from]);
                        let offset = code_offset(arrival.offset);
                        for a in 0..3 {
                            let shift = (BLOCK * offset[a]) as f32;
                            groups[group].x[a].0[lane] = g.x[a].0[at] - shift;
                            motion[group].v[a].0[lane] = m.v[a].0[at];
                        }
                        for a in 0..9 {
                            groups[group].f[a].0[lane] = g.f[a].0[at];
                            motion[group].c[a].0[lane] = m.c[a].0[at];
                        }
                        fixed[group].mass.0[lane] = c.mass.0[at];
                        fixed[group].id[lane] = c.id[at];
                    }
                    group += 1;
                }
            }
        });
}

/// A particle to be placed for the first time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Newcomer {
    /// Index into the scene's particles.
    pub id: u32,
    /// Object id.
    pub object: u32,
    /// Position [cells].
    pub x: [f64; 3],
    /// Velocity [cells/s].
    pub v: [f32; 3],
    /// Affine velocity [1/s].
    pub c: [f32; 9],
    /// Mass in units of the heaviest particle.
    pub mass: f32,
}

/// Places undeformed particles, ordered by block, object and id; a [`sort`] must follow for the order of cells.
pub(crate) fn place(newcomers: &[Newcomer]) -> Particles {
    let block_of = |x: f64| ((x + 0.5).floor() as i32).div_euclid(BLOCK);
    let mut order: Vec<([i32; 3], u32, u32)> = newcomers
        .iter()
        .enumerate()
        .map(|(at, n)| (n.x.map(block_of), n.object, at as u32))
        .collect();
    order.par_sort_unstable();
    let mut particles = Particles::default();
    for in_block in order.chunk_by(|a, b| a.0 == b.0) {
        let (first_run, first_group) = (particles.runs.len(), particles.groups.len());
        for in_run in in_block.chunk_by(|a, b| a.1 == b.1) {
            let start = particles.groups.len();
            for chunk in in_run.chunks(LANES) {
                let (mut group, mut motion, mut fixed) = (Group::REST, Motion::REST, Fixed::EMPTY);
                for (lane, &(block, _, at)) in chunk.iter().enumerate() {
                    let n = &newcomers[at as usize];
                    for a in 0..3 {
                        let centre = f64::from(BLOCK * block[a]) + 1.5;
                        group.x[a].0[lane] = (n.x[a] - centre) as f32;
                        motion.v[a].0[lane] = n.v[a];
                    }
                    for a in 0..9 {
                        motion.c[a].0[lane] = n.c[a];
                    }
                    fixed.mass.0[lane] = n.mass;
                    fixed.id[lane] = n.id;
                }
                particles.groups.push(group);
                particles.motion.push(motion);
                particles.fixed.push(fixed);
            }
            particles.runs.push(Run {
                object: in_run[0].1 as usize,
                groups: start..particles.groups.len(),
                extremes: Extremes::NONE,
            });
        }
        particles.blocks.push(Block {
            index: in_block[0].0,
            runs: first_run..particles.runs.len(),
            groups: first_group..particles.groups.len(),
        });
    }
    particles
        .flags
        .resize(particles.groups.len(), Flags::default());
    debug_assert!(particles.blocks.len() < NONE as usize);
    particles
}
