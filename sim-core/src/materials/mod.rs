//! Constitutive laws, one file each.

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
