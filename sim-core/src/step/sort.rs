//! Stable counting sort of particles into blocks, objects and cells; first placement.

use rayon::prelude::*;

use crate::{
    grid::{NONE, OFFSETS},
    particles::{BLOCK, Block, Extremes, Fixed, Flags, Group, Motion, NO_PARTICLE, Particles, Run},
    simd::LANES,
};

/// Blocks per task at least.
const TASK: usize = 8;

/// A particle on its way to its new place.
#[derive(Clone, Copy, Default)]
struct Traveller {
    /// Group and lane it comes from.
    from: u32,
    object: u32,
    /// Block offset (0..27) it moves by, and cell in its new block (0..64).
    offset: u8,
    cell: u8,
}

/// The particles of one old block, grouped by the block they move to.
struct Departures {
    travellers: Vec<Traveller>,
    /// Where each offset's group begins, and the end.
    starts: [u32; 28],
}

/// The particles that one new block receives, in their order, and how many of each object.
struct Intake {
    index: [i32; 3],
    travellers: Vec<Traveller>,
    /// Object and particle count.
    objects: Vec<(u32, usize)>,
}

/// Cell 0..64 within a block and the offset 0..27 of the block, for a position relative to the old block's
/// centre.
#[inline(always)]
fn cell_of(x: [f32; 3]) -> (u8, u8) {
    let (mut cell, mut offset) = (0, 0);
    for x in x {
        // Floor without the library call that processors without SSE 4.1 need.
        let truncated = x as i32;
        let floor = truncated - i32::from(x < truncated as f32);
        // At most one block away: the drift since the last sort is bounded well below that.
        let n = (floor + 2).clamp(-BLOCK, 2 * BLOCK - 1) + BLOCK;
        cell = cell * BLOCK + n % BLOCK;
        offset = offset * 3 + n / BLOCK;
    }
    (cell as u8, offset as u8)
}

/// Sorts particles by block, object and cell; among those the order stays as it was. Reads `old`, fills `new`.
pub(crate) fn sort(old: &Particles, new: &mut Particles) {
    let departures: Vec<Departures> = old
        .blocks
        .par_iter()
        .with_min_len(TASK)
        .map(|block| depart(old, block))
        .collect();
    // Who sends particles where: target, source block, offset. Sorted, each target finds its sources in the
    // order of the old blocks.
    let mut flows: Vec<([i32; 3], u32, u8)> = Vec::new();
    for (at, (block, departures)) in (0..).zip(old.blocks.iter().zip(&departures)) {
        let starts = &departures.starts;
        for code in (0..27).filter(|&code| starts[code] < starts[code + 1]) {
            let offset = OFFSETS[code];
            let target = std::array::from_fn(|a| block.index[a] + offset[a]);
            flows.push((target, at, code as u8));
        }
    }
    flows.par_sort_unstable();
    let intakes: Vec<Intake> = flows
        .chunk_by(|a, b| a.0 == b.0)
        .collect::<Vec<_>>()
        .into_par_iter()
        .with_min_len(TASK)
        .map(|flows| take_in(&departures, flows))
        .collect();
    lay_out(&intakes, new);
    fill(old, &intakes, new);
}

/// Groups the particles of a block by where they go.
fn depart(old: &Particles, block: &Block) -> Departures {
    let mut found = Vec::with_capacity(block.groups.len() * LANES);
    let mut starts = [0; 28];
    for run in &old.runs[block.runs.clone()] {
        for group in run.groups.clone() {
            let ([x, y, z], id) = (&old.groups[group].x, &old.fixed[group].id);
            for lane in 0..LANES {
                if id[lane] == NO_PARTICLE {
                    continue;
                }
                let (cell, offset) = cell_of([x.0[lane], y.0[lane], z.0[lane]]);
                starts[usize::from(offset) + 1] += 1;
                found.push(Traveller {
                    from: (group * LANES + lane) as u32,
                    object: run.object as u32,
                    offset,
                    cell,
                });
            }
        }
    }
    for n in 1..28 {
        starts[n] += starts[n - 1];
    }
    let mut next = starts;
    let mut travellers = vec![Traveller::default(); found.len()];
    for traveller in found {
        let place = &mut next[usize::from(traveller.offset)];
        travellers[*place as usize] = traveller;
        *place += 1;
    }
    Departures { travellers, starts }
}

/// Collects the particles of one new block and sorts them by object and cell.
fn take_in(departures: &[Departures], flows: &[([i32; 3], u32, u8)]) -> Intake {
    let mut found = Vec::new();
    for &(_, at, code) in flows {
        let Departures { travellers, starts } = &departures[at as usize];
        let [start, end] = [0, 1].map(|n| starts[usize::from(code) + n] as usize);
        found.extend_from_slice(&travellers[start..end]);
    }
    let mut objects: Vec<(u32, usize)> = Vec::new();
    for traveller in &found {
        match objects.last_mut() {
            Some(last) if last.0 == traveller.object => last.1 += 1,
            _ => objects.push((traveller.object, 1)),
        }
    }
    objects.sort_unstable();
    objects.dedup_by(|later, first| {
        let same = later.0 == first.0;
        first.1 += if same { later.1 } else { 0 };
        same
    });
    // Counting sort: one bucket per object and cell.
    let bucket = |traveller: &Traveller| {
        let rank = objects.partition_point(|o| o.0 < traveller.object);
        64 * rank + usize::from(traveller.cell)
    };
    let mut next = vec![0_u32; 64 * objects.len() + 1];
    for traveller in &found {
        next[bucket(traveller) + 1] += 1;
    }
    for n in 1..next.len() {
        next[n] += next[n - 1];
    }
    let mut travellers = vec![Traveller::default(); found.len()];
    for traveller in &found {
        let place = &mut next[bucket(traveller)];
        travellers[*place as usize] = *traveller;
        *place += 1;
    }
    Intake {
        index: flows[0].0,
        travellers,
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
            let mut travellers = intake.travellers.as_slice();
            let mut group = 0;
            for &(_, count) in &intake.objects {
                let (mine, others) = travellers.split_at(count);
                travellers = others;
                for chunk in mine.chunks(LANES) {
                    let to = (&mut groups[group], &mut motion[group], &mut fixed[group]);
                    fill_group(old, chunk, to);
                    group += 1;
                }
            }
        });
}

/// Fills one group with up to 16 particles.
fn fill_group(
    old: &Particles,
    travellers: &[Traveller],
    (group, motion, fixed): (&mut Group, &mut Motion, &mut Fixed),
) {
    if travellers.len() < LANES {
        (*group, *motion, *fixed) = (Group::REST, Motion::REST, Fixed::EMPTY);
    }
    for (lane, traveller) in travellers.iter().enumerate().take(LANES) {
        let from = traveller.from as usize / LANES;
        let at = traveller.from as usize % LANES;
        let (g, m, c) = (&old.groups[from], &old.motion[from], &old.fixed[from]);
        let offset = OFFSETS[usize::from(traveller.offset)];
        for a in 0..3 {
            group.x[a].0[lane] = g.x[a].0[at] - (BLOCK * offset[a]) as f32;
            motion.v[a].0[lane] = m.v[a].0[at];
        }
        for a in 0..9 {
            group.f[a].0[lane] = g.f[a].0[at];
            motion.c[a].0[lane] = m.c[a].0[at];
        }
        fixed.mass.0[lane] = c.mass.0[at];
        fixed.id[lane] = c.id[at];
    }
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
