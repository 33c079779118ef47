//! Forces of a block of 4x4x4 cells on its 6x6x6 nodes.
//!
//! Sums over the 27 nodes of a point factor into sums over three along each axis: first along y and z, for all cells of a plane at once
//! (lane `4 z + y`), then along x, for the points of sixteen cells at once. The way back is the transpose.

use super::{
    Step,
    flow::Flowing,
    gradients::{Matter, O, Stresses, Summed, Tangents},
    respond::{add_viscous, energy_of, largest_rate, respond_to},
    rule::Rule,
};
use crate::{
    memory::BlockMemory,
    nodes::{NodeBlock, Planes},
    simd::{F32x16, Lanes},
};

/// Forces on 6x6x6 nodes, times -1 [Pa cells^2]: `[component][x][piece]`, the pieces being 4x4 nodes here, from z = 4 on, from y = 4 on,
/// and from both on.
pub(super) type Tile = [[[F32x16; 4]; 6]; 3];

/// Tangents of points on 6x6x6 nodes, times volumes and weights [Pa cells^3], as a component of a [`Tile`].
pub(super) type TangentTile = [[F32x16; 4]; 6];

/// Of a block without stress.
pub(super) const NO_FORCES: Tile = [[[F32x16::ZERO; 4]; 6]; 3];
/// The same.
pub(super) const NO_TANGENTS: TangentTile = [[F32x16::ZERO; 4]; 6];

/// Memory between the stages.
pub(super) struct Scratch {
    /// Of displacements, per component; on the way back of forces.
    summed: [Summed; 3],
    stress: Stresses,
    tangents: Tangents,
}

impl Scratch {
    pub const EMPTY: Self = Self {
        summed: [[[[O; 4]; 3]; 6]; 3],
        stress: [[[[[O; 2]; 3]; 3]; 4]; 4],
        tangents: [[[O; 2]; 4]; 4],
    };
}

/// A vector and its neighbours one and two quarters on.
#[inline(always)]
fn along_z<V: Lanes>(low: V, high: V) -> [V; 3] {
    let one = low.shift_quarters::<1>(high);
    [low, one, low.shift_quarters::<2>(high)]
}

/// A vector and its neighbours one and two lanes on, within quarters.
#[inline(always)]
fn along_y<V: Lanes>(here: V, next: V) -> [V; 3] {
    let one = here.shift_in_quarters::<1>(next);
    [here, one, here.shift_in_quarters::<2>(next)]
}

/// Transpose of [`along_z`]: what falls on the vector, and on the one behind it.
#[inline(always)]
fn fold_z<V: Lanes>([l, c, r]: [V; 3], zero: V) -> [V; 2] {
    let low = l + (zero.shift_quarters::<3>(c) + zero.shift_quarters::<2>(r));
    let high = c.shift_quarters::<3>(zero) + r.shift_quarters::<2>(zero);
    [low, high]
}

/// Transpose of [`along_y`].
#[inline(always)]
fn fold_y<V: Lanes>([l, c, r]: [V; 3], zero: V) -> [V; 2] {
    let here = l + (zero.shift_in_quarters::<3>(c) + zero.shift_in_quarters::<2>(r));
    let next = c.shift_in_quarters::<3>(zero) + r.shift_in_quarters::<2>(zero);
    [here, next]
}

#[inline(always)]
fn two<V: Lanes>(from: &[F32x16; 2]) -> [V; 2] {
    [V::load(&from[0]), V::load(&from[1])]
}

/// Sums a field [cells] along y and z.
#[inline(always)]
fn gather<V: Lanes>(rule: &Rule<V>, field: [&Planes; 8], summed: &mut [Summed; 3]) {
    // Slopes come out doubled, so the field is taken by half.
    let half = V::splat(0.5);
    for a in 0..3 {
        for p in 0..6 {
            let (b, x) = (p / 4 * 4, p % 4);
            let y0z0 = V::load(&field[b][a][x]) * half;
            let y0z1 = V::load(&field[b + 1][a][x]) * half;
            let y1z0 = V::load(&field[b + 2][a][x]) * half;
            let y1z1 = V::load(&field[b + 3][a][x]) * half;
            let low = rule.both(along_y(y0z0, y1z0));
            let high = rule.both(along_y(y0z1, y1z1));
            let out = &mut summed[a][p];
            for y in 0..2 {
                let (values, slopes) = rule.both(along_z(low.0[y], high.0[y]));
                let across = rule.values(along_z(low.1[y], high.1[y]));
                for z in 0..2 {
                    values[z].store(&mut out[0][2 * y + z]);
                    across[z].store(&mut out[1][2 * y + z]);
                    slopes[z].store(&mut out[2][2 * y + z]);
                }
            }
        }
    }
}

/// Transpose of [`gradients`], of one component: `[kind]` and plane for plane.
#[inline(always)]
fn scatter_x<V: Lanes>(rule: &Rule<V>, stress: &Stresses, a: usize, summed: &mut Summed) {
    let zero = V::splat(0.0);
    for q in 0..4 {
        // What has fallen on the next two planes so far.
        let (mut next, mut after) = ([zero; 3], [zero; 3]);
        for x in 0..4 {
            let p = &stress[q][x][a];
            let parts = [
                rule.slopes_transposed(two(&p[0])),
                rule.values_transposed(two(&p[1])),
                rule.values_transposed(two(&p[2])),
            ];
            for kind in 0..3 {
                let [l, c, r] = parts[kind];
                (next[kind] + l).store(&mut summed[x][kind][q]);
                next[kind] = after[kind] + c;
                after[kind] = r;
            }
        }
        for kind in 0..3 {
            next[kind].store(&mut summed[4][kind][q]);
            after[kind].store(&mut summed[5][kind][q]);
        }
    }
}

/// Transpose of [`gather`], of one component, but for the half.
#[inline(always)]
fn scatter_yz<V: Lanes>(rule: &Rule<V>, summed: &Summed, tile: &mut [[F32x16; 4]; 6]) {
    let zero = V::splat(0.0);
    for p in 0..6 {
        let (mut values, mut slopes) = ([[zero; 2]; 2], [[zero; 2]; 2]);
        for y in 0..2 {
            let [value, across, slope] = &summed[p];
            let at = |of: &[F32x16; 4]| [of[2 * y], of[2 * y + 1]];
            let along_z = rule.both_transposed(two(&at(value)), two(&at(slope)));
            values[y] = fold_z(along_z, zero);
            slopes[y] = fold_z(rule.values_transposed(two(&at(across))), zero);
        }
        for z in 0..2 {
            let along_y =
                rule.both_transposed([values[0][z], values[1][z]], [slopes[0][z], slopes[1][z]]);
            let [here, next] = fold_y(along_y, zero);
            here.store(&mut tile[p][z]);
            next.store(&mut tile[p][2 + z]);
        }
    }
}

/// What a block of points makes of its nodes.
pub(super) struct Answers<'a> {
    /// Forces.
    pub tile: &'a mut Tile,
    /// Tangents, if asked for.
    pub tangents: &'a mut TangentTile,
    /// What its points remember.
    pub memory: &'a mut BlockMemory,
}

/// Spreads tangents of points over nodes.
#[inline(always)]
fn scatter_tangents<V: Lanes>(rule: &Rule<V>, tangents: &Tangents, tile: &mut TangentTile) {
    let zero = V::splat(0.0);
    let mut planes = [[zero; 4]; 6];
    for q in 0..4 {
        for x in 0..4 {
            let parts = rule.values_transposed(two(&tangents[q][x]));
            for (n, part) in parts.into_iter().enumerate() {
                planes[x + n][q] = planes[x + n][q] + part;
            }
        }
    }
    for p in 0..6 {
        let mut along_z = [[zero; 2]; 2];
        for y in 0..2 {
            let both = [planes[p][2 * y], planes[p][2 * y + 1]];
            along_z[y] = fold_z(rule.values_transposed(both), zero);
        }
        for z in 0..2 {
            let along_y = rule.values_transposed([along_z[0][z], along_z[1][z]]);
            let [here, next] = fold_y(along_y, zero);
            here.store(&mut tile[p][z]);
            next.store(&mut tile[p][2 + z]);
        }
    }
}

/// What a block of points makes of its nodes; the largest gradient of the velocity where there is viscosity or it is asked for [1/s].
#[inline(always)]
pub(super) fn forces<'a, V: Flowing>(
    nodes: [&NodeBlock; 8],
    matter: impl Iterator<Item = Matter<'a>>,
    rule: &Rule<V>,
    step: &Step,
    scratch: &mut Scratch,
    Answers {
        tile,
        tangents: tangent_tile,
        memory,
    }: Answers<'_>,
) -> f32 {
    let Scratch {
        summed,
        stress,
        tangents,
    } = scratch;
    let looks = step.wants_extremes;
    let mut matter = matter.enumerate().peekable();
    // All of it is held and has no stress; what is between the stages is that of another block.
    if matter.peek().is_none() {
        *tile = NO_FORCES;
        if looks {
            *tangent_tile = NO_TANGENTS;
        }
        return 0.0;
    }
    gather(rule, fields(nodes, |node| &node.u), summed);
    if looks {
        *tangents = Scratch::EMPTY.tangents;
    }
    let mut rate = 0.0_f32;
    for (n, here) in matter {
        // Blocks of several materials are few.
        let mut more = None;
        let into = match n {
            0 => &mut *stress,
            _ => more.insert(Scratch::EMPTY.stress),
        };
        let with = (memory.get_mut(n), step);
        let of_flow = respond_to(rule, summed, &here, with, into, tangents);
        if let Some(more) = &more {
            add::<V>(more, stress);
        }
        if step.viscosity > 0.0 || step.wants_rate {
            let mut rates = Scratch::EMPTY.summed;
            gather(rule, fields(nodes, |node| &node.v), &mut rates);
            let with = (of_flow.as_ref(), step.viscosity);
            let of_matter = match step.viscosity > 0.0 {
                true => add_viscous(rule, [summed, &rates], &here, with, stress),
                false => largest_rate(rule, &rates, &here),
            };
            rate = rate.max(of_matter);
        }
    }
    for a in 0..3 {
        scatter_x(rule, stress, a, &mut summed[a]);
        scatter_yz(rule, &summed[a], &mut tile[a]);
    }
    if looks {
        scatter_tangents(rule, tangents, tangent_tile);
    }
    rate
}

/// Elastic energy of a block of points [Pa cells^3].
#[inline(always)]
pub(super) fn energy<'a, V: Lanes>(
    nodes: [&NodeBlock; 8],
    matter: impl Iterator<Item = Matter<'a>>,
    memory: &BlockMemory,
    rule: &Rule<V>,
    scratch: &mut Scratch,
) -> f64 {
    let summed = &mut scratch.summed;
    gather(rule, fields(nodes, |node| &node.u), summed);
    let mut sum = 0.0;
    for (n, matter) in matter.enumerate() {
        sum += energy_of(rule, summed, &matter, memory.get(n));
    }
    sum
}

fn fields(nodes: [&NodeBlock; 8], of: fn(&NodeBlock) -> &Planes) -> [&Planes; 8] {
    nodes.map(of)
}

#[inline(always)]
fn add<V: Lanes>(more: &Stresses, stress: &mut Stresses) {
    let more = more.as_flattened().as_flattened().as_flattened();
    let sums = stress
        .as_flattened_mut()
        .as_flattened_mut()
        .as_flattened_mut();
    for (sum, more) in sums.as_flattened_mut().iter_mut().zip(more.as_flattened()) {
        (V::load(sum) + V::load(more)).store(sum);
    }
}
