//! First Piola-Kirchhoff stress of elastic laws, finite for every finite `F`, inverted ones included: what solids on a grid of
//! their own are made of.
//!
//! `P = d psi / d F` and `P F^T` is the Kirchhoff stress of the law's own file wherever that file's law is defined.

use super::polar::rotation;
use crate::{mat3::Mat3, num::Real};

/// Volume ratio below which the volumetric energy of neo-Hookean matter goes on with its slope there and the curvature that it
/// has at rest: its logarithm has no value at `J <= 0`, and its tangent no bound.
pub const PARABOLIC_J: f64 = 0.3;

/// Stress, and a bound of the tangent.
#[derive(Clone, Copy, Debug)]
pub struct Piola<R> {
    /// First Piola-Kirchhoff stress [Pa].
    pub stress: Mat3<R>,
    /// Bound of the largest eigenvalue of `d P / d F` [Pa]; `3 lambda + 2 mu` at rest and never less.
    pub tangent: R,
    /// `det F`.
    pub j: R,
}

/// A law whose first Piola-Kirchhoff stress is a function of `F` alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PiolaLaw {
    /// [`Law::FixedCorotated`](super::Law::FixedCorotated).
    FixedCorotated,
    /// [`Law::NeoHookean`](super::Law::NeoHookean).
    NeoHookean,
}

/// Stress and tangent of a law at `f`, with Lamé's parameters [Pa].
#[inline(always)]
pub fn first_piola<R: Real>(law: PiolaLaw, f: &Mat3<R>, lambda: R, mu: R) -> Piola<R> {
    let cofactor = f.cofactor();
    let j = crate::mat3::dot(f.0[0], cofactor.0[0]);
    let area = cofactor.norm_squared();
    let length = f.norm_squared();
    match law {
        PiolaLaw::NeoHookean => neo_hookean(f, &cofactor, [j, area, length], lambda, mu),
        PiolaLaw::FixedCorotated => fixed_corotated(f, &cofactor, [j, area, length], lambda, mu),
    }
}

/// `P = mu F + g(J) cof F`, with the volumetric energy's slope `g`.
#[inline(always)]
fn neo_hookean<R: Real>(
    f: &Mat3<R>,
    cofactor: &Mat3<R>,
    invariants: [R; 3],
    lambda: R,
    mu: R,
) -> Piola<R> {
    let j = invariants[0];
    let [_, slope, curvature] = volumetric(j, lambda, mu);
    Piola {
        stress: f.blend(mu, cofactor, slope),
        tangent: mu + volumetric_tangent(invariants, slope, curvature),
        j,
    }
}

/// Bound of the largest eigenvalue of the second derivative over `F` of an energy of `J` with this slope and curvature [Pa]; `J`,
/// `|cof F|^2` and `|F|^2` are given.
///
/// Along the principal axes, with the principal stretches `s_k` and `c_k = J / s_k`, it is the matrix `curvature c c^T + slope S` with
/// `S_ij = s_k`, i, j and k different. Its trace and that of its square bound its eigenvalues (Wolkowicz and Styan 1980), exactly so
/// where two are equal. Across them the eigenvalues are `+-slope s_k`.
#[inline(always)]
fn volumetric_tangent<R: Real>([j, area, length]: [R; 3], slope: R, curvature: R) -> R {
    let (two, three) = (R::splat(2.0), R::splat(3.0));
    let trace = curvature * area;
    let cross = (two * curvature * j).mul_add(slope, slope * slope) * length;
    let along = largest_root(trace, three.mul_add(cross, trace * trace));
    let stretch = largest_root(length, length.mul_add(length, R::splat(-3.0) * area));
    along.max(slope.abs() * stretch.sqrt())
}

/// Bound of the largest root of a cubic with real roots `x`, by their sum `s` and `(3 sum x^2 - s^2) / 2`.
// A closure would not get the instruction set of whoever calls.
#[inline(always)]
fn largest_root<R: Real>(sum: R, spread: R) -> R {
    let spread = spread.max(R::splat(0.0)).sqrt();
    spread.mul_add(R::splat(2.0), sum) * R::splat(1.0 / 3.0)
}

/// Volumetric energy `-mu ln J + lambda / 2 (ln J)^2` [J/m^3], its slope and curvature over `J` [Pa], with the parabola below
/// [`PARABOLIC_J`].
#[inline(always)]
fn volumetric<R: Real>(j: R, lambda: R, mu: R) -> [R; 3] {
    let least = R::splat(PARABOLIC_J);
    let at = j.max(least);
    let (one, half) = (R::splat(1.0), R::splat(0.5));
    let (log, inverse) = (at.ln(), one / at);
    let slope = lambda.mul_add(log, -mu) * inverse;
    let curvature = lambda.mul_add(one - log, mu) * inverse * inverse;
    let energy = (half * lambda * log - mu) * log;
    // 0 above the parabola.
    let below = j.min(least) - least;
    let at_rest = lambda + mu;
    [
        below.mul_add((half * at_rest).mul_add(below, slope), energy),
        at_rest.mul_add(below, slope),
        R::select(j.lt(least), at_rest, curvature),
    ]
}

/// `P = 2 mu (F - R) + lambda (J - 1) cof F`.
#[inline(always)]
fn fixed_corotated<R: Real>(
    f: &Mat3<R>,
    cofactor: &Mat3<R>,
    invariants: [R; 3],
    lambda: R,
    mu: R,
) -> Piola<R> {
    let j = invariants[0];
    let turn = rotation(f);
    let swelling = j - R::splat(1.0);
    let two_mu = mu + mu;
    let elastic = f.sub(&turn);
    // Where matter is inside out a turn of R follows F the faster.
    let shear = R::select(j.lt(R::splat(0.0)), two_mu + two_mu, two_mu);
    let slope = lambda * swelling;
    Piola {
        stress: elastic.blend(two_mu, cofactor, slope),
        tangent: shear + volumetric_tangent(invariants, slope, lambda),
        j,
    }
}

/// Energy per rest volume at `F = I + h` [J/m^3]: that of [`piola_energy`], without its differences of large numbers, so that single
/// precision is enough.
#[inline(always)]
pub fn energy_of_gradient<R: Real>(law: PiolaLaw, h: &Mat3<R>, lambda: R, mu: R) -> R {
    let (zero, one, half) = (R::splat(0.0), R::splat(1.0), R::splat(0.5));
    let cofactor = h.cofactor();
    let trace = h.0[0][0] + (h.0[1][1] + h.0[2][2]);
    let second = cofactor.0[0][0] + (cofactor.0[1][1] + cofactor.0[2][2]);
    // J - 1
    let swelling = trace + (second + crate::mat3::dot(h.0[0], cofactor.0[0]));
    match law {
        PiolaLaw::NeoHookean => {
            let least = R::splat(PARABOLIC_J - 1.0);
            let at = swelling.max(least);
            let j = one + at;
            // What rounding makes of `at` in `j` is made good: ln(1 + x) = x ln(j) / (j - 1).
            let rounded = j - one;
            let log = R::select(zero.lt(rounded.abs()), j.ln() * (at / rounded), at);
            let below = swelling.min(least) - least;
            let slope = lambda.mul_add(log, -mu) / j;
            let parabola = below * (half * (lambda + mu)).mul_add(below, slope);
            let shear = half.mul_add(h.norm_squared(), trace - log);
            mu.mul_add(shear, (half * lambda * log).mul_add(log, parabola))
        }
        PiolaLaw::FixedCorotated => {
            let f = h.blend(one, &Mat3::identity(), one);
            let stretch = f.sub(&rotation(&f));
            mu.mul_add(stretch.norm_squared(), half * lambda * swelling * swelling)
        }
    }
}

/// Energy per rest volume whose derivative [`first_piola`] is [J/m^3].
pub fn piola_energy(law: PiolaLaw, f: &Mat3<f64>, lambda: f64, mu: f64) -> f64 {
    match law {
        PiolaLaw::NeoHookean => {
            let [energy, ..] = volumetric(f.det(), lambda, mu);
            0.5 * mu * (f.norm_squared() - 3.0) + energy
        }
        PiolaLaw::FixedCorotated => super::fixed_corotated::energy_density(f, lambda, mu),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::{
        Coefficients, Family, Law, Material, Trial, hencky_piola, laws::elastic_laws,
        testing::Random,
    };

    const LAMBDA: f64 = 2.0;
    const MU: f64 = 1.0;

    fn energy_of(law: Law, f: &Mat3<f64>) -> f64 {
        match law.family() {
            Family::Piola(law) => piola_energy(law, f, LAMBDA, MU),
            Family::Hencky | Family::Spatial | Family::Rigid => {
                energy_at(law, &f.sub(&Mat3::identity()), LAMBDA, MU)
            }
        }
    }

    fn energy_at<R: Real>(law: Law, h: &Mat3<R>, lambda: R, mu: R) -> R {
        hencky_piola::elastic_energy(law, h, lambda, mu)
    }

    fn stress_of(law: Law, f: &Mat3<f64>) -> Piola<f64> {
        hencky_piola::elastic_piola(law, f, LAMBDA, MU)
    }

    fn random_matrix(random: &mut Random, size: f64) -> Mat3<f64> {
        Mat3(std::array::from_fn(|_| {
            std::array::from_fn(|_| random.uniform(-size, size))
        }))
    }

    #[test]
    fn stress_is_the_slope_of_energy_inside_out_too() {
        let mut random = Random::new(3);
        for law in elastic_laws() {
            for n in 0..40 {
                let size = if n % 2 == 0 { 0.3 } else { 1.5 };
                let f = Mat3::identity().blend(1.0, &random_matrix(&mut random, size), 1.0);
                let p = stress_of(law, &f).stress;
                let d = random_matrix(&mut random, 1.0);
                let h = 1e-6;
                let energy = |s: f64| energy_of(law, &f.blend(1.0, &d, s));
                let slope = (energy(h) - energy(-h)) / (2.0 * h);
                let along: f64 = (0..9).map(|n| p.0[n / 3][n % 3] * d.0[n / 3][n % 3]).sum();
                // Central differences of second order; the trace that the energy takes is right to 1e-9.
                assert!(
                    (slope - along).abs() < 1e-5 * (1.0 + along.abs()),
                    "{law:?} {f:?}: {slope} {along}"
                );
            }
        }
    }

    #[test]
    fn energy_of_a_small_gradient_keeps_its_digits_in_f32() {
        let mut random = Random::new(11);
        for law in elastic_laws() {
            for n in 0..60 {
                let size = [1e-4, 1e-2, 0.3][n % 3];
                let h = random_matrix(&mut random, size);
                let f = Mat3::identity().blend(1.0, &h, 1.0);
                let exact = energy_of(law, &f);
                let double = energy_at(law, &h, LAMBDA, MU);
                // The oracle's own differences leave 1e-15 of the moduli.
                assert!(
                    (double - exact).abs() < 1e-7 * exact + 1e-14,
                    "{law:?}: {double} {exact}"
                );
                let single = Mat3(h.0.map(|row| row.map(|x| x as f32)));
                let single = energy_at(law, &single, LAMBDA as f32, MU as f32);
                // F - R is right to a few 1e-7: twice that over the strain.
                let most = (8e-7 / size + 1e-5) * exact;
                assert!(
                    (f64::from(single) - exact).abs() < most,
                    "{law:?}: {single} {exact}"
                );
            }
        }
    }

    #[test]
    fn stress_is_that_of_the_law_where_the_law_has_one() {
        let mut random = Random::new(5);
        for law in elastic_laws() {
            let material = Material {
                name: "tested".into(),
                law,
                youngs_modulus: 1e6,
                poisson_ratio: 0.3,
                density: 1000.0,
                loss: 0.0,
            };
            let k = Coefficients::new(&material);
            for _ in 0..20 {
                let f = Mat3::identity().blend(1.0, &random_matrix(&mut random, 0.2), 1.0);
                let trial = Trial {
                    f,
                    memory: 0.0,
                    gradient: Mat3([[0.0; 3]; 3]),
                    dt: 0.0,
                };
                let expected = law.respond(&trial, &k).tau;
                let p = hencky_piola::elastic_piola(law, &f, k.lambda, k.mu).stress;
                let tau = p.mul_transposed_sym(&f);
                for n in 0..6 {
                    // Of the size of E, by round-off.
                    assert!((tau[n] - expected[n]).abs() < 1e-6 * material.youngs_modulus);
                }
            }
        }
    }

    #[test]
    fn tangent_bound_holds_in_every_direction() {
        let mut random = Random::new(7);
        for law in elastic_laws() {
            let rest = stress_of(law, &Mat3::identity()).tangent;
            assert!((rest - (3.0 * LAMBDA + 2.0 * MU)).abs() < 1e-12);
            for _ in 0..200 {
                let f = Mat3::identity().blend(1.0, &random_matrix(&mut random, 0.8), 1.0);
                // Of singular F the rotation jumps.
                if f.det().abs() < 0.2 {
                    continue;
                }
                let bound = stress_of(law, &f).tangent;
                for _ in 0..20 {
                    let d = random_matrix(&mut random, 1.0);
                    let h = 1e-5;
                    let stress = |s| stress_of(law, &f.blend(1.0, &d, s)).stress;
                    let change = stress(h).sub(&stress(-h));
                    let along: f64 = (0..9)
                        .map(|n| change.0[n / 3][n % 3] * d.0[n / 3][n % 3])
                        .sum();
                    let curvature = along / (2.0 * h * d.norm_squared());
                    assert!(curvature < 1.001 * bound, "{law:?}: {curvature} {bound}");
                }
            }
        }
    }
}
