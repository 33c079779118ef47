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

/// Constitutive laws, with what they need besides Lamé's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Fixed corotated elasticity (Stomakhin et al. 2012).
    FixedCorotated,
    /// Compressible neo-Hookean elasticity with a logarithmic barrier (Bonet & Wood 2008).
    NeoHookean,
    /// No deformation at all: all rigid particles of an object move as one body.
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
    /// Deformation gradient as if the substep had been elastic.
    pub f: Mat3<R>,
    /// The law's one number per particle, as it was before the substep; 0 at rest. See the law's file.
    pub memory: R,
    /// Velocity gradient `C` [1/s].
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

impl Coefficients<f64> {
    /// Of a material.
    pub fn new(material: &Material) -> Self {
        Self {
            lambda: material.lambda(),
            mu: material.mu(),
            parameters: [0.0; 4],
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

impl Law {
    /// Number of the law on the wire and in hashes.
    pub fn id(self) -> u32 {
        match self {
            Self::FixedCorotated => 1,
            Self::NeoHookean => 2,
            Self::Rigid => 9,
        }
    }

    /// Whether matter forgets its shape: then the elastic deformation gradient is not the visible one, which the
    /// solver carries apart where Gaussians need it.
    pub fn is_plastic(self) -> bool {
        false
    }

    /// Whether only the volume ratio matters: the law then ignores `F`, which is free to carry the visible shape,
    /// and its memory is `J - 1`.
    pub fn is_fluid(self) -> bool {
        false
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
            Self::Rigid => elastic(trial, [R::splat(0.0); 6]),
        }
    }

    /// Elastic energy per rest volume [J/m^3] at the elastic deformation gradient `f` and the law's own number.
    #[inline(always)]
    pub fn energy_density<R: Real>(self, f: &Mat3<R>, _memory: R, k: &Coefficients<R>) -> R {
        match self {
            Self::FixedCorotated => fixed_corotated::energy_density(f, k.lambda, k.mu),
            Self::NeoHookean => neo_hookean::energy_density(f, k.lambda, k.mu),
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
mod tests;
