//! Forces of a block of 4x4x4 cells on its 6x6x6 nodes.
//!
//! Sums over the 27 nodes of a point factor into sums over three along each axis: first along y and z, for all cells of a plane at once
//! (lane `4 z + y`), then along x, for the points of sixteen cells at once. The way back is the transpose.

use super::{SolidLaw, Step, rule::Rule};
use crate::{
    mat3::Mat3,
    materials::{
        Law,
        piola::{energy_of_gradient, first_piola},
    },
    simd::{F32x16, Lanes},
    solid::{
        nodes::{NodeBlock, Planes},
        volumes::{Filled, Volumes},
    },
};

const O: F32x16 = F32x16::ZERO;

/// Forces on 6x6x6 nodes, times -1 [Pa cells^2]: `[component][x][piece]`, the pieces being 4x4 nodes here, from z = 4 on, from y = 4 on,
/// and from both on.
pub(super) type Tile = [[[F32x16; 4]; 6]; 3];

/// Tangents of points on 6x6x6 nodes, times volumes and weights [Pa cells^3], as a component of a [`Tile`].
pub(super) type TangentTile = [[F32x16; 4]; 6];

/// A field summed along y and z: `[x plane][kind][2 y + z]`; kinds are the value, twice the slope along y, and that along z.
type Summed = [[[F32x16; 4]; 3]; 6];

/// First Piola-Kirchhoff stress times volume [Pa cells^3]: `[2 y + z][x cell][component][axis][x]`.
type Stresses = [[[[[F32x16; 2]; 3]; 3]; 4]; 4];

/// Tangent times volume [Pa cells^3]: `[2 y + z][x cell][x]`.
type Tangents = [[[F32x16; 2]; 4]; 4];

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

#[inline(always)]
fn three<V: Lanes>(summed: &Summed, x: usize, kind: usize, q: usize) -> [V; 3] {
    [
        V::load(&summed[x][kind][q]),
        V::load(&summed[x + 1][kind][q]),
        V::load(&summed[x + 2][kind][q]),
    ]
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

/// Gradients at the points -S and +S along x of sixteen cells.
#[inline(always)]
fn gradients<V: Lanes>(rule: &Rule<V>, summed: &[Summed; 3], x: usize, q: usize) -> [Mat3<V>; 2] {
    let zero = V::splat(0.0);
    let mut out = [Mat3([[zero; 3]; 3]); 2];
    for a in 0..3 {
        let along_x = rule.slopes(three(&summed[a], x, 0, q));
        let along_y = rule.values(three(&summed[a], x, 1, q));
        let along_z = rule.values(three(&summed[a], x, 2, q));
        for n in 0..2 {
            out[n].0[a] = [along_x[n], along_y[n], along_z[n]];
        }
    }
    out
}

/// The deformation gradient over the axes of the grid, of the gradient of displacements.
#[inline(always)]
fn deformation<V: Lanes>(rule: &Rule<V>, mut h: Mat3<V>) -> Mat3<V> {
    for a in 0..3 {
        for b in 0..3 {
            h.0[a][b] = h.0[a][b] + rule.rest.0[a][b];
        }
    }
    h
}

/// Where there is no matter, nodes may be anywhere: no displacement there.
#[inline(always)]
fn masked<V: Lanes>(h: Mat3<V>, volume: V) -> Mat3<V> {
    let zero = V::splat(0.0);
    Mat3::select(zero.lt(volume), &h, &Mat3([[zero; 3]; 3]))
}

/// Lamé's parameters [Pa], halved for the slopes, which are doubled.
#[inline(always)]
fn moduli<V: Lanes>(law: &SolidLaw) -> [V; 2] {
    [V::splat(0.5 * law.lambda), V::splat(0.5 * law.mu)]
}

/// A law that a loop over points is compiled for.
trait Stress {
    const LAW: Law;
    /// Whether a lane may take all others through an iteration of its own.
    const ITERATES: bool;
}

struct NeoHookean;

impl Stress for NeoHookean {
    const LAW: Law = Law::NeoHookean;
    const ITERATES: bool = false;
}

struct FixedCorotated;

impl Stress for FixedCorotated {
    const LAW: Law = Law::FixedCorotated;
    const ITERATES: bool = true;
}

/// Stress of all points, and their tangents added to `tangents` if `LOOKS`.
#[inline(always)]
fn respond<V: Lanes, S: Stress, const LOOKS: bool>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    matter: &Matter<'_>,
    stress: &mut Stresses,
    tangents: &mut Tangents,
) {
    let &Matter {
        law,
        volumes,
        filled,
    } = matter;
    let zero = V::splat(0.0);
    let [lambda, mu] = moduli::<V>(law);
    for q in 0..4 {
        for x in 0..4 {
            if !filled.has(q, x) {
                stress[q][x] = [[[O; 2]; 3]; 3];
                continue;
            }
            let h = gradients(rule, summed, x, q);
            for n in 0..2 {
                let volume = V::load(&volumes[q][x][n]);
                let h = if S::ITERATES {
                    masked(h[n], volume)
                } else {
                    h[n]
                };
                let f = deformation(rule, h);
                let answer = first_piola(S::LAW, &f, lambda * volume, mu * volume);
                if LOOKS {
                    let tangent = V::select(zero.lt(volume), answer.tangent, zero);
                    let sum = &mut tangents[q][x][n];
                    (V::load(sum) + tangent + tangent).store(sum);
                }
                for a in 0..3 {
                    for b in 0..3 {
                        answer.stress.0[a][b].store(&mut stress[q][x][a][b][n]);
                    }
                }
            }
        }
    }
}

/// Adds the second Piola-Kirchhoff stress of a Kelvin-Voigt solid, `S = time (lambda tr(E') I + 2 mu E')` with `E' = sym(F^T grad v)`:
/// no stress from turns. The largest Frobenius norm of `grad v` [1/s].
#[inline(always)]
fn add_viscous<V: Lanes>(
    rule: &Rule<V>,
    [u, v]: [&[Summed; 3]; 2],
    matter: &Matter<'_>,
    time: f32,
    stress: &mut Stresses,
) -> f32 {
    let &Matter {
        law,
        volumes,
        filled,
    } = matter;
    let (zero, half, one) = (V::splat(0.0), V::splat(0.5), V::splat(1.0));
    let [lambda, mu] = moduli::<V>(law);
    let at_rest = lambda.mul_add(V::splat(3.0), mu + mu);
    let mut largest = zero;
    for q in 0..4 {
        for x in 0..4 {
            if !filled.has(q, x) {
                continue;
            }
            let (h, rate) = (gradients(rule, u, x, q), gradients(rule, v, x, q));
            for n in 0..2 {
                let volume = V::load(&volumes[q][x][n]);
                let f = deformation(rule, masked(h[n], volume));
                let rate = masked(rate[n], volume);
                largest = largest.max(rate.norm_squared());
                let e = f.transpose().mul(&rate);
                let e = e.blend(half, &e.transpose(), half);
                let trace = e.0[0][0] + (e.0[1][1] + e.0[2][2]);
                // Its own tangent grows with the fourth power of the stretch: never beyond that of the law.
                let stretch = (f.norm_squared() - V::splat(2.0)).max(one);
                let tangent = first_piola(law.law, &f, lambda, mu).tangent;
                let share = (tangent / (at_rest * stretch * stretch)).min(one);
                let time = V::broadcast(time) * share * volume;
                let pressure = time * lambda * trace;
                let p = f.mul(&e.blend(time * (mu + mu), &Mat3::identity(), pressure));
                for a in 0..3 {
                    for b in 0..3 {
                        let sum = &mut stress[q][x][a][b][n];
                        (V::load(sum) + p.0[a][b]).store(sum);
                    }
                }
            }
        }
    }
    largest_lane(largest).sqrt()
}

#[inline(always)]
fn largest_lane<V: Lanes>(of: V) -> f32 {
    let mut lanes = O;
    of.store(&mut lanes);
    lanes.0.into_iter().fold(0.0, f32::max)
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

/// What a block of points is made of: a law and its volumes, one after the other.
pub(super) struct Matter<'a> {
    pub law: &'a SolidLaw,
    pub volumes: &'a Volumes,
    pub filled: Filled,
}

/// Stress of one law, and its tangents added to `tangents` if asked for.
#[inline(always)]
fn respond_to<V: Lanes>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    matter: &Matter<'_>,
    looks: bool,
    stress: &mut Stresses,
    tangents: &mut Tangents,
) {
    match (matter.law.law, looks) {
        (Law::NeoHookean, false) => {
            respond::<V, NeoHookean, false>(rule, summed, matter, stress, tangents);
        }
        (Law::NeoHookean, true) => {
            respond::<V, NeoHookean, true>(rule, summed, matter, stress, tangents);
        }
        (_, false) => {
            respond::<V, FixedCorotated, false>(rule, summed, matter, stress, tangents);
        }
        (_, true) => {
            respond::<V, FixedCorotated, true>(rule, summed, matter, stress, tangents);
        }
    }
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

/// Forces of a block of points in its tile, tangents in theirs if asked for; the largest gradient of the velocity where there is
/// viscosity [1/s].
#[inline(always)]
pub(super) fn forces<'a, V: Lanes>(
    nodes: [&NodeBlock; 8],
    matter: impl Iterator<Item = Matter<'a>>,
    rule: &Rule<V>,
    step: &Step,
    scratch: &mut Scratch,
    (tile, tangent_tile): (&mut Tile, &mut TangentTile),
) -> f32 {
    let Scratch {
        summed,
        stress,
        tangents,
    } = scratch;
    gather(rule, fields(nodes, |node| &node.u), summed);
    let looks = step.wants_extremes;
    if looks {
        *tangents = Scratch::EMPTY.tangents;
    }
    let mut rate = 0.0_f32;
    for (n, here) in matter.enumerate() {
        if n == 0 {
            respond_to(rule, summed, &here, looks, stress, tangents);
        } else {
            // Blocks of several materials are few.
            let mut more = Scratch::EMPTY.stress;
            respond_to(rule, summed, &here, looks, &mut more, tangents);
            add::<V>(&more, stress);
        }
        if step.viscosity > 0.0 {
            let mut rates = Scratch::EMPTY.summed;
            gather(rule, fields(nodes, |node| &node.v), &mut rates);
            let of_matter = add_viscous(rule, [summed, &rates], &here, step.viscosity, stress);
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
    rule: &Rule<V>,
    scratch: &mut Scratch,
) -> f64 {
    let summed = &mut scratch.summed;
    gather(rule, fields(nodes, |node| &node.u), summed);
    let mut sum = 0.0;
    for Matter { law, volumes, .. } in matter {
        sum += match law.law {
            Law::NeoHookean => stored::<V, NeoHookean>(rule, summed, volumes, law),
            _ => stored::<V, FixedCorotated>(rule, summed, volumes, law),
        };
    }
    sum
}

/// Elastic energy of the points of one law [Pa cells^3].
#[inline(always)]
fn stored<V: Lanes, S: Stress>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    volumes: &Volumes,
    law: &SolidLaw,
) -> f64 {
    let (lambda, mu) = (V::splat(law.lambda), V::splat(law.mu));
    let (mut sum, mut lanes) = (0.0, O);
    for q in 0..4 {
        for x in 0..4 {
            let h = gradients(rule, summed, x, q);
            for n in 0..2 {
                let volume = V::load(&volumes[q][x][n]);
                let h = masked(h[n], volume).mul_transposed(&rule.rest);
                let density = energy_of_gradient(S::LAW, &h, lambda, mu);
                (volume * density).store(&mut lanes);
                for lane in lanes.0 {
                    sum += f64::from(lane);
                }
            }
        }
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
