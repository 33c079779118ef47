//! Keeps visible shapes from becoming needles, once per frame.
//!
//! Matter that flows forgets its shape, but the visible deformation gradient remembers all of it: a simple shear of
//! 10 stretches a Gaussian to an aspect of 102. Stretches are limited about their geometric mean, so that volume
//! and orientation stay; those of a fluid relax to a ball of the volume that the law knows.

use rayon::prelude::*;

use super::{
    constitutive::PartLaw,
    lanes::{load9, store9},
};
use crate::{
    mat3::Mat3,
    materials::{limits::max_stretch_squared, svd::svd},
    particles::{Particles, Run},
    pose::MAX_ASPECT,
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Largest ratio of principal stretches that is kept of fluids and grains, whose parts have no shape of their own.
const MAX_LOOSE_ASPECT: f32 = 5.0;
/// Time in which a fluid forgets a stretch [s].
const RELAXATION: f64 = 0.25;

/// What is done to the shapes of one part.
#[derive(Clone, Copy, Debug)]
struct Limit {
    /// Largest ratio of principal stretches.
    aspect: f32,
    /// Share of the logarithmic stretch that is left; 1 for solids.
    kept: f32,
    /// Whether memory holds `J - 1`.
    is_fluid: bool,
}

/// Limits the visible shapes of all parts that carry them apart, and of visible fluids, after a frame of `length`
/// [s].
pub(crate) fn limit_shapes(isa: Isa, particles: &mut Particles, laws: &[PartLaw], length: f64) {
    let limit_of = |run: &Run| {
        let law = laws[run.part].law;
        let is_fluid = law.is_fluid() && laws[run.part].visible;
        (is_fluid || !run.shapes.is_empty()).then_some(Limit {
            aspect: match law.is_loose() {
                true => MAX_LOOSE_ASPECT,
                false => MAX_ASPECT,
            },
            kept: match is_fluid {
                true => (-length / RELAXATION).exp() as f32,
                false => 1.0,
            },
            is_fluid,
        })
    };
    let Particles {
        runs,
        groups,
        shapes,
        memory,
        ..
    } = particles;
    let (mut groups, mut shapes) = (groups.as_mut_slice(), shapes.as_mut_slice());
    let mut work = Vec::new();
    for run in runs.iter() {
        let (mine, others) = std::mem::take(&mut groups).split_at_mut(run.groups.len());
        let (mine_too, others_too) = std::mem::take(&mut shapes).split_at_mut(run.shapes.len());
        (groups, shapes) = (others, others_too);
        if let Some(limit) = limit_of(run) {
            work.push((limit, mine, mine_too, &memory[run.groups.clone()]));
        }
    }
    work.into_par_iter()
        .for_each(|(limit, groups, shapes, memory)| {
            for (n, memory) in memory.iter().enumerate() {
                let shape = match shapes.get_mut(n) {
                    Some(shape) => &mut shape.0,
                    None => &mut groups[n].f,
                };
                limit_group_with_isa(isa, limit, shape, memory)
            }
        });
}

on_isa! {
    fn limit_group_with_isa = limit_group(limit: Limit, shape: &mut [F32x16; 9], memory: &F32x16)
}

/// Sixteen shapes.
#[inline(always)]
fn limit_group<V: Lanes>(limit: Limit, shape: &mut [F32x16; 9], memory: &F32x16) {
    let one = V::broadcast(1.0);
    let f = load9::<V>(shape);
    let j = f.det();
    // The aspect is at most s_max^3 / J.
    let bound = max_stretch_squared(&f);
    let harmless = (bound * bound.sqrt()).lt(V::broadcast(limit.aspect) * j);
    if !limit.is_fluid && !V::any(!harmless) {
        return;
    }
    let volume = match limit.is_fluid {
        true => one + V::load(memory),
        false => j,
    };
    let usable = V::broadcast(0.0).lt(j) & V::broadcast(0.0).lt(volume);
    let volume = V::select(usable, volume, one);
    let third = V::splat(1.0 / 3.0);
    let mean = volume.ln() * third;
    let parts = svd(&f);
    let half_range = V::splat(0.5 * f64::from(limit.aspect).ln());
    let kept = V::broadcast(limit.kept);
    // Logarithms about their mean, limited; then shifted so that the volume is right.
    let smallest = V::broadcast(1e-12);
    let mut log = [mean; 3];
    let mut sum = V::broadcast(0.0);
    for a in 0..3 {
        log[a] = parts.sigma[a].abs().max(smallest).ln();
        sum = sum + log[a];
    }
    let centre = sum * third;
    let mut rest = V::broadcast(0.0);
    for a in 0..3 {
        log[a] = ((log[a] - centre) * kept).max(-half_range).min(half_range);
        rest = rest + log[a];
    }
    let shift = mean - rest * third;
    let mut stretch = [one; 3];
    for a in 0..3 {
        stretch[a] = (log[a] + shift).exp();
    }
    let limited = parts
        .u
        .mul(&Mat3::diagonal(stretch))
        .mul_transposed(&parts.v);
    let change = match limit.is_fluid {
        true => usable,
        false => usable & !harmless,
    };
    store9(&Mat3::select(change, &limited, &f), shape);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lanes(m: [[f32; 3]; 3]) -> [F32x16; 9] {
        std::array::from_fn(|n| F32x16::splat(m[n / 3][n % 3]))
    }

    fn matrix(lanes: &[F32x16; 9]) -> Mat3<f64> {
        Mat3(std::array::from_fn(|i| {
            std::array::from_fn(|j| f64::from(lanes[3 * i + j].0[5]))
        }))
    }

    fn limited(m: [[f32; 3]; 3], limit: Limit, memory: f32) -> Mat3<f64> {
        let mut shape = lanes(m);
        limit_group::<crate::simd::Portable>(limit, &mut shape, &F32x16::splat(memory));
        matrix(&shape)
    }

    const SOLID: Limit = Limit {
        aspect: 30.0,
        kept: 1.0,
        is_fluid: false,
    };

    #[test]
    fn a_needle_loses_its_length_and_keeps_volume_and_direction() {
        // Simple shear of 10: principal stretches 10.1 and 0.099.
        let shear = [[1.0, 10.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let before = svd(&matrix(&lanes(shear)));
        let after = limited(shear, SOLID, 0.0);
        let now = svd(&after);
        assert!(before.sigma[0] / before.sigma[2] > 100.0);
        assert!(now.sigma[0] / now.sigma[2] < 30.001, "{:?}", now.sigma);
        // Logarithm, exponential and decomposition in single precision.
        assert!((after.det() - 1.0).abs() < 1e-5, "{}", after.det());
        let along = (0..3)
            .map(|i| before.u.0[i][0] * now.u.0[i][0])
            .sum::<f64>();
        assert!(along.abs() > 0.9999, "{along}");
    }

    #[test]
    fn ordinary_shapes_stay_bit_for_bit() {
        let shape = [[1.3, 0.2, 0.0], [-0.1, 0.8, 0.1], [0.0, 0.3, 1.1]];
        assert_eq!(limited(shape, SOLID, 0.0), matrix(&lanes(shape)));
    }

    #[test]
    fn a_fluid_relaxes_to_a_ball_of_its_volume() {
        let fluid = Limit {
            aspect: 5.0,
            kept: 0.5,
            is_fluid: true,
        };
        let mut shape = lanes([[4.0, 0.0, 0.0], [0.0, 0.25, 0.0], [0.0, 0.0, 1.0]]);
        for _ in 0..30 {
            limit_group::<crate::simd::Portable>(fluid, &mut shape, &F32x16::splat(0.331));
        }
        let ball = matrix(&shape);
        let expected = Mat3::diagonal([1.331_f64.cbrt(); 3]);
        assert!(ball.sub(&expected).norm_squared().sqrt() < 1e-5, "{ball:?}");
    }

    #[test]
    fn nothing_becomes_nan() {
        for m in [[[0.0; 3]; 3], [[f32::NAN; 3]; 3]] {
            let before = matrix(&lanes(m));
            let after = limited(m, SOLID, 0.0);
            let finite = |m: &Mat3<f64>| m.0.as_flattened().iter().all(|x| x.is_finite());
            assert_eq!(finite(&before), finite(&after));
        }
    }
}
