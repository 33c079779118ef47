//! Stable counting sort of particles into blocks, parts and cells; first placement.

use rayon::prelude::*;

use crate::{
    grid::{NONE, OFFSETS},
    particles::{
        BLOCK, Block, Extremes, Fixed, Flags, Group, Motion, NO_PARTICLE, Particles, Run, Shape,
    },
    simd::{F32x16, LANES},
};

/// Blocks per task at least.
const TASK: usize = 8;

/// A particle on its way to its new place.
#[derive(Clone, Copy, Default)]
struct Traveller {
    /// Group and lane it comes from.
    from: u32,
    part: u32,
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

/// Grid field and block index.
type Target = (u32, [i32; 3]);

/// The particles that one new block receives, in their order, and how many of each part.
struct Intake {
    field: u32,
    index: [i32; 3],
    travellers: Vec<Traveller>,
    /// Part and particle count.
    parts: Vec<(u32, usize)>,
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

/// Sorts particles by field, block, part and cell; among those the order stays as it was. Reads `old`, fills `new`.
/// `shaped` tells the parts whose visible deformation is carried apart: one that was not so far begins with `F`.
pub(crate) fn sort(old: &Particles, shaped: &[bool], new: &mut Particles) {
    sort_into(old, |_, part| part, shaped, new);
}

/// The same where particles may come to be of other parts of their field: `part_of` their index and the part so far.
pub(crate) fn sort_into(
    old: &Particles,
    part_of: impl Fn(u32, usize) -> usize + Sync,
    shaped: &[bool],
    new: &mut Particles,
) {
    let departures: Vec<Departures> = old
        .blocks
        .par_iter()
        .with_min_len(TASK)
        .map(|block| depart(old, block, &part_of))
        .collect();
    // Who sends particles where: target, source block, offset. Sorted, each target finds its sources in the
    // order of the old blocks.
    let mut flows: Vec<(Target, u32, u8)> = Vec::new();
    for (at, (block, departures)) in (0..).zip(old.blocks.iter().zip(&departures)) {
        let starts = &departures.starts;
        for code in (0..27).filter(|&code| starts[code] < starts[code + 1]) {
            let offset = OFFSETS[code];
            let target = std::array::from_fn(|a| block.index[a] + offset[a]);
            flows.push(((block.field, target), at, code as u8));
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
    lay_out(&intakes, shaped, new);
    fill(old, &intakes, new);
}

/// Groups the particles of a block by where they go.
fn depart(old: &Particles, block: &Block, part_of: impl Fn(u32, usize) -> usize) -> Departures {
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
                    part: part_of(id[lane], run.part) as u32,
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

/// Collects the particles of one new block and sorts them by part and cell.
fn take_in(departures: &[Departures], flows: &[(Target, u32, u8)]) -> Intake {
    let mut found = Vec::new();
    for &(_, at, code) in flows {
        let Departures { travellers, starts } = &departures[at as usize];
        let [start, end] = [0, 1].map(|n| starts[usize::from(code) + n] as usize);
        found.extend_from_slice(&travellers[start..end]);
    }
    let mut parts: Vec<(u32, usize)> = Vec::new();
    for traveller in &found {
        match parts.last_mut() {
            Some(last) if last.0 == traveller.part => last.1 += 1,
            _ => parts.push((traveller.part, 1)),
        }
    }
    parts.sort_unstable();
    parts.dedup_by(|later, first| {
        let same = later.0 == first.0;
        first.1 += if same { later.1 } else { 0 };
        same
    });
    // Counting sort: one bucket per part and cell.
    let bucket = |traveller: &Traveller| {
        let rank = parts.partition_point(|p| p.0 < traveller.part);
        64 * rank + usize::from(traveller.cell)
    };
    let mut next = vec![0_u32; 64 * parts.len() + 1];
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
    let (field, index) = flows[0].0;
    Intake {
        field,
        index,
        travellers,
        parts,
    }
}

/// Blocks, runs and empty groups for the particles to come: every run begins a group of its own.
fn lay_out(intakes: &[Intake], shaped: &[bool], new: &mut Particles) {
    new.blocks.clear();
    new.runs.clear();
    let (mut groups, mut shapes) = (0, 0);
    for intake in intakes {
        let (first_run, first_group, first_shape) = (new.runs.len(), groups, shapes);
        for &(part, count) in &intake.parts {
            let part = part as usize;
            let end = groups + count.div_ceil(LANES);
            let last_shape = shapes + if shaped[part] { end - groups } else { 0 };
            new.runs.push(Run {
                part,
                groups: groups..end,
                shapes: shapes..last_shape,
                extremes: Extremes::NONE,
            });
            (groups, shapes) = (end, last_shape);
        }
        new.blocks.push(Block {
            field: intake.field,
            index: intake.index,
            runs: first_run..new.runs.len(),
            groups: first_group..groups,
            shapes: first_shape..shapes,
        });
    }
    new.groups.resize(groups, Group::REST);
    new.memory.resize(groups, F32x16::ZERO);
    new.shapes.resize(shapes, Shape::REST);
    new.motion.resize(groups, Motion::REST);
    new.fixed.resize(groups, Fixed::EMPTY);
    new.flags.clear();
    new.flags.resize(groups, Flags::default());
}

/// One group to fill.
struct Place<'a> {
    group: &'a mut Group,
    motion: &'a mut Motion,
    fixed: &'a mut Fixed,
    memory: &'a mut F32x16,
    shape: Option<&'a mut Shape>,
}

/// Moves particle state to its new place.
fn fill(old: &Particles, intakes: &[Intake], new: &mut Particles) {
    let shape_of = shape_of_group(old);
    let mut rest = (
        new.groups.as_mut_slice(),
        new.motion.as_mut_slice(),
        new.fixed.as_mut_slice(),
        new.memory.as_mut_slice(),
        new.shapes.as_mut_slice(),
    );
    let mut work = Vec::with_capacity(intakes.len());
    for (intake, block) in intakes.iter().zip(&new.blocks) {
        let count = block.groups.len();
        let (groups, more_groups) = rest.0.split_at_mut(count);
        let (motion, more_motion) = rest.1.split_at_mut(count);
        let (fixed, more_fixed) = rest.2.split_at_mut(count);
        let (memory, more_memory) = rest.3.split_at_mut(count);
        let (shapes, more_shapes) = rest.4.split_at_mut(block.shapes.len());
        rest = (
            more_groups,
            more_motion,
            more_fixed,
            more_memory,
            more_shapes,
        );
        let runs = &new.runs[block.runs.clone()];
        work.push((intake, block, runs, groups, motion, fixed, memory, shapes));
    }
    work.into_par_iter().with_min_len(TASK).for_each(
        |(intake, block, runs, groups, motion, fixed, memory, shapes)| {
            let mut travellers = intake.travellers.as_slice();
            for (&(_, count), run) in intake.parts.iter().zip(runs) {
                let (mine, others) = travellers.split_at(count);
                travellers = others;
                for (n, chunk) in mine.chunks(LANES).enumerate() {
                    let g = run.groups.start + n - block.groups.start;
                    let shape = match run.shapes.is_empty() {
                        true => None,
                        false => Some(&mut shapes[run.shapes.start + n - block.shapes.start]),
                    };
                    let place = Place {
                        group: &mut groups[g],
                        motion: &mut motion[g],
                        fixed: &mut fixed[g],
                        memory: &mut memory[g],
                        shape,
                    };
                    fill_group(old, &shape_of, chunk, place);
                }
            }
        },
    );
}

/// Where each group's visible shape is, for those that have one; empty when none has.
fn shape_of_group(particles: &Particles) -> Vec<u32> {
    if particles.shapes.is_empty() {
        return vec![];
    }
    let mut shape_of = vec![NONE; particles.groups.len()];
    for run in &particles.runs {
        for (group, shape) in run.groups.clone().zip(run.shapes.clone()) {
            shape_of[group] = shape as u32;
        }
    }
    shape_of
}

/// Fills one group with up to 16 particles.
fn fill_group(old: &Particles, shape_of: &[u32], travellers: &[Traveller], mut to: Place<'_>) {
    if travellers.len() < LANES {
        (*to.group, *to.motion, *to.fixed) = (Group::REST, Motion::REST, Fixed::EMPTY);
        *to.memory = F32x16::ZERO;
        if let Some(shape) = &mut to.shape {
            **shape = Shape::REST;
        }
    }
    for (lane, traveller) in travellers.iter().enumerate().take(LANES) {
        let from = traveller.from as usize / LANES;
        let at = traveller.from as usize % LANES;
        let (g, m, c) = (&old.groups[from], &old.motion[from], &old.fixed[from]);
        let offset = OFFSETS[usize::from(traveller.offset)];
        for a in 0..3 {
            to.group.x[a].0[lane] = g.x[a].0[at] - (BLOCK * offset[a]) as f32;
            to.motion.v[a].0[lane] = m.v[a].0[at];
        }
        for a in 0..9 {
            to.group.f[a].0[lane] = g.f[a].0[at];
            to.motion.c[a].0[lane] = m.c[a].0[at];
        }
        to.memory.0[lane] = old.memory[from].0[at];
        if let Some(shape) = &mut to.shape {
            let old_shape = match shape_of.get(from) {
                Some(&s) if s != NONE => &old.shapes[s as usize].0,
                _ => &g.f,
            };
            for a in 0..9 {
                shape.0[a].0[lane] = old_shape[a].0[at];
            }
        }
        to.fixed.mass.0[lane] = c.mass.0[at];
        to.fixed.id[lane] = c.id[at];
    }
}

/// A particle to be placed for the first time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Newcomer {
    /// Index into the scene's particles.
    pub id: u32,
    /// Part id.
    pub part: u32,
    /// Position [cells].
    pub x: [f64; 3],
    /// Velocity [cells/s].
    pub v: [f32; 3],
    /// Affine velocity [1/s].
    pub c: [f32; 9],
    /// Mass in units of the heaviest particle.
    pub mass: f32,
}

/// Places undeformed particles, ordered by field, block, part and id; a [`sort`] must follow for the order of cells.
/// `fields` are those of the parts.
pub(crate) fn place(newcomers: &[Newcomer], fields: &[u32]) -> Particles {
    let block_of = |x: f64| ((x + 0.5).floor() as i32).div_euclid(BLOCK);
    let mut order: Vec<(Target, u32, u32)> = newcomers
        .iter()
        .enumerate()
        .map(|(at, n)| {
            (
                (fields[n.part as usize], n.x.map(block_of)),
                n.part,
                at as u32,
            )
        })
        .collect();
    order.par_sort_unstable();
    let mut particles = Particles::default();
    for in_block in order.chunk_by(|a, b| a.0 == b.0) {
        let (first_run, first_group) = (particles.runs.len(), particles.groups.len());
        for in_run in in_block.chunk_by(|a, b| a.1 == b.1) {
            let start = particles.groups.len();
            for chunk in in_run.chunks(LANES) {
                let (mut group, mut motion, mut fixed) = (Group::REST, Motion::REST, Fixed::EMPTY);
                for (lane, &((_, block), _, at)) in chunk.iter().enumerate() {
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
                part: in_run[0].1 as usize,
                groups: start..particles.groups.len(),
                shapes: 0..0,
                extremes: Extremes::NONE,
            });
        }
        let (field, index) = in_block[0].0;
        particles.blocks.push(Block {
            field,
            index,
            runs: first_run..particles.runs.len(),
            groups: first_group..particles.groups.len(),
            shapes: 0..0,
        });
    }
    let count = particles.groups.len();
    particles.memory.resize(count, F32x16::ZERO);
    particles
        .flags
        .resize(particles.groups.len(), Flags::default());
    debug_assert!(particles.blocks.len() < NONE as usize);
    particles
}
