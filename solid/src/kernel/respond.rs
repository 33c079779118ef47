//! Stress, tangent and energy of the points of a block, sixteen at a time.

use super::{
    SolidLaw, Step,
    flow::{Flowing, FlowingPart, stored_beside_flow},
    gradients::{Matter, O, Stresses, Summed, Tangents, deformation, gradients, masked},
    rule::Rule,
};
use crate::{
    mat3::Mat3,
    materials::{
        Family,
        piola::{PiolaLaw, energy_of_gradient, first_piola},
    },
    memory::PartMemory,
    simd::Lanes,
    volumes::Volumes,
};

/// Lamé's parameters [Pa], halved for the slopes, which are doubled.
#[inline(always)]
fn moduli<V: Lanes>(law: &SolidLaw) -> [V; 2] {
    [V::splat(0.5 * law.lambda), V::splat(0.5 * law.mu)]
}

/// A law that a loop over points is compiled for.
trait Stress {
    const LAW: PiolaLaw;
    /// Whether a lane may take all others through an iteration of its own.
    const ITERATES: bool;
}

struct NeoHookean;

impl Stress for NeoHookean {
    const LAW: PiolaLaw = PiolaLaw::NeoHookean;
    const ITERATES: bool = false;
}

struct FixedCorotated;

impl Stress for FixedCorotated {
    const LAW: PiolaLaw = PiolaLaw::FixedCorotated;
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
pub(super) fn add_viscous<V: Lanes>(
    rule: &Rule<V>,
    [u, v]: [&[Summed; 3]; 2],
    matter: &Matter<'_>,
    (of_flow, time): (Option<&Tangents>, f32),
    stress: &mut Stresses,
) -> f32 {
    let &Matter {
        law,
        volumes,
        filled,
    } = matter;
    let (zero, half, one) = (V::splat(0.0), V::splat(0.5), V::splat(1.0));
    let least = V::splat(1e-30);
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
                let h = masked(h[n], volume);
                let f = deformation(rule, h);
                let rate = masked(rate[n], volume);
                largest = largest.max(rate.norm_squared());
                let e = f.transpose().mul(&rate);
                let e = e.blend(half, &e.transpose(), half);
                let trace = e.0[0][0] + (e.0[1][1] + e.0[2][2]);
                // Its own tangent grows with the fourth power of the stretch: never beyond that of the law.
                let stretch = (f.norm_squared() - V::splat(2.0)).max(one);
                let tangent = match (of_flow, law.law.family()) {
                    // Those have their volume with them.
                    (Some(tangents), _) => V::load(&tangents[q][x][n]) / volume.max(least) * half,
                    (None, Family::Piola(law)) => first_piola(law, &f, lambda, mu).tangent,
                    // Hencky strain tells its tangents where there is viscosity; the others are no laws of solids.
                    (None, Family::Hencky | Family::Spatial | Family::Rigid) => zero,
                };
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

/// The largest Frobenius norm of `grad v` of points with matter [1/s].
#[inline(always)]
pub(super) fn largest_rate<V: Lanes>(
    rule: &Rule<V>,
    v: &[Summed; 3],
    &Matter {
        volumes, filled, ..
    }: &Matter<'_>,
) -> f32 {
    let mut largest = V::splat(0.0);
    for q in 0..4 {
        for x in 0..4 {
            if !filled.has(q, x) {
                continue;
            }
            let rate = gradients(rule, v, x, q);
            for n in 0..2 {
                let rate = masked(rate[n], V::load(&volumes[q][x][n]));
                largest = largest.max(rate.norm_squared());
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

/// Stress of one law, and its tangents added to `tangents` if asked for. Laws on Hencky strain, and matter that remembers, answer
/// with tangents of their own.
#[inline(always)]
pub(super) fn respond_to<V: Flowing>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    matter: &Matter<'_>,
    (memory, step): (Option<&mut PartMemory>, &Step),
    stress: &mut Stresses,
    tangents: &mut Tangents,
) -> Option<Tangents> {
    let looks = step.wants_extremes;
    match (&memory, matter.law.law.family()) {
        (None, Family::Piola(law)) => match (law, looks) {
            (PiolaLaw::NeoHookean, false) => {
                respond::<V, NeoHookean, false>(rule, summed, matter, stress, tangents);
            }
            (PiolaLaw::NeoHookean, true) => {
                respond::<V, NeoHookean, true>(rule, summed, matter, stress, tangents);
            }
            (PiolaLaw::FixedCorotated, false) => {
                respond::<V, FixedCorotated, false>(rule, summed, matter, stress, tangents);
            }
            (PiolaLaw::FixedCorotated, true) => {
                respond::<V, FixedCorotated, true>(rule, summed, matter, stress, tangents);
            }
        },
        // No law of solids.
        (_, Family::Spatial | Family::Rigid) => *stress = [[[[[O; 2]; 3]; 3]; 4]; 4],
        (Some(_), Family::Piola(_)) | (_, Family::Hencky) => {
            let wants_tangents = looks || step.viscosity > 0.0;
            let part = FlowingPart {
                summed,
                matter,
                time: step.kick,
                wants_tangents,
            };
            let mut own = [[[O; 2]; 4]; 4];
            V::flow(rule, &part, memory, (stress, &mut own));
            if looks {
                add_tangents::<V>(&own, tangents);
            }
            return wants_tangents.then_some(own);
        }
    }
    None
}

#[inline(always)]
fn add_tangents<V: Lanes>(more: &Tangents, tangents: &mut Tangents) {
    let sums = tangents.as_flattened_mut().as_flattened_mut();
    for (sum, more) in sums.iter_mut().zip(more.as_flattened().as_flattened()) {
        (V::load(sum) + V::load(more)).store(sum);
    }
}

/// Elastic energy of the points of one law [Pa cells^3].
#[inline(always)]
pub(super) fn energy_of<V: Lanes>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    matter: &Matter<'_>,
    memory: Option<&PartMemory>,
) -> f64 {
    let Matter { law, volumes, .. } = matter;
    match (memory, law.law.family()) {
        (None, Family::Piola(piola)) => match piola {
            PiolaLaw::NeoHookean => stored::<V, NeoHookean>(rule, summed, volumes, law),
            PiolaLaw::FixedCorotated => stored::<V, FixedCorotated>(rule, summed, volumes, law),
        },
        // No law of solids.
        (_, Family::Spatial | Family::Rigid) => 0.0,
        (Some(_), Family::Piola(_)) | (_, Family::Hencky) => {
            stored_beside_flow(rule, summed, matter, memory)
        }
    }
}

/// Elastic energy of the points of one law without memory [Pa cells^3].
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
