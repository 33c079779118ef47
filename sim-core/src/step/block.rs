//! Kernel of the particle pass: one stage over the particles of one block.

use super::{
    constitutive::{Answer, Constitutive, Deformed},
    gather::{Gathered, gather},
    lanes::{cells_in_use, load3, load9, store3, store9},
    particle_pass::{Findings, Pass, Stage, Work},
    scatter::Accumulator,
    stencil::Stencil,
    touch::{BlockTouch, anchor},
};
use crate::{
    grid::{Cells, NONE, TILE, Tile, Velocities},
    kinematics::advance_deformation,
    mat3::{Mat3, dot},
    num::Real,
    particles::{BLOCK, Block, Extremes, Fixed, Flags, Group, Motion},
    simd::{F32x16, LANES, Lanes},
};

#[inline(always)]
pub(super) fn block<V: Constitutive>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    nodes: &[Velocities],
) -> Findings {
    match pass.stage {
        Stage::Scatter | Stage::Forces => staged::<V, false, true>(pass, work, nodes),
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

/// Extremes of a run, one lane each.
struct Largest<V> {
    speed: V,
    rate: V,
    stretch: V,
    min_j: V,
    max_j: V,
    stiffness: V,
    reach: V,
}

impl<V: Lanes> Largest<V> {
    #[inline(always)]
    fn none() -> Self {
        let zero = V::broadcast(0.0);
        Self {
            speed: zero,
            rate: zero,
            stretch: zero,
            min_j: V::broadcast(f32::INFINITY),
            max_j: zero,
            stiffness: zero,
            reach: zero,
        }
    }

    /// Takes in where particles are in the end; unused lanes are at the centre.
    #[inline(always)]
    fn take_place(&mut self, x: [V; 3]) {
        let [x, y, z] = x;
        self.reach = self.reach.max(x.abs().max(y.abs().max(z.abs())));
    }

    /// Takes in speed and velocity gradient of moved particles.
    #[inline(always)]
    fn take_motion(&mut self, live: V::Mask, speed_squared: V, rate_squared: V) {
        let zero = V::broadcast(0.0);
        self.speed = self.speed.max(V::select(live, speed_squared, zero));
        self.rate = self.rate.max(V::select(live, rate_squared, zero));
    }

    /// Takes in the law's answer about group `n` of a pair; returns the lanes that are turned inside out.
    #[inline(always)]
    fn take_answer(&mut self, live: V::Mask, answer: &Answer, n: usize) -> V::Mask {
        let zero = V::broadcast(0.0);
        let stretch = V::load(&answer.stretch_squared[n]);
        let stiffness = V::load(&answer.stiffness[n]);
        let j = V::load(&answer.j[n]);
        self.stretch = self.stretch.max(V::select(live, stretch, zero));
        self.stiffness = self.stiffness.max(V::select(live, stiffness, zero));
        self.max_j = self.max_j.max(V::select(live, j, zero));
        self.min_j = self.min_j.min(V::select(live, j, self.min_j));
        // Written so that NaN counts as bad.
        !zero.lt(j)
    }

    #[inline(always)]
    fn extremes(self) -> Extremes {
        let fold = |v: V, f: fn(f32, f32) -> f32| {
            let mut lanes = F32x16::ZERO;
            v.store(&mut lanes);
            lanes.0.into_iter().reduce(f).unwrap_or(0.0)
        };
        Extremes {
            speed_squared: fold(self.speed, f32::max),
            rate_squared: fold(self.rate, f32::max),
            stretch_squared: fold(self.stretch, f32::max),
            min_j: fold(self.min_j, f32::min),
            max_j: fold(self.max_j, f32::max),
            stiffness: fold(self.stiffness, f32::max),
            reach: fold(self.reach, f32::max),
        }
    }
}

/// What a moved particle is checked against.
struct Limits<V> {
    dt: V,
    /// The carrier's velocity [cells/s] and displacement [cells].
    carrier: [[V; 3]; 2],
    /// Square of the largest `dt |C|`.
    strain_squared: V,
    /// Corners of the domain, relative to the block's centre [cells].
    domain: [[V; 3]; 2],
}

impl<V: Lanes> Limits<V> {
    #[inline(always)]
    fn new(pass: &Pass<'_>, block: &Block) -> Self {
        let mut domain = [[V::broadcast(0.0); 3]; 2];
        let mut carrier = domain;
        for a in 0..3 {
            carrier[0][a] = V::broadcast(pass.carrier[a] as f32);
            carrier[1][a] = V::broadcast((f64::from(pass.dt) * pass.carrier[a]) as f32);
        }
        for n in 0..2 {
            for a in 0..3 {
                let centre = f64::from(BLOCK * block.index[a]) + 1.5;
                domain[n][a] = V::broadcast((pass.domain[n][a] - centre) as f32);
            }
        }
        Self {
            dt: V::broadcast(pass.dt),
            carrier,
            strain_squared: V::broadcast(pass.max_strain * pass.max_strain),
            domain,
        }
    }
}

/// Sixteen particles after gathering and advancing.
struct Moved<V: Real> {
    v: [V; 3],
    c: Mat3<V>,
    bad: V::Mask,
    outside: V::Mask,
}

/// Gathers from the grid and advances position and deformation; lanes that are not `live` stay as they are.
#[inline(always)]
fn advance<V: Lanes>(
    group: &mut Group,
    shape: Option<&mut [F32x16; 9]>,
    deforms: bool,
    live: V::Mask,
    velocities: &Tile,
    limits: &Limits<V>,
    touch: Option<(&BlockTouch<'_>, &[u32; LANES])>,
    largest: &mut Largest<V>,
) -> Moved<V> {
    let zero = V::broadcast(0.0);
    let x = load3::<V>(&group.x);
    let Gathered { mut v, mut c, .. } = gather(velocities, &Stencil::new(x));
    if let Some((touch, ids)) = touch {
        let mut gathered = Motion::REST;
        store3(v, &mut gathered.v);
        store9(&c, &mut gathered.c);
        touch.shield(ids, &group.x, velocities, &mut gathered);
        (v, c) = (load3(&gathered.v), load9(&gathered.c));
    }
    let dt = V::select(live, limits.dt, zero);
    let shift = &limits.carrier[1];
    let x = [
        dt.mul_add(v[0], V::select(live, shift[0], zero)) + x[0],
        dt.mul_add(v[1], V::select(live, shift[1], zero)) + x[1],
        dt.mul_add(v[2], V::select(live, shift[2], zero)) + x[2],
    ];
    store3(x, &mut group.x);
    let mut increment = c;
    for i in 0..3 {
        for j in 0..3 {
            increment.0[i][j] = dt * c.0[i][j];
        }
    }
    if deforms {
        store9(
            &advance_deformation(&load9(&group.f), &increment),
            &mut group.f,
        );
    }
    if let Some(shape) = shape {
        store9(&advance_deformation(&load9(shape), &increment), shape);
    }
    judge(x, v, c, increment.norm_squared(), live, limits, largest)
}

/// Checks moved particles against the limits.
#[inline(always)]
fn judge<V: Lanes>(
    x: [V; 3],
    v: [V; 3],
    c: Mat3<V>,
    strain_squared: V,
    live: V::Mask,
    limits: &Limits<V>,
    largest: &mut Largest<V>,
) -> Moved<V> {
    let u = &limits.carrier[0];
    let total = [v[0] + u[0], v[1] + u[1], v[2] + u[2]];
    let bad = !strain_squared.lt(limits.strain_squared);
    let mut outside = bad;
    for a in 0..3 {
        outside = outside | x[a].lt(limits.domain[0][a]) | limits.domain[1][a].lt(x[a]);
    }
    largest.take_motion(live, dot(total, total), c.norm_squared());
    Moved { v, c, bad, outside }
}

/// Lanes whose motion is NaN, infinite or too fast for any substep.
#[inline(always)]
fn absurd<V: Lanes>(pass: &Pass<'_>, motion: &Motion) -> V::Mask {
    let v = load3::<V>(&motion.v);
    let speed = dot(v, v).lt(V::broadcast(pass.max_speed * pass.max_speed));
    let rate = load9::<V>(&motion.c).norm_squared();
    !(speed & rate.lt(V::broadcast(pass.max_rate * pass.max_rate)))
}

#[inline(always)]
fn staged<V: Constitutive, const GATHER: bool, const SCATTER: bool>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    nodes: &[Velocities],
) -> Findings {
    // Private and in the first-level cache.
    let mut velocity_tile = Tile::ZERO;
    let mut momentum_tile = Tile::ZERO;
    if GATHER {
        load_velocities(&work.nodes_of[0], nodes, work.cells, &mut velocity_tile);
        if let Some(next) = work.nodes_of.get(1) {
            prefetch_velocities(next, nodes, work.cells);
        }
        prefetch_tile(work.tile, work.cells);
    }
    let mut cells = [(V::splat(4.0), V::splat(-1.0)); 3];
    let mut accumulator = Accumulator::<V>::new();
    let mut findings = Findings::default();
    // What two groups hand from one loop to the next stays in the first-level cache.
    let mut motion = [Motion::REST; 2];
    let mut dt = [F32x16::ZERO; 2];
    let mut answer = Answer::EMPTY;
    let limits = Limits::<V>::new(pass, work.block);
    let (origin, first_shape) = (work.block.groups.start, work.block.shapes.start);
    let touch = match pass.touch {
        None => None,
        Some(touch) => {
            let carrier = [pass.carrier, pass.next_carrier];
            BlockTouch::new(touch, work.block, work.concerned, carrier, pass.next_keep)
        }
    };
    for run in work.runs.iter_mut() {
        let mut largest = Largest::none();
        let law = &pass.laws[run.part];
        let deforms = law.visible || !law.law.is_fluid();
        let remembers = law.law.is_plastic() || law.law.is_fluid();
        // Two groups at a time; the law sees an odd last one twice.
        for first in (run.groups.start..run.groups.end).step_by(2) {
            let members = first - origin..(first + 2).min(run.groups.end) - origin;
            prefetch(work.groups, work.fixed, work.memory, members.end, deforms);
            for (n, g) in members.clone().enumerate() {
                let (group, flags) = (&mut work.groups[g], &mut work.flags[g]);
                let live = V::broadcast(0.0).lt(V::load(&work.fixed[g].mass));
                let mut shape = None;
                if !run.shapes.is_empty() {
                    let at = run.shapes.start + (g + origin - run.groups.start) - first_shape;
                    shape = Some(&mut work.shapes[at].0);
                    if !GATHER {
                        if pass.stage == Stage::Scatter {
                            work.backup.shapes[at] = work.shapes[at];
                        }
                        shape = None;
                    }
                }
                if GATHER {
                    let before = group.x;
                    let moved = advance(
                        group,
                        shape,
                        deforms,
                        live,
                        &velocity_tile,
                        &limits,
                        touch.as_ref().map(|touch| (touch, &work.fixed[g].id)),
                        &mut largest,
                    );
                    V::select(live, limits.dt, V::broadcast(0.0)).store(&mut dt[n]);
                    note(
                        &mut flags.bad,
                        V::mask_bits(live & moved.bad),
                        &mut findings.bad,
                    );
                    if !SCATTER {
                        let outside = V::mask_bits(live & moved.outside);
                        note(&mut flags.outside, outside, &mut findings.outside);
                    }
                    store3(moved.v, &mut motion[n].v);
                    store9(&moved.c, &mut motion[n].c);
                    if let Some(touch) = &touch {
                        let ids = &work.fixed[g].id;
                        let x = &mut group.x;
                        let speed = touch.after(ids, &before, x, &mut motion[n]);
                        largest.speed = largest.speed.max(V::broadcast(speed));
                    }
                } else if pass.stage == Stage::Forces {
                    motion[n] = Motion::REST;
                } else {
                    work.backup.groups[g] = *group;
                    work.backup.memory[g] = work.memory[g];
                    motion[n] = work.motion[g];
                    let bad = absurd::<V>(pass, &motion[n]);
                    note(&mut flags.bad, V::mask_bits(live & bad), &mut findings.bad);
                }
            }
            let mut held = [0; 2];
            if SCATTER && let Some(touch) = &touch {
                for (n, g) in members.clone().enumerate() {
                    held[n] = touch.before(&work.fixed[g].id, &work.groups[g].x, &mut motion[n]);
                }
            }
            let (one, two) = (members.start, members.end - 1);
            if members.len() == 1 {
                (motion[1], dt[1]) = (motion[0], dt[0]);
            }
            let deformed = Deformed {
                f: [&work.groups[one].f, &work.groups[two].f],
                memory: [&work.memory[one], &work.memory[two]],
                motion: &motion,
                dt,
            };
            V::respond(law, &deformed, &mut answer);
            for (n, g) in members.enumerate() {
                let x = load3(&work.groups[g].x);
                let live = V::broadcast(0.0).lt(V::load(&work.fixed[g].mass));
                if GATHER {
                    largest.take_place(x);
                    if law.law.is_plastic() {
                        work.groups[g].f = answer.f[n];
                    }
                    if remembers {
                        work.memory[g] = answer.memory[n];
                    }
                    let inverted = V::mask_bits(live & largest.take_answer(live, &answer, n));
                    add_note(&mut work.flags[g], inverted, &mut findings);
                }
                if SCATTER {
                    let stencil = Stencil::<V>::new(x);
                    for a in 0..3 {
                        let (low, high) = &mut cells[a];
                        *low = V::select(live, low.min(stencil.cell[a]), *low);
                        *high = V::select(live, high.max(stencil.cell[a]), *high);
                    }
                    if let Some(kept) = pass.affine_kept
                        && !law.law.is_rigid()
                    {
                        keep_affine::<V>(&motion[n].c, kept, &mut answer.affine[n]);
                    }
                    let mut mass = V::load(&work.fixed[g].mass);
                    if held[n] != 0 {
                        let light = &work.fixed[g].mass;
                        let heavy = anchor(held[n], light, &motion[n], &mut answer.affine[n]);
                        mass = V::load(&heavy);
                    }
                    let v = load3(&motion[n].v);
                    let affine = load9(&answer.affine[n]);
                    accumulator.scatter(&mut momentum_tile, &stencil, mass, v, &affine);
                } else {
                    work.motion[g] = motion[n];
                }
            }
        }
        if GATHER {
            run.extremes = largest.extremes();
        }
    }
    if SCATTER {
        accumulator.flush(&mut momentum_tile);
        *work.cells = cells_in_use(cells);
        momentum_tile.pack::<V>(work.cells, work.tile);
    }
    findings
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

/// Asks for the velocities that the next block will load, taking its cells in use for those of this one.
#[inline(always)]
fn prefetch_velocities(nodes_of: &[u32; 27], nodes: &[Velocities], cells: &Cells) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let [(x0, x1), (y0, y1), _] = *cells;
        for i in x0 - 1..=x1 + 1 {
            for j in y0 - 1..=y1 + 1 {
                let column = 9 * ((i + BLOCK) / BLOCK) + 3 * ((j + BLOCK) / BLOCK);
                let row = BLOCK * (i & (BLOCK - 1)) + (j & (BLOCK - 1));
                for k in 0..3 {
                    let block = nodes_of[(column + k) as usize] as usize;
                    let at = nodes.as_ptr().wrapping_add(block).cast::<F32x16>();
                    // SAFETY: a hint.
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(row as usize).cast()) };
                }
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (nodes_of, nodes, cells);
}

/// Asks for the part of a packed tile that is going to be written.
#[inline(always)]
fn prefetch_tile(tile: &Tile, cells: &Cells) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_ET0, _mm_prefetch};
        // A block that lost all its particles has no cells.
        let edges = cells.iter().map(|(low, high)| (high - low + 3).max(0));
        let nodes: i32 = edges.product();
        let start = tile.0.as_ptr().cast::<i8>();
        for line in 1..=(nodes as usize).div_ceil(4) {
            // SAFETY: a hint.
            unsafe { _mm_prefetch::<_MM_HINT_ET0>(start.wrapping_add(64 * line)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (tile, cells);
}

/// Asks for the two groups from `next` on while the two before them are worked on.
#[inline(always)]
fn prefetch(groups: &[Group], fixed: &[Fixed], memory: &[F32x16], next: usize, deforms: bool) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let end = (next + 2).min(groups.len());
        for g in next..end {
            let group = (&raw const groups[g]).cast::<i8>();
            // Positions come first; a fluid's deformation is not read.
            let bytes = if deforms { size_of::<Group>() } else { 192 };
            for line in 0..bytes / 64 {
                // SAFETY: a hint; the address is inside the group.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(group.add(64 * line)) };
            }
            // SAFETY: hints; the addresses are those of references.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>((&raw const fixed[g].mass).cast());
                _mm_prefetch::<_MM_HINT_T0>((&raw const memory[g]).cast());
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (groups, fixed, memory, next, deforms);
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
