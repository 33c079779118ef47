//! Largest stable time step of a material in closed form.

use super::{Law, Material, fluid, strain};
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Bounds on the deformation of a set of particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeformationBounds {
    /// Largest principal stretch, or an upper bound of it.
    pub max_stretch: f64,
    /// Smallest `J = det F`.
    pub min_j: f64,
    /// Largest `J`.
    pub max_j: f64,
    /// Largest factor on Lamé's parameters by hardening.
    pub max_stiffness: f64,
}

impl DeformationBounds {
    /// Undeformed.
    pub const REST: Self = Self {
        max_stretch: 1.0,
        min_j: 1.0,
        max_j: 1.0,
        max_stiffness: 1.0,
    };
}

/// Critical time step [s] of an isolated particle, `dx sqrt(rho0 / M)` with `M` the largest tangent
/// `d tau / d ln(stretch)` that the bounds allow: `M = 3 lambda + 2 mu` at rest.
///
/// An isolated particle is the worst case of MLS-MPM with quadratic splines and symplectic Euler: its affine
/// mode has `omega^2 = 4 M / (rho0 dx^2)` and is stable for `omega dt < 2`. A tangent softer than that at rest
/// is not rewarded: on its way back the particle passes through rest. Plastic flow only softens the tangent.
/// Viscosity `eta` damps the same mode by `8 eta J / (rho0 dx^2)`, stable for `dt < rho0 dx^2 / (4 eta J)`.
/// Infinite for rigid matter, which has no stress.
/// `rho0` is mass per rest volume [kg/m^3], that of `material` is not read; `dx` the cell size [m].
pub fn critical_dt(material: &Material, rho0: f64, dx: f64, bounds: &DeformationBounds) -> f64 {
    let s = bounds.max_stretch.max(1.0);
    let stiffness = bounds.max_stiffness.max(1.0);
    let (lambda, mu) = (stiffness * material.lambda(), stiffness * material.mu());
    let tangent = match material.law {
        Law::Rigid => return f64::INFINITY,
        Law::NeoHookean => 3.0 * lambda + 2.0 * mu * s * s,
        Law::FixedCorotated => {
            // d/d ln(s) of 2 mu (s - 1) s, and of lambda (J - 1) J; inverted elements have s, J < 0.
            let slope = |x: f64| 2.0 * x * x - x;
            let shear = if bounds.min_j < 0.0 {
                slope(-s)
            } else {
                slope(s)
            };
            let bulk = slope(bounds.max_j.max(1.0)).max(slope(bounds.min_j.min(0.0)));
            3.0 * lambda * bulk + 2.0 * mu * shear
        }
        // The clamp of the return mapping keeps stretches near 1, where the slope is 2 s^2 - s.
        Law::Snow { .. } => {
            let slope = |x: f64| 2.0 * x * x - x;
            3.0 * lambda * slope(bounds.max_j.max(1.0)) + 2.0 * mu * slope(s)
        }
        Law::Hencky
        | Law::VonMises { .. }
        | Law::DruckerPrager { .. }
        | Law::Foam { .. }
        | Law::Plasticine { .. } => {
            // Shear between axes whose logarithmic stretches differ by x turns them: 2 mu x coth(x).
            let least = (bounds.min_j / (s * s)).max(strain::STRETCH_MIN);
            let x = (s / least).ln().max(1e-6);
            3.0 * lambda + 2.0 * mu * x / x.tanh()
        }
        Law::Fluid {
            bulk_modulus,
            viscosity,
        } => {
            let stiffest = fluid::tangent(bounds.min_j.clamp(fluid::J_MIN, 1.0));
            let pressure = dx * (rho0 / (3.0 * bulk_modulus * stiffest)).sqrt();
            let largest = bounds.max_j.clamp(1.0, fluid::J_MAX);
            return pressure.min(rho0 * dx * dx / (4.0 * viscosity * largest));
        }
    };
    dx * (rho0 / tangent).sqrt()
}

/// Upper bound of the squared largest principal stretch, from the invariants of `b = F F^T`:
/// `tr(b)/3 + sqrt(2/3) |dev b|`. Exact for uniaxial and equal stretches, at most a third above otherwise.
#[inline(always)]
pub fn max_stretch_squared<R: Real>(f: &Mat3<R>) -> R {
    max_stretch_squared_of(&f.mul_transposed_sym(f))
}

/// The same from `b` itself.
#[inline(always)]
pub(super) fn max_stretch_squared_of<R: Real>(b: &Sym3<R>) -> R {
    let mean = (b[0] + b[3] + b[5]) * R::splat(1.0 / 3.0);
    let d = [b[0] - mean, b[3] - mean, b[5] - mean];
    let off = [b[1], b[2], b[4]];
    let two = R::splat(2.0);
    let squared = crate::mat3::dot(off, off).mul_add(two, crate::mat3::dot(d, d));
    (squared * R::splat(2.0 / 3.0)).sqrt() + mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::{Coefficients, Trial, laws::elastic_laws, testing::Random};

    const RHO0: f64 = 1000.0;
    const DX: f64 = 0.1;

    /// One particle alone on the grid: what it scatters comes back to it, so its motion is `C`, `F` and the law.
    struct Alone {
        material: Material,
        k: Coefficients<f64>,
        c: Mat3<f64>,
        f: Mat3<f64>,
        memory: f64,
        bounds: DeformationBounds,
    }

    impl Alone {
        fn new(law: Law) -> Self {
            let elastic = law.is_elastic();
            let material = Material {
                name: "tested".into(),
                law,
                youngs_modulus: if elastic { 1e6 } else { 0.0 },
                poisson_ratio: if elastic { 0.3 } else { 0.0 },
                density: RHO0,
                loss: 0.0,
            };
            Self {
                k: Coefficients::new(&material),
                material,
                c: Mat3([[0.0; 3]; 3]),
                f: Mat3::identity(),
                memory: 0.0,
                bounds: DeformationBounds::REST,
            }
        }

        fn critical_dt(&self) -> f64 {
            critical_dt(&self.material, RHO0, DX, &self.bounds)
        }

        /// One substep, with `load` [Pa] of outer pressure.
        fn step(&mut self, dt: f64, load: f64) {
            let a = self.c.blend(dt, &self.c, 0.0);
            let growth = Mat3::identity()
                .blend(1.0, &a, 1.0)
                .blend(1.0, &a.mul(&a), 0.5);
            let trial = Trial {
                f: growth.mul(&self.f),
                memory: self.memory,
                gradient: self.c,
                dt,
            };
            let response = self.material.law.respond(&trial, &self.k);
            (self.f, self.memory) = (response.f, response.memory);
            self.bounds = DeformationBounds {
                max_stretch: response.stretch_squared.sqrt(),
                min_j: response.j,
                max_j: response.j,
                max_stiffness: response.stiffness,
            };
            let t = response.tau;
            let t = Mat3([[t[0], t[1], t[2]], [t[1], t[3], t[4]], [t[2], t[4], t[5]]]);
            let t = t.blend(1.0, &Mat3::identity(), load);
            self.c = self.c.blend(1.0, &t, -4.0 * dt / (RHO0 * DX * DX));
        }

        /// Kinetic and elastic energy per rest volume [J/m^3].
        fn energy(&self) -> f64 {
            let kinetic = RHO0 * DX * DX / 8.0 * self.c.norm_squared();
            kinetic
                + self
                    .material
                    .law
                    .energy_density(&self.f, self.memory, &self.k)
        }
    }

    const SNOW: Law = Law::Snow {
        critical_compression: 0.025,
        critical_stretch: 0.0075,
        hardening: 10.0,
    };

    fn fluid(viscosity: f64) -> Law {
        Law::Fluid {
            bulk_modulus: 1e6,
            viscosity,
        }
    }

    fn foam(viscosity: f64, exponent: f64) -> Law {
        Law::Foam {
            yield_stress: 1e4,
            viscosity,
            exponent,
        }
    }

    const METAL: Law = Law::VonMises {
        yield_stress: 1e4,
        hardening: 1e5,
    };

    const PLASTICINE: Law = Law::Plasticine {
        yield_stress: 1e4,
        softening: 1e4,
    };

    const SAND: Law = Law::DruckerPrager {
        friction_angle: 30.0,
        cohesion: 1e3,
    };

    /// Growth of a tiny disturbance in 300 substeps of `share` of the critical one.
    fn growth(law: Law, disturbance: &Mat3<f64>, load: f64, share: f64) -> f64 {
        let mut particle = Alone::new(law);
        // A fluid rests under its load; the volume at which it does is found by Newton's method.
        if load > 0.0 {
            let mut j = 1.0 - load / 1e6;
            for _ in 0..30 {
                let tau = 1e6 / 7.0 * (j.powi(-6) - j) - load;
                j += tau * j / (1e6 * fluid::tangent(j));
            }
            particle.memory = j - 1.0;
            particle.bounds.min_j = j;
        }
        let dt = share * particle.critical_dt();
        let tiny = 1e-9;
        particle.c = disturbance.blend(tiny / dt, disturbance, 0.0);
        let mut largest = 0.0_f64;
        for _ in 0..300 {
            particle.step(dt, load);
            largest = largest.max(particle.c.norm_squared().sqrt() * dt);
        }
        largest / tiny
    }

    /// And not beyond.
    #[test]
    fn a_lone_particle_is_stable_up_to_the_critical_step() {
        let swelling = Mat3::identity();
        let flowing = [
            (METAL, 0.0),
            (SAND, 0.0),
            (foam(100.0, 1.0), 0.0),
            (PLASTICINE, 0.0),
            (SNOW, 0.0),
            (fluid(0.0), 1e3),
            (fluid(0.0), 3e5),
        ];
        let elastic = elastic_laws().map(|law| (law, 0.0));
        for (law, load) in elastic.chain(flowing) {
            let (below, above) = (
                growth(law, &swelling, load, 0.98),
                growth(law, &swelling, load, 1.02),
            );
            assert!(
                below < 30.0 && above > 1e4,
                "{law:?}, {load} Pa: {below} {above}"
            );
        }
    }

    #[test]
    fn viscosity_limits_the_step_where_it_says() {
        let shearing = Mat3([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        // So viscous that the speed of sound does not matter.
        let law = fluid(1e4);
        let (below, above) = (
            growth(law, &shearing, 0.0, 0.99),
            growth(law, &shearing, 0.0, 1.01),
        );
        assert!(below < 1.42 && above > 100.0, "{below} {above}");
        // Foam flows implicitly: its viscosity does not limit the step, whatever it is.
        for viscosity in [1.0, 1e4, 1e9] {
            assert!(growth(foam(viscosity, 1.0), &shearing, 0.0, 0.98) < 30.0);
        }
    }

    #[test]
    fn a_particle_that_is_torn_and_crushed_never_gains_energy() {
        let flowing = [
            METAL,
            SAND,
            foam(100.0, 1.0),
            foam(100.0, 0.5),
            PLASTICINE,
            SNOW,
            fluid(10.0),
        ];
        let mut random = Random::new(61);
        for law in elastic_laws().chain(flowing) {
            let mut dissipated = 0;
            for _ in 0..10 {
                let mut particle = Alone::new(law);
                // Strains of some tenths if elastic: the kinetic energy is that of 1e6 Pa 0.3^2 / 2.
                let c = Mat3(std::array::from_fn(|_| {
                    std::array::from_fn(|_| random.uniform(-1.0, 1.0))
                }));
                let speed = (8.0 * 4.5e4 / (RHO0 * DX * DX * c.norm_squared())).sqrt();
                particle.c = c.blend(speed, &c, 0.0);
                let start = particle.energy();
                let (mut least, mut most) = (start, start);
                for _ in 0..5_000 {
                    let rate = particle.c.norm_squared().sqrt();
                    let dt = (0.01 * particle.critical_dt()).min(0.003 / rate);
                    particle.step(dt, 0.0);
                    least = least.min(particle.energy());
                    most = most.max(particle.energy());
                }
                // Symplectic Euler swings by half of omega dt, 0.01 at rest and more where neo-Hookean matter is
                // stretched: 1.025 and 0.992 were measured, 1.034 of Hencky's. Dissipation outweighs the swing from the first step.
                let lossless = law.keeps_elastic();
                let (low, high) = if lossless { (0.97, 1.05) } else { (0.0, 1.001) };
                let share = (least / start, most / start);
                assert!(share.0 > low && share.1 < high, "{law:?}: {share:?}");
                dissipated += usize::from(share.0 < 0.95);
            }
            // Sand and fluid that start by swelling part and lose nothing.
            let lossless = law.keeps_elastic();
            assert!(lossless || dissipated >= 3, "{law:?}: {dissipated} of 10");
        }
    }
}
