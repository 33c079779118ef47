//! Points on Hencky strain, with what they remember of their flow: two vectors of them at a time, compiled once per instruction set.

use super::{
    gradients::{Matter, O, Stresses, Summed, Tangents, gradients, masked},
    rule::Rule,
};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::{
    mat3::Mat3,
    materials::{
        Coefficients, Law,
        hencky_piola::{self, Deformation, Point},
    },
    memory::PartMemory,
    simd::{F32x16, Lanes, Pair, Portable},
};

/// What a part of a block does.
pub(super) struct FlowingPart<'a> {
    /// Its nodes, summed along y and z.
    pub summed: &'a [Summed; 3],
    /// Its law and its volumes.
    pub matter: &'a Matter<'a>,
    /// How long it flows [s]; what it remembers stays as it is at 0.
    pub time: f32,
    /// Whether tangents are asked for.
    pub wants_tangents: bool,
}

/// Lanes on which matter flows.
pub(super) trait Flowing: Lanes {
    /// Stress of all points of a part, and tangents times volumes if asked for; without memory it is elastic.
    fn flow(
        rule: &Rule<Self>,
        part: &FlowingPart<'_>,
        memory: Option<&mut PartMemory>,
        answers: (&mut Stresses, &mut Tangents),
    );
}

#[cfg(target_arch = "x86_64")]
impl Flowing for Avx512 {
    #[inline(always)]
    fn flow(
        rule: &Rule<Self>,
        part: &FlowingPart<'_>,
        memory: Option<&mut PartMemory>,
        answers: (&mut Stresses, &mut Tangents),
    ) {
        #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,fma")]
        #[inline(never)]
        fn with_features(
            rule: &Rule<Avx512>,
            part: &FlowingPart<'_>,
            memory: Option<&mut PartMemory>,
            answers: (&mut Stresses, &mut Tangents),
        ) {
            flow(rule, part, memory, answers);
        }
        // SAFETY: this type is only named under entry points that checked for the instruction set.
        unsafe { with_features(rule, part, memory, answers) }
    }
}

#[cfg(target_arch = "x86_64")]
impl Flowing for Avx2 {
    #[inline(always)]
    fn flow(
        rule: &Rule<Self>,
        part: &FlowingPart<'_>,
        memory: Option<&mut PartMemory>,
        answers: (&mut Stresses, &mut Tangents),
    ) {
        #[target_feature(enable = "avx2,fma")]
        #[inline(never)]
        fn with_features(
            rule: &Rule<Avx2>,
            part: &FlowingPart<'_>,
            memory: Option<&mut PartMemory>,
            answers: (&mut Stresses, &mut Tangents),
        ) {
            flow(rule, part, memory, answers);
        }
        // SAFETY: this type is only named under entry points that checked for the instruction set.
        unsafe { with_features(rule, part, memory, answers) }
    }
}

impl Flowing for Portable {
    #[inline(never)]
    fn flow(
        rule: &Rule<Self>,
        part: &FlowingPart<'_>,
        memory: Option<&mut PartMemory>,
        answers: (&mut Stresses, &mut Tangents),
    ) {
        flow(rule, part, memory, answers);
    }
}

/// The points of a row of cells, and their volumes: both at once, so that one works while the other waits.
#[inline(always)]
fn row<V: Lanes>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    volumes: &[F32x16; 2],
    [q, x]: [usize; 2],
) -> (Mat3<Pair<V>>, Pair<V>) {
    let volume = Pair(V::load(&volumes[0]), V::load(&volumes[1]));
    let h = gradients(rule, summed, x, q);
    let h = [masked(h[0], volume.0), masked(h[1], volume.1)];
    let mut both = Mat3([[volume; 3]; 3]);
    for a in 0..3 {
        for b in 0..3 {
            both.0[a][b] = Pair(h[0].0[a][b], h[1].0[a][b]);
        }
    }
    (both, volume)
}

/// The axes of the grid, where they are not those of the world.
#[inline(always)]
fn axes<V: Lanes>(rule: &Rule<V>) -> Option<Mat3<Pair<V>>> {
    let axes = rule.axes()?;
    let mut both = Mat3::identity();
    for a in 0..3 {
        for b in 0..3 {
            both.0[a][b] = Pair(axes.0[a][b], axes.0[a][b]);
        }
    }
    Some(both)
}

/// The law that a part answers by: without memory nothing flows.
#[inline(always)]
fn law_of(matter: &Matter<'_>, remembers: bool) -> Law {
    match remembers {
        true => matter.law.law,
        false => matter.law.law.without_flow(),
    }
}

#[inline(always)]
fn flow<V: Lanes>(
    rule: &Rule<V>,
    part: &FlowingPart<'_>,
    mut memory: Option<&mut PartMemory>,
    (stress, tangents): (&mut Stresses, &mut Tangents),
) {
    let matter = part.matter;
    let law = law_of(matter, memory.is_some());
    let k = matter.law.coefficients().splat::<Pair<V>>();
    let both = |x: f64| Pair(V::splat(x), V::splat(x));
    let (half, two) = (both(0.5), both(2.0));
    let time = Pair(V::broadcast(part.time), V::broadcast(part.time));
    let axes = axes(rule);
    for q in 0..4 {
        for x in 0..4 {
            if !matter.filled.has(q, x) {
                stress[q][x] = [[[O; 2]; 3]; 3];
                tangents[q][x] = [O; 2];
                continue;
            }
            let (h, volume) = row(rule, part.summed, &matter.volumes[q][x], [q, x]);
            // The slopes of the way back are doubled.
            let share = half * volume;
            let k = Coefficients {
                lambda: k.lambda * share,
                mu: k.mu * share,
                ..k
            };
            let point = match &memory {
                Some(memory) => memory.load(q, x),
                None => Point::rest(),
            };
            let at = Deformation {
                axes: axes.as_ref(),
                h,
            };
            let with = (time, part.wants_tangents);
            let answer = hencky_piola::respond(law, &at, &point, with, &k);
            if let Some(memory) = &mut memory
                && part.time > 0.0
                && answer.any_flows()
            {
                memory.store(q, x, &answer.point);
            }
            let piola = answer.piola;
            if part.wants_tangents {
                let Pair(one, other) = piola.tangent * two;
                one.store(&mut tangents[q][x][0]);
                other.store(&mut tangents[q][x][1]);
            }
            for a in 0..3 {
                for b in 0..3 {
                    let Pair(one, other) = piola.stress.0[a][b];
                    one.store(&mut stress[q][x][a][b][0]);
                    other.store(&mut stress[q][x][a][b][1]);
                }
            }
        }
    }
}

/// Elastic energy of the points of a part [Pa cells^3].
#[inline(always)]
pub(super) fn stored_beside_flow<V: Lanes>(
    rule: &Rule<V>,
    summed: &[Summed; 3],
    matter: &Matter<'_>,
    memory: Option<&PartMemory>,
) -> f64 {
    let law = law_of(matter, memory.is_some());
    let k = matter.law.coefficients().splat::<Pair<V>>();
    let axes = axes(rule);
    let (mut sum, mut lanes) = (0.0, [O; 2]);
    for q in 0..4 {
        for x in 0..4 {
            let (h, volume) = row(rule, summed, &matter.volumes[q][x], [q, x]);
            let point = memory.map_or(Point::rest(), |memory| memory.load(q, x));
            let at = Deformation {
                axes: axes.as_ref(),
                h,
            };
            let Pair(one, other) = volume * hencky_piola::energy(law, &at, &point, &k);
            one.store(&mut lanes[0]);
            other.store(&mut lanes[1]);
            for lane in lanes.iter().flat_map(|lanes| lanes.0) {
                sum += f64::from(lane);
            }
        }
    }
    sum
}
