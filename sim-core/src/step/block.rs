//! Kernel of the particle pass: one stage over the particles of one block.

use std::ops::Range;

use super::{
    advance::{Largest, Limits, absurd, advance},
    constitutive::{Answer, Constitutive, Deformed, PartLaw},
    lanes::{cells_in_use, load3, load9, store3, store9},
    pass::{Findings, Pass, Stage, Work},
    prefetch::{prefetch, prefetch_tile, prefetch_velocities},
    scatter::Accumulator,
    stencil::Stencil,
    touch::{LaneConditions, LaneIds, anchor},
};
use crate::{
    grid::{Cells, NONE, TILE, Tile, Velocities},
    num::Real,
    particles::{BLOCK, Flags, Motion, Run},
    simd::{F32x16, LANES, Lanes},
};

#[inline(always)]
pub(super) fn block<V: Constitutive>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    nodes: &[Velocities],
) -> Findings {
    match pass.stage {
        Stage::Scatter => staged::<V, false, true>(pass, work, nodes),
        Stage::Fused => staged::<V, true, true>(pass, work, nodes),
        Stage::Gather => staged::<V, true, false>(pass, work, nodes),
    }
}

/// Copies the velocities of the nodes in use around a block into a tile.
#[inline(always)]
pub(super) fn load_velocities(
    nodes_of: &[u32; 27],
    nodes: &[Velocities],
    cells: &Cells,
    to: &mut Tile,
) {
    let [(x0, x1), (y0, y1), _] = *cells;
    for i in x0 - 1..=x1 + 1 {
        for j in y0 - 1..=y1 + 1 {
            let (side_i, side_j) = (i.div_euclid(BLOCK) + 1, j.div_euclid(BLOCK) + 1);
            let row = (BLOCK * i.rem_euclid(BLOCK) + j.rem_euclid(BLOCK)) as usize;
            let column = (9 * side_i + 3 * side_j) as usize;
            let at = Tile::at((i + 2) as usize, (j + 2) as usize, 0);
            let out = &mut to.0[at..at + 4 * TILE];
            let part = |k: usize| {
                let block = nodes_of[column + k];
                debug_assert_ne!(block, NONE, "all neighbours of a particle block exist");
                &nodes[block as usize].0[row].0
            };
            out[..8].copy_from_slice(&part(0)[8..]);
            out[8..24].copy_from_slice(part(1));
            out[24..].copy_from_slice(&part(2)[..8]);
        }
    }
}

/// What moves the particles of a block.
struct Mover<'a, V: Real> {
    velocities: &'a Tile,
    limits: Limits<V>,
    touch: Option<LaneConditions<'a>>,
}

/// Two groups on their way from one loop over them to the next: they stay in the first-level cache.
struct Pair {
    motion: [Motion; 2],
    dt: [F32x16; 2],
    /// Lanes that a rule holds.
    held: [u16; 2],
    answer: Answer,
}

impl Pair {
    /// To be overwritten.
    const EMPTY: Self = Self {
        motion: [Motion::REST; 2],
        dt: [F32x16::ZERO; 2],
        held: [0; 2],
        answer: Answer::EMPTY,
    };
}

/// What the particles of a block bring to the grid.
struct Scattered<V: Lanes> {
    cells: [(V, V); 3],
    accumulator: Accumulator<V>,
    tile: Tile,
}

impl<V: Lanes> Scattered<V> {
    #[inline(always)]
    fn nothing() -> Self {
        Self {
            cells: [(V::splat(4.0), V::splat(-1.0)); 3],
            accumulator: Accumulator::new(),
            tile: Tile::ZERO,
        }
    }

    /// Writes the nodes in use out.
    #[inline(always)]
    fn finish(mut self, work: &mut Work<'_>) {
        self.accumulator.flush(&mut self.tile);
        *work.cells = cells_in_use(self.cells);
        self.tile.pack::<V>(work.cells, work.tile);
    }
}

#[inline(always)]
fn staged<V: Constitutive, const GATHER: bool, const SCATTER: bool>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    nodes: &[Velocities],
) -> Findings {
    // Private and in the first-level cache.
    let mut velocities = Tile::ZERO;
    if GATHER {
        load_velocities(&work.nodes_of[0], nodes, work.cells, &mut velocities);
        if let Some(next) = work.nodes_of.get(1) {
            prefetch_velocities(next, nodes, work.cells);
        }
        prefetch_tile(work.tile, work.cells);
    }
    let mut scattered = Scattered::<V>::nothing();
    let mut findings = Findings::default();
    let mut pair = Pair::EMPTY;
    let mover = Mover {
        velocities: &velocities,
        limits: Limits::<V>::new(pass, work.block),
        touch: pass.touch.and_then(|touch| {
            let frame_velocity = [pass.frame_velocity, pass.next_frame_velocity];
            let concerned = work.concerned;
            LaneConditions::new(touch, work.block, concerned, frame_velocity, pass.next_keep)
        }),
    };
    let (origin, first_shape) = (work.block.groups.start, work.block.shapes.start);
    for r in 0..work.runs.len() {
        let Run {
            part,
            groups,
            shapes,
            ..
        } = work.runs[r].clone();
        let mut largest = Largest::none();
        let law = &pass.laws[part];
        let of = OfRun {
            law,
            stress_scale: law.stress_scale(pass.kick),
            deforms: law.visible || !law.law.is_fluid(),
            groups: groups.start - origin..groups.end - origin,
            first_shape: (!shapes.is_empty()).then(|| shapes.start - first_shape),
        };
        // Two groups at a time; the law sees an odd last one twice.
        for first in of.groups.clone().step_by(2) {
            let members = first..(first + 2).min(of.groups.end);
            prefetch(
                work.groups,
                work.fixed,
                work.memory,
                members.end,
                of.deforms,
            );
            take_pair::<V, GATHER, SCATTER>(
                pass,
                work,
                &of,
                members,
                &mover,
                &mut pair,
                &mut scattered,
                &mut largest,
                &mut findings,
            );
        }
        if GATHER {
            work.runs[r].extremes = largest.extremes();
        }
    }
    if SCATTER {
        scattered.finish(work);
    }
    if GATHER && let Some(touch) = mover.touch {
        *work.given = touch.given();
    }
    findings
}

/// What the groups of a run have in common.
struct OfRun<'a> {
    law: &'a PartLaw,
    stress_scale: f32,
    /// Whether the deformation gradient follows the motion.
    deforms: bool,
    /// Its groups within those of the block.
    groups: Range<usize>,
    /// Place of its first visible shape within those of the block, if it has any.
    first_shape: Option<usize>,
}

/// Takes a pair of groups, or an odd last one, through one stage.
#[expect(
    clippy::too_many_arguments,
    reason = "a kernel: the caller's borrows of its buffers stay split"
)]
#[inline(always)]
fn take_pair<V: Constitutive, const GATHER: bool, const SCATTER: bool>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    of: &OfRun<'_>,
    members: Range<usize>,
    mover: &Mover<'_, V>,
    pair: &mut Pair,
    scattered: &mut Scattered<V>,
    largest: &mut Largest<V>,
    findings: &mut Findings,
) {
    for (n, g) in members.clone().enumerate() {
        let shape = of.first_shape.map(|first| first + (g - of.groups.start));
        if GATHER {
            let deforms = of.deforms;
            move_group::<V, SCATTER>(
                work,
                g,
                shape,
                deforms,
                mover,
                (&mut *pair, n),
                largest,
                findings,
            );
        } else {
            begin_group::<V>(pass, work, g, shape, (&mut *pair, n), findings);
        }
    }
    pair.held = [0; 2];
    if SCATTER && let Some(touch) = &mover.touch {
        for (n, g) in members.clone().enumerate() {
            let (ids, x) = (&work.fixed[g].id, &work.groups[g].x);
            pair.held[n] = touch.before(ids, x, &mut pair.motion[n]);
        }
    }
    let (one, two) = (members.start, members.end - 1);
    if members.len() == 1 {
        (pair.motion[1], pair.dt[1]) = (pair.motion[0], pair.dt[0]);
    }
    let deformed = Deformed {
        f: [&work.groups[one].f, &work.groups[two].f],
        memory: [&work.memory[one], &work.memory[two]],
        motion: &pair.motion,
        dt: pair.dt,
        stress_scale: of.stress_scale,
    };
    V::respond(of.law, &deformed, &mut pair.answer);
    for (n, g) in members.enumerate() {
        if GATHER {
            take_answer(work, g, of.law, (&*pair, n), largest, findings);
        }
        if SCATTER {
            scatter_group(pass, work, g, of.law, (&mut *pair, n), scattered);
        } else {
            work.motion[g] = pair.motion[n];
        }
    }
}

/// Gathers the velocities of group `g` to place `n` of a pair and moves its particles.
#[expect(
    clippy::too_many_arguments,
    reason = "a kernel: the caller's borrows of its buffers stay split"
)]
#[inline(always)]
fn move_group<V: Lanes, const SCATTER: bool>(
    work: &mut Work<'_>,
    g: usize,
    shape: Option<usize>,
    deforms: bool,
    mover: &Mover<'_, V>,
    (pair, n): (&mut Pair, usize),
    largest: &mut Largest<V>,
    findings: &mut Findings,
) {
    let zero = V::broadcast(0.0);
    let (group, flags) = (&mut work.groups[g], &mut work.flags[g]);
    let ids = LaneIds {
        ids: &work.fixed[g].id,
        mass: &work.fixed[g].mass,
    };
    let live = zero.lt(V::load(&work.fixed[g].mass));
    let before = group.x;
    let moved = advance(
        group,
        shape.map(|at| &mut work.shapes[at].0),
        deforms,
        live,
        mover.velocities,
        &mover.limits,
        mover.touch.as_ref().map(|touch| (touch, ids)),
        largest,
    );
    V::select(live, mover.limits.dt, zero).store(&mut pair.dt[n]);
    note(
        &mut flags.bad,
        V::mask_bits(live & moved.bad),
        &mut findings.bad,
    );
    if !SCATTER {
        let outside = V::mask_bits(live & moved.outside);
        note(&mut flags.outside, outside, &mut findings.outside);
    }
    let motion = &mut pair.motion[n];
    store3(moved.v, &mut motion.v);
    store9(&moved.c, &mut motion.c);
    if let Some(touch) = &mover.touch {
        let speed = touch.after(ids, &before, &mut group.x, motion);
        largest.speed = largest.speed.max(V::broadcast(speed));
    }
}

/// Brings the velocities of group `g`, which nothing was gathered for, to place `n` of a pair, and copies what a substep will
/// change.
#[inline(always)]
fn begin_group<V: Lanes>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    g: usize,
    shape: Option<usize>,
    (pair, n): (&mut Pair, usize),
    findings: &mut Findings,
) {
    if let Some(at) = shape {
        work.backup.shapes[at] = work.shapes[at];
    }
    work.backup.groups[g] = work.groups[g];
    work.backup.memory[g] = work.memory[g];
    pair.motion[n] = work.motion[g];
    let live = V::broadcast(0.0).lt(V::load(&work.fixed[g].mass));
    let bad = absurd::<V>(pass, &pair.motion[n]);
    note(
        &mut work.flags[g].bad,
        V::mask_bits(live & bad),
        &mut findings.bad,
    );
}

/// Takes in what the law made of group `g`, at place `n` of a pair.
#[inline(always)]
fn take_answer<V: Lanes>(
    work: &mut Work<'_>,
    g: usize,
    law: &PartLaw,
    (pair, n): (&Pair, usize),
    largest: &mut Largest<V>,
    findings: &mut Findings,
) {
    largest.take_place(load3(&work.groups[g].x));
    if law.law.is_plastic() {
        work.groups[g].f = pair.answer.f[n];
    }
    if law.law.is_plastic() || law.law.is_fluid() {
        work.memory[g] = pair.answer.memory[n];
    }
    let live = V::broadcast(0.0).lt(V::load(&work.fixed[g].mass));
    let inverted = V::mask_bits(live & largest.take_answer(live, &pair.answer, n));
    add_note(&mut work.flags[g], inverted, findings);
}

/// Scatters group `g`, at place `n` of a pair.
#[inline(always)]
fn scatter_group<V: Lanes>(
    pass: &Pass<'_>,
    work: &Work<'_>,
    g: usize,
    law: &PartLaw,
    (pair, n): (&mut Pair, usize),
    to: &mut Scattered<V>,
) {
    let x = load3(&work.groups[g].x);
    let live = V::broadcast(0.0).lt(V::load(&work.fixed[g].mass));
    let stencil = Stencil::<V>::new(x);
    for a in 0..3 {
        let (low, high) = &mut to.cells[a];
        *low = V::select(live, low.min(stencil.cell[a]), *low);
        *high = V::select(live, high.max(stencil.cell[a]), *high);
    }
    let (motion, affine) = (&pair.motion[n], &mut pair.answer.affine[n]);
    if let Some(kept) = pass.affine_kept
        && !law.law.is_rigid()
    {
        keep_affine::<V>(&motion.c, kept, affine);
    }
    let mut mass = V::load(&work.fixed[g].mass);
    if pair.held[n] != 0 {
        let heavy = anchor(pair.held[n], &work.fixed[g].mass, motion, affine);
        mass = V::load(&heavy);
    }
    let (v, affine) = (load3(&motion.v), load9(affine));
    to.accumulator
        .scatter(&mut to.tile, &stencil, mass, v, &affine);
}

/// Turns `C - s tau`, which particles carry to the grid, into `a C + b C^T - s tau`.
#[inline(always)]
fn keep_affine<V: Lanes>(c: &[F32x16; 9], [a, b]: [f64; 2], affine: &mut [F32x16; 9]) {
    let (own, other) = (V::broadcast((a - 1.0) as f32), V::broadcast(b as f32));
    for n in 0..9 {
        let transposed = 3 * (n % 3) + n / 3;
        let kept = own.mul_add(V::load(&c[n]), V::load(&affine[n]));
        other
            .mul_add(V::load(&c[transposed]), kept)
            .store(&mut affine[n]);
    }
}

/// Writes lane flags where they change; almost always there is nothing to write.
#[inline(always)]
fn note(flags: &mut u16, lanes: u32, any: &mut bool) {
    const { assert!(LANES == 16, "flags hold 16 lanes") };
    if lanes != 0 || *flags != 0 {
        *flags = lanes as u16;
        *any |= lanes != 0;
    }
}

/// Adds lanes to those noted as bad in this pass.
#[inline(always)]
fn add_note(flags: &mut Flags, lanes: u32, findings: &mut Findings) {
    if lanes != 0 {
        flags.bad |= lanes as u16;
        flags.outside |= lanes as u16;
        findings.bad = true;
    }
}
