//! Constitutive laws, one file each.

pub mod fixed_corotated;
pub mod limits;
pub mod neo_hookean;
pub mod polar;
pub mod presets;
pub mod svd;

use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// A material: a law and its parameters in SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Preset or user name, for reports.
    pub name: String,
    /// Constitutive law.
    pub law: Law,
    /// Young's modulus `E` [Pa], > 0.
    pub youngs_modulus: f64,
    /// Poisson's ratio `nu`, 0 <= nu < 0.5.
    pub poisson_ratio: f64,
    /// Density at rest [kg/m^3], > 0.
    pub density: f64,
}

/// Constitutive laws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Law {
    /// Fixed corotated elasticity (Stomakhin et al. 2012).
    FixedCorotated = 1,
    /// Compressible neo-Hookean elasticity with a logarithmic barrier (Bonet & Wood 2008).
    NeoHookean = 2,
}

impl Material {
    /// Lamé's first parameter `lambda` [Pa].
    pub fn lambda(&self) -> f64 {
        self.youngs_modulus * self.poisson_ratio
            / ((1.0 + self.poisson_ratio) * (1.0 - 2.0 * self.poisson_ratio))
    }

    /// Shear modulus `mu` [Pa].
    pub fn mu(&self) -> f64 {
        self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))
    }
}

impl Law {
    /// Kirchhoff stress [Pa] at the deformation gradient `f`, Lamé parameters in [Pa].
    #[inline(always)]
    pub fn kirchhoff_stress<R: Real>(self, f: &Mat3<R>, lambda: R, mu: R) -> Sym3<R> {
        match self {
            Self::FixedCorotated => fixed_corotated::kirchhoff_stress(f, lambda, mu),
            Self::NeoHookean => neo_hookean::kirchhoff_stress(f, lambda, mu),
        }
    }

    /// Elastic energy per rest volume [J/m^3] at the deformation gradient `f`.
    #[inline(always)]
    pub fn energy_density<R: Real>(self, f: &Mat3<R>, lambda: R, mu: R) -> R {
        match self {
            Self::FixedCorotated => fixed_corotated::energy_density(f, lambda, mu),
            Self::NeoHookean => neo_hookean::energy_density(f, lambda, mu),
        }
    }
}

#[cfg(test)]
mod tests;
