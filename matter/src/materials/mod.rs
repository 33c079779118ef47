//! Constitutive laws, one file each.

pub mod drucker_prager;
mod family;
pub mod fixed_corotated;
pub mod fluid;
pub mod foam;
pub mod hencky;
pub mod hencky_piola;
pub mod laws;
pub mod limits;
pub mod neo_hookean;
pub mod piola;
pub mod plasticine;
pub mod polar;
pub mod series;
pub mod snow;
pub mod strain;
pub mod svd;
pub mod testing;
pub mod von_mises;

pub use family::Family;
use serde::{Deserialize, Serialize};

use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// A material: a law and its parameters in SI units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Preset or user name, for reports.
    pub name: String,
    /// Constitutive law.
    pub law: Law,
    /// Young's modulus `E` [Pa], > 0; 0 of fluid and rigid matter.
    pub youngs_modulus: f64,
    /// Poisson's ratio `nu`, 0 <= nu < 0.5; 0 of fluid and rigid matter.
    pub poisson_ratio: f64,
    /// Density at rest [kg/m^3], > 0.
    pub density: f64,
    /// Loss factor `tan delta` of its vibration, 0..=1: the energy lost per radian over the largest elastic energy.
    #[serde(default)]
    pub loss: f64,
}

/// Constitutive laws, with what they need besides Lamé's parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Law {
    /// Fixed corotated elasticity (Stomakhin et al. 2012).
    FixedCorotated,
    /// Compressible neo-Hookean elasticity with a logarithmic barrier (Bonet & Wood 2008).
    NeoHookean,
    /// Hencky elasticity: quadratic in the logarithms of the stretches, alike in tension and compression.
    Hencky,
    /// Metal: Hencky elasticity with von Mises yield.
    VonMises {
        /// Yield stress in a tension test [Pa], > 0.
        yield_stress: f64,
        /// Growth of the yield stress per equivalent plastic strain [Pa], >= 0.
        hardening: f64,
    },
    /// Sand: Hencky elasticity with Drucker-Prager yield and volume correction (Klar et al. 2016).
    DruckerPrager {
        /// Friction angle [degrees], 1 to 60.
        friction_angle: f64,
        /// Cohesion of Mohr and Coulomb [Pa], >= 0; 0 when dry.
        cohesion: f64,
    },
    /// Snow (Stomakhin et al. 2013).
    Snow {
        /// Elastic limit in compression, as `1 - stretch`.
        critical_compression: f64,
        /// Elastic limit in tension, as `stretch - 1`.
        critical_stretch: f64,
        /// Exponent of hardening per plastic volume change.
        hardening: f64,
    },
    /// Visco-plastic foam or paste: Hencky elasticity with Herschel-Bulkley flow (Yue et al. 2015).
    Foam {
        /// Yield stress in a tension test [Pa], >= 0.
        yield_stress: f64,
        /// Consistency [Pa s^exponent], >= 0.
        viscosity: f64,
        /// Exponent of the shear rate, 0.2 to 1.
        exponent: f64,
    },
    /// Plasticine: von Mises yield that softens, then damage.
    Plasticine {
        /// Yield stress in a tension test [Pa], > 0.
        yield_stress: f64,
        /// Loss of yield stress per equivalent plastic strain [Pa], >= 0.
        softening: f64,
    },
    /// Weakly compressible fluid (Tait) with Newtonian viscosity. Has no Lamé parameters.
    Fluid {
        /// Bulk modulus at rest [Pa], > 0.
        bulk_modulus: f64,
        /// Dynamic viscosity [Pa s], >= 0.
        viscosity: f64,
    },
    /// No deformation at all and no stress: all rigid particles of an object move as one body.
    Rigid,
}

/// A material's numbers, ready for the law: `f64` in the reference path, the same value in all lanes in the fast
/// path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients<R> {
    /// Lamé's first parameter [Pa].
    pub lambda: R,
    /// Shear modulus [Pa].
    pub mu: R,
    /// What else the law needs; see its file.
    pub parameters: [R; 4],
}

/// Where a substep has led to, before the law has its say.
#[derive(Clone, Copy, Debug)]
pub struct Trial<R> {
    /// Deformation gradient as if the substep had been elastic; the fast path keeps it from fluids.
    pub f: Mat3<R>,
    /// The law's one number per particle, as it was before the substep; 0 at rest. See the law's file.
    pub memory: R,
    /// Velocity gradient `C` [1/s]; the fast path gives it to fluids alone.
    pub gradient: Mat3<R>,
    /// Length of the substep [s]; 0 only asks for the stress of a state that the law has already seen.
    pub dt: R,
}

/// What a law makes of a trial state.
#[derive(Clone, Copy, Debug)]
pub struct Response<R> {
    /// Elastic deformation gradient after the return mapping; the trial state for elastic laws.
    pub f: Mat3<R>,
    /// The law's number after the substep.
    pub memory: R,
    /// Kirchhoff stress [Pa].
    pub tau: Sym3<R>,
    /// Bound of the largest squared principal elastic stretch.
    pub stretch_squared: R,
    /// Elastic volume ratio `J`; of a fluid the volume ratio.
    pub j: R,
    /// Factor on Lamé's parameters by hardening; 1 for laws without.
    pub stiffness: R,
}

impl Material {
    /// Lamé's first parameter `lambda` [Pa]; of a fluid its bulk modulus.
    pub fn lambda(&self) -> f64 {
        if let Law::Fluid { bulk_modulus, .. } = self.law {
            return bulk_modulus;
        }
        self.youngs_modulus * self.poisson_ratio
            / ((1.0 + self.poisson_ratio) * (1.0 - 2.0 * self.poisson_ratio))
    }

    /// Shear modulus `mu` [Pa].
    pub fn mu(&self) -> f64 {
        self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))
    }
}

impl Coefficients<f64> {
    /// Of a material.
    pub fn new(material: &Material) -> Self {
        Self::of_law(material.law, material.lambda(), material.mu())
    }

    /// Of a law with Lamé's parameters [Pa].
    pub fn of_law(law: Law, lambda: f64, mu: f64) -> Self {
        Self {
            lambda,
            mu,
            parameters: law.prepared(lambda, mu),
        }
    }

    /// The same numbers in all lanes.
    #[inline(always)]
    pub fn splat<R: Real>(&self) -> Coefficients<R> {
        let mut parameters = [R::splat(0.0); 4];
        for n in 0..4 {
            parameters[n] = R::splat(self.parameters[n]);
        }
        Coefficients {
            lambda: R::splat(self.lambda),
            mu: R::splat(self.mu),
            parameters,
        }
    }
}

impl<R: Real> Response<R> {
    /// Lane-wise `mask ? a : b`.
    #[inline(always)]
    fn select(mask: R::Mask, a: &Self, b: &Self) -> Self {
        let mut tau = a.tau;
        for n in 0..6 {
            tau[n] = R::select(mask, a.tau[n], b.tau[n]);
        }
        Self {
            f: Mat3::select(mask, &a.f, &b.f),
            memory: R::select(mask, a.memory, b.memory),
            tau,
            stretch_squared: R::select(mask, a.stretch_squared, b.stretch_squared),
            j: R::select(mask, a.j, b.j),
            stiffness: R::select(mask, a.stiffness, b.stiffness),
        }
    }
}

impl Law {
    /// Whether matter forgets its shape: then the elastic deformation gradient is not the visible one, which the
    /// solver carries apart where Gaussians need it.
    pub fn is_plastic(self) -> bool {
        match self {
            Self::VonMises { .. }
            | Self::DruckerPrager { .. }
            | Self::Snow { .. }
            | Self::Foam { .. }
            | Self::Plasticine { .. } => true,
            Self::FixedCorotated
            | Self::NeoHookean
            | Self::Hencky
            | Self::Fluid { .. }
            | Self::Rigid => false,
        }
    }

    /// Whether only the volume ratio matters: the law then ignores `F`, which is free to carry the visible shape,
    /// and its memory is `J - 1`.
    pub fn is_fluid(self) -> bool {
        matches!(self, Self::Fluid { .. })
    }

    /// Whether `E` and `nu` belong to the law.
    pub fn is_elastic(self) -> bool {
        self.entry().elastic
    }

    /// The law's numbers as its kernel wants them; see its file.
    fn prepared(self, lambda: f64, mu: f64) -> [f64; 4] {
        match self {
            Self::FixedCorotated | Self::NeoHookean | Self::Hencky | Self::Rigid => [0.0; 4],
            Self::VonMises {
                yield_stress,
                hardening,
            } => von_mises::parameters(yield_stress, hardening, mu),
            Self::DruckerPrager {
                friction_angle,
                cohesion,
            } => drucker_prager::parameters(friction_angle, cohesion, lambda, mu),
            Self::Snow {
                critical_compression,
                critical_stretch,
                hardening,
            } => snow::parameters(critical_compression, critical_stretch, hardening),
            Self::Foam {
                yield_stress,
                viscosity,
                exponent,
            } => foam::parameters(yield_stress, viscosity, exponent, mu),
            Self::Plasticine {
                yield_stress,
                softening,
            } => plasticine::parameters(yield_stress, softening, mu),
            Self::Fluid {
                bulk_modulus,
                viscosity,
            } => fluid::parameters(bulk_modulus, viscosity),
        }
    }

    /// Whether matter has no shape of its own: fluids and grains.
    pub fn is_loose(self) -> bool {
        matches!(self, Self::Fluid { .. } | Self::DruckerPrager { .. })
    }

    /// Whether matter keeps its shape when nothing is beyond its elastic limit.
    pub fn is_solid(self) -> bool {
        !self.is_loose() && !self.is_rigid()
    }

    /// Whether matter springs back from any deformation: all its energy is that of `F`, and its memory stays 0.
    pub fn keeps_elastic(self) -> bool {
        self.is_solid() && !self.is_plastic()
    }

    /// Whether all particles of an object under this law move as one body.
    pub fn is_rigid(self) -> bool {
        matches!(self, Self::Rigid)
    }

    /// Return mapping and stress.
    #[inline(always)]
    pub fn respond<R: Real>(self, trial: &Trial<R>, k: &Coefficients<R>) -> Response<R> {
        match self {
            Self::FixedCorotated => elastic(
                trial,
                fixed_corotated::kirchhoff_stress(&trial.f, k.lambda, k.mu),
            ),
            Self::NeoHookean => elastic(
                trial,
                neo_hookean::kirchhoff_stress(&trial.f, k.lambda, k.mu),
            ),
            Self::Hencky
            | Self::VonMises { .. }
            | Self::DruckerPrager { .. }
            | Self::Foam { .. }
            | Self::Plasticine { .. } => hencky::respond(self, trial, k),
            Self::Snow { .. } => snow::respond(trial, k),
            Self::Fluid { .. } => fluid::respond(trial, k),
            Self::Rigid => elastic(trial, [R::splat(0.0); 6]),
        }
    }

    /// Elastic energy per rest volume [J/m^3] at the elastic deformation gradient `f` and the law's own number.
    #[inline(always)]
    pub fn energy_density<R: Real>(self, f: &Mat3<R>, memory: R, k: &Coefficients<R>) -> R {
        match self {
            Self::FixedCorotated => fixed_corotated::energy_density(f, k.lambda, k.mu),
            Self::NeoHookean => neo_hookean::energy_density(f, k.lambda, k.mu),
            Self::Hencky
            | Self::VonMises { .. }
            | Self::DruckerPrager { .. }
            | Self::Foam { .. }
            | Self::Plasticine { .. } => hencky::energy_density(self, f, memory, k),
            Self::Snow { .. } => {
                let factor = snow::stiffness(memory, k);
                fixed_corotated::energy_density(f, k.lambda * factor, k.mu * factor)
            }
            Self::Fluid { .. } => fluid::energy_density(memory, k),
            Self::Rigid => R::splat(0.0),
        }
    }
}

/// The response of a law that remembers nothing.
#[inline(always)]
fn elastic<R: Real>(trial: &Trial<R>, tau: Sym3<R>) -> Response<R> {
    Response {
        f: trial.f,
        memory: trial.memory,
        tau,
        stretch_squared: limits::max_stretch_squared(&trial.f),
        j: trial.f.det(),
        stiffness: R::splat(1.0),
    }
}

#[cfg(test)]
mod flow_tests;
#[cfg(test)]
mod tests;
