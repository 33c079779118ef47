//! How near particles are to half-spaces: sixteen at a time, and gaps alone.

use super::{CELLS, CUBE, cells_of, is_out_of_range, smaller};
use crate::{
    colliders::{
        Placed,
        approach::{RADIUS_MAX, RANGE},
    },
    particles::{BLOCK, Block, NO_PARTICLE, Particles, position_in_cells},
    simd::{F32x16, Isa, LANES},
};

/// Groups of particles in front of a half-space that are looked at together.
pub(super) const AHEAD: usize = 8;

/// Per cell the gap of the particle that is nearest to a half-space, whose normal is the same everywhere; z fastest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flat {
    /// Number of the collider.
    pub body: usize,
    pub gaps: [f32; CUBE],
}

/// A particle that may be the nearest of its cell.
#[derive(Clone, Copy, Default)]
struct Candidate {
    distance: f64,
    id: u32,
    cell: u32,
}

/// What the particles of a block see of a half-space, if anything. More lanes at once change no digit: nothing is fused.
pub(super) fn see_plane(
    block: &Block,
    particles: &Particles,
    half_spacings: &[f64],
    body: &Placed<'_>,
) -> Option<Flat> {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(
            block: &Block,
            particles: &Particles,
            half_spacings: &[f64],
            body: &Placed<'_>,
        ) -> Option<Flat> {
            approach_plane(block, particles, half_spacings, body)
        }
        if Isa::Avx2.is_available() {
            // SAFETY: the processor has the instructions.
            return unsafe { with_avx2(block, particles, half_spacings, body) };
        }
    }
    approach_plane(block, particles, half_spacings, body)
}

#[inline(always)]
pub(super) fn approach_plane(
    block: &Block,
    particles: &Particles,
    half_spacings: &[f64],
    body: &Placed<'_>,
) -> Option<Flat> {
    let mut gaps = [f32::INFINITY; CUBE];
    let mut candidates = [Candidate::default(); AHEAD * LANES];
    let mut is_used = false;
    for first in block.groups.clone().step_by(AHEAD) {
        let mut count = 0;
        for g in first..block.groups.end.min(first + AHEAD) {
            let (ids, x) = (&particles.fixed[g].id, &particles.groups[g].x);
            let Some(distances) = distances(body, block.index, x) else {
                continue;
            };
            let cells = cells_of(x);
            for lane in 0..LANES {
                let (distance, id, cell) = (distances[lane], ids[lane], cells[lane]);
                candidates[count] = Candidate { distance, id, cell };
                let is_in_range = distance < RANGE + RADIUS_MAX && id != NO_PARTICLE;
                // Whatever its spacing is.
                let is_farther = (distance - RADIUS_MAX) as f32 >= gaps[cell as usize];
                count += usize::from(is_in_range && !is_farther);
            }
        }
        // Half spacings are in scene order, far from one another: all are asked for before the first is waited for.
        for candidate in &candidates[..count] {
            prefetch(&half_spacings[candidate.id as usize]);
        }
        for &Candidate { distance, id, cell } in &candidates[..count] {
            let gap = distance - half_spacings[id as usize];
            let nearest = &mut gaps[cell as usize];
            if gap < RANGE {
                *nearest = smaller(*nearest, gap as f32);
                is_used = true;
            }
        }
    }
    is_used.then_some(Flat {
        body: body.id,
        gaps,
    })
}

/// Distances of sixteen particles of a block from a half-space; none where none of them can be in range.
#[inline(always)]
fn distances(body: &Placed<'_>, block: [i32; 3], x: &[F32x16; 3]) -> Option<[f64; LANES]> {
    let origin = position_in_cells(block, [0.0; 3]);
    let mut places = [[0.0; LANES]; 3];
    for a in 0..3 {
        for lane in 0..LANES {
            places[a][lane] = origin[a] + f64::from(x[a].0[lane]);
        }
    }
    if let Some(distances) = body.heights(&places) {
        let mut is_in_range = false;
        for distance in distances {
            is_in_range |= distance < RANGE + RADIUS_MAX;
        }
        return is_in_range.then_some(distances);
    }
    if is_out_of_range(body, block, x) {
        return None;
    }
    let mut distances = [0.0; LANES];
    for lane in 0..LANES {
        let at = [places[0][lane], places[1][lane], places[2][lane]];
        distances[lane] = body.distance(at).value;
    }
    Some(distances)
}

/// Asks for a number.
fn prefetch(number: &f64) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a hint.
        unsafe { _mm_prefetch::<_MM_HINT_T0>((&raw const *number).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = number;
}

/// Lowers gaps in the cells around a node block to those of the particles' block at an offset.
pub(super) fn merge(from: &[f32; CUBE], offset: [i32; 3], to: &mut [f32; CUBE]) {
    // Cells that both have: the first of them in one and in the other, and how many.
    let both = offset.map(|o| {
        let shift = (BLOCK * o.abs()) as usize;
        let [own, other] = if o > 0 { [shift, 0] } else { [0, shift] };
        [own, other, CELLS - shift]
    });
    let [[i0, i1, ni], [j0, j1, nj], [k0, k1, nk]] = both;
    for i in 0..ni {
        for j in 0..nj {
            let own = ((i0 + i) * CELLS + j0 + j) * CELLS + k0;
            let other = ((i1 + i) * CELLS + j1 + j) * CELLS + k1;
            let row = to[own..own + nk].iter_mut();
            for (to, &from) in row.zip(&from[other..other + nk]) {
                *to = smaller(*to, from);
            }
        }
    }
}
