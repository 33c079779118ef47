//! Particle pass: gather, advance, constitutive law, scatter, block by block.

use rayon::prelude::*;

use super::{gather::gather, scatter::Accumulator, stencil::Stencil};
use crate::{
    grid::{Grid, NONE, TILE, Tile, TileFloats, Velocities},
    kinematics::advance_deformation,
    mat3::{Mat3, dot},
    materials::{Coefficients, Law, Trial, limits::max_stretch_squared},
    num::Real,
    particles::{BLOCK, Block, Extremes, Fixed, Flags, Group, Motion, Particles, Run},
    simd::{F32x16, Isa, LANES, Lanes, Pair, Portable},
};

#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};

/// Particle blocks per task at least.
const TASK: usize = 4;

/// What a particle pass does. A segment of substeps begins with a scatter, goes on fused, ends with a gather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Particle velocities to the grid; positions and deformations are copied to `backup` on the way.
    Scatter,
    /// Grid to particles, advance, particles to grid: velocities never leave the registers.
    Fused,
    /// Grid to particles, advance, velocities written out.
    Gather,
}

/// Law and parameters of one object in a pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObjectLaw {
    /// Constitutive law.
    pub law: Law,
    /// Its numbers.
    pub coefficients: Coefficients<f64>,
    /// `4 dt / (rho0 dx^2)` of the coming substep: Kirchhoff stress [Pa] to affine velocity [1/s].
    pub stress_scale: f32,
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
    /// Per object.
    pub laws: &'a [ObjectLaw],
    /// Largest `dt |C|` (Frobenius) that passes the guard.
    pub max_strain: f32,
    /// Largest speed [cells/s] and `|C|` [1/s] that a segment may start with.
    pub max_speed: f32,
    /// See `max_speed`.
    pub max_rate: f32,
    /// Smallest and largest position [cells].
    pub domain: [[f64; 3]; 2],
}

/// The parts of a block that one task owns.
struct Work<'a> {
    block: &'a Block,
    nodes_of: &'a [u32; 27],
    runs: &'a mut [Run],
    groups: &'a mut [Group],
    backup: &'a mut [Group],
    motion: &'a mut [Motion],
    fixed: &'a [Fixed],
    flags: &'a mut [Flags],
    tile: &'a mut Tile,
}

/// Whether the pass met lanes that [`Flags`] now names.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Findings {
    /// Some lane is bad: the substep must be rolled back.
    pub bad: bool,
    /// Some lane left the domain.
    pub outside: bool,
}

/// Runs one stage over all particles. `backup` receives the groups as they were in [`Stage::Scatter`];
/// `motion_out` the velocities in [`Stage::Gather`].
pub(crate) fn particle_pass(
    isa: Isa,
    pass: &Pass<'_>,
    particles: &mut Particles,
    backup: &mut [Group],
    motion_out: &mut [Motion],
    grid: &mut Grid,
) -> Findings {
    let Grid {
        tiles,
        nodes_of,
        velocities,
        ..
    } = grid;
    let velocities = velocities.as_slice();
    let mut rest = (
        particles.runs.as_mut_slice(),
        particles.groups.as_mut_slice(),
        backup,
        match pass.stage {
            Stage::Gather => motion_out,
            Stage::Scatter | Stage::Fused => particles.motion.as_mut_slice(),
        },
        particles.fixed.as_slice(),
        particles.flags.as_mut_slice(),
    );
    let mut work = Vec::with_capacity(particles.blocks.len());
    for ((block, nodes_of), tile) in particles.blocks.iter().zip(&*nodes_of).zip(tiles) {
        let count = block.groups.len();
        let (runs, more_runs) = rest.0.split_at_mut(block.runs.len());
        let (groups, more_groups) = rest.1.split_at_mut(count);
        let (backup, more_backup) = rest.2.split_at_mut(count);
        let (motion, more_motion) = rest.3.split_at_mut(count);
        let (fixed, more_fixed) = rest.4.split_at(count);
        let (flags, more_flags) = rest.5.split_at_mut(count);
        rest = (
            more_runs,
            more_groups,
            more_backup,
            more_motion,
            more_fixed,
            more_flags,
        );
        work.push(Work {
            block,
            nodes_of,
            runs,
            groups,
            backup,
            motion,
            fixed,
            flags,
            tile,
        });
    }
    work.into_par_iter()
        .with_min_len(TASK)
        .map(|mut work| match isa {
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

#[inline(always)]
fn block<V: Lanes>(pass: &Pass<'_>, work: &mut Work<'_>, nodes: &[Velocities]) -> Findings {
    match pass.stage {
        Stage::Scatter => staged::<V, false, true>(pass, work, nodes),
        Stage::Fused => staged::<V, true, true>(pass, work, nodes),
        Stage::Gather => staged::<V, true, false>(pass, work, nodes),
    }
}

/// Copies the velocities of the nodes in use around a block into a tile.
#[inline(always)]
fn load_velocities(
    nodes_of: &[u32; 27],
    nodes: &[Velocities],
    cells: &[(i32, i32); 3],
    to: &mut TileFloats,
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

#[inline(always)]
fn load3<V: Lanes>(from: &[F32x16; 3]) -> [V; 3] {
    [V::load(&from[0]), V::load(&from[1]), V::load(&from[2])]
}

#[inline(always)]
fn load9<V: Lanes>(m: &[F32x16; 9]) -> Mat3<V> {
    Mat3([
        [V::load(&m[0]), V::load(&m[1]), V::load(&m[2])],
        [V::load(&m[3]), V::load(&m[4]), V::load(&m[5])],
        [V::load(&m[6]), V::load(&m[7]), V::load(&m[8])],
    ])
}

#[inline(always)]
fn store3<V: Lanes>(v: [V; 3], to: &mut [F32x16; 3]) {
    for a in 0..3 {
        v[a].store(&mut to[a]);
    }
}

#[inline(always)]
fn store9<V: Lanes>(m: &Mat3<V>, to: &mut [F32x16; 9]) {
    for i in 0..3 {
        for j in 0..3 {
            m.0[i][j].store(&mut to[3 * i + j]);
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
        }
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
    live: V::Mask,
    velocities: &TileFloats,
    limits: &Limits<V>,
    largest: &mut Largest<V>,
) -> Moved<V> {
    let zero = V::broadcast(0.0);
    let x = load3::<V>(&group.x);
    let (v, c) = gather(velocities, &Stencil::new(x));
    let dt = V::select(live, limits.dt, zero);
    let [u, shift] = &limits.carrier;
    let x = [
        dt.mul_add(v[0], V::select(live, shift[0], zero)) + x[0],
        dt.mul_add(v[1], V::select(live, shift[1], zero)) + x[1],
        dt.mul_add(v[2], V::select(live, shift[2], zero)) + x[2],
    ];
    let total = [v[0] + u[0], v[1] + u[1], v[2] + u[2]];
    let mut increment = c;
    for i in 0..3 {
        for j in 0..3 {
            increment.0[i][j] = dt * c.0[i][j];
        }
    }
    let f = advance_deformation(&load9(&group.f), &increment);
    store3(x, &mut group.x);
    store9(&f, &mut group.f);
    let j = f.det();
    let good = zero.lt(j) & increment.norm_squared().lt(limits.strain_squared);
    let mut outside = !good;
    for a in 0..3 {
        outside = outside | x[a].lt(limits.domain[0][a]) | limits.domain[1][a].lt(x[a]);
    }
    let max = |old: V, new: V| old.max(V::select(live, new, zero));
    largest.speed = max(largest.speed, dot(total, total));
    largest.rate = max(largest.rate, c.norm_squared());
    largest.stretch = max(largest.stretch, max_stretch_squared(&f));
    largest.max_j = max(largest.max_j, j);
    largest.min_j = largest.min_j.min(V::select(live, j, largest.min_j));
    Moved {
        v,
        c,
        bad: !good,
        outside,
    }
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
fn both<V: Lanes>(value: f32) -> Pair<V> {
    Pair(V::broadcast(value), V::broadcast(value))
}

/// `A = C - 4 dt / (rho0 dx^2) tau` of two groups: what the particles carry to the grid besides velocity
/// (MLS-MPM, Hu et al. 2018).
#[inline(always)]
fn affine_matrices<V: Lanes>(
    law: &ObjectLaw,
    f: [&[F32x16; 9]; 2],
    motion: &[Motion; 2],
) -> [[F32x16; 9]; 2] {
    let [one, two] = f;
    let mut f = Mat3([[both::<V>(0.0); 3]; 3]);
    for i in 0..3 {
        for j in 0..3 {
            f.0[i][j] = Pair(V::load(&one[3 * i + j]), V::load(&two[3 * i + j]));
        }
    }
    let zero = both::<V>(0.0);
    let trial = Trial {
        f,
        memory: zero,
        gradient: Mat3([[zero; 3]; 3]),
        dt: zero,
    };
    let t = law.law.respond(&trial, &law.coefficients.splat()).tau;
    let t = [t[0], t[1], t[2], t[1], t[3], t[4], t[2], t[4], t[5]];
    let scale = both::<V>(-law.stress_scale);
    let mut out = [[F32x16::ZERO; 9]; 2];
    for n in 0..9 {
        let [one, two] = motion;
        let c = Pair(V::load(&one.c[n]), V::load(&two.c[n]));
        let Pair(one, two) = scale.mul_add(t[n], c);
        one.store(&mut out[0][n]);
        two.store(&mut out[1][n]);
    }
    out
}

#[inline(always)]
fn staged<V: Lanes, const GATHER: bool, const SCATTER: bool>(
    pass: &Pass<'_>,
    work: &mut Work<'_>,
    nodes: &[Velocities],
) -> Findings {
    let mut velocity_tile = TileFloats::ZERO;
    if GATHER {
        load_velocities(work.nodes_of, nodes, &work.tile.cells, &mut velocity_tile);
    }
    if SCATTER {
        work.tile.clear();
    }
    let mut cells = [(V::splat(4.0), V::splat(-1.0)); 3];
    let mut accumulator = Accumulator::<V>::new();
    let mut findings = Findings::default();
    // Velocities of two groups stay in the first-level cache between the loops below.
    let mut motion = [Motion::REST; 2];
    let limits = Limits::<V>::new(pass, work.block);
    let origin = work.block.groups.start;
    for run in work.runs.iter_mut() {
        let mut largest = Largest::none();
        // Two groups at a time hide the latency of the law, which sees an odd last one twice.
        for first in (run.groups.start..run.groups.end).step_by(2) {
            let members = first - origin..(first + 2).min(run.groups.end) - origin;
            prefetch(work.groups, members.end);
            for (n, g) in members.clone().enumerate() {
                let (group, flags) = (&mut work.groups[g], &mut work.flags[g]);
                let live = V::broadcast(0.0).lt(V::load(&work.fixed[g].mass));
                if GATHER {
                    let moved = advance(group, live, &velocity_tile, &limits, &mut largest);
                    note(
                        &mut flags.bad,
                        V::mask_bits(live & moved.bad),
                        &mut findings.bad,
                    );
                    let to = if SCATTER {
                        &mut motion[n]
                    } else {
                        let outside = V::mask_bits(live & moved.outside);
                        note(&mut flags.outside, outside, &mut findings.outside);
                        &mut work.motion[g]
                    };
                    store3(moved.v, &mut to.v);
                    store9(&moved.c, &mut to.c);
                } else {
                    work.backup[g] = *group;
                    motion[n] = work.motion[g];
                    let bad = absurd::<V>(pass, &motion[n]);
                    note(&mut flags.bad, V::mask_bits(live & bad), &mut findings.bad);
                }
            }
            if SCATTER {
                let law = &pass.laws[run.object];
                let f = [
                    &work.groups[members.start].f,
                    &work.groups[members.end - 1].f,
                ];
                let affine = affine_matrices::<V>(law, f, &motion);
                for (n, g) in members.enumerate() {
                    let stencil = Stencil::<V>::new(load3(&work.groups[g].x));
                    for a in 0..3 {
                        cells[a].0 = cells[a].0.min(stencil.cell[a]);
                        cells[a].1 = cells[a].1.max(stencil.cell[a]);
                    }
                    let mass = V::load(&work.fixed[g].mass);
                    let v = load3(&motion[n].v);
                    let affine = load9(&affine[n]);
                    accumulator.scatter(work.tile, &stencil, mass, v, &affine);
                }
            }
        }
        if GATHER {
            run.extremes = largest.extremes();
        }
    }
    if SCATTER {
        accumulator.flush(work.tile);
        work.tile.cells = cells.map(|(low, high)| {
            let fold = |v: V, f: fn(f32, f32) -> f32| {
                let mut lanes = F32x16::ZERO;
                v.store(&mut lanes);
                lanes.0.into_iter().reduce(f).unwrap_or(0.0) as i32
            };
            (fold(low, f32::min), fold(high, f32::max))
        });
    }
    findings
}

/// Asks for the two groups from `next` on while the two before them are worked on.
#[inline(always)]
fn prefetch(groups: &[Group], next: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let end = (next + 2).min(groups.len());
        for g in next..end {
            let group = (&raw const groups[g]).cast::<i8>();
            for line in 0..size_of::<Group>() / 64 {
                // SAFETY: a hint; the address is inside the group.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(group.add(64 * line)) };
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (groups, next);
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
