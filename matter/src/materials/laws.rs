//! The table of laws: names, numbers on the wire, and the parameters of each with their valid ranges.
//!
//! Scene files, commands, recordings and hashes all read it, so that a law has one spelling everywhere.

use super::{Law, Material, plasticine};

/// One parameter of a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in scene files and commands.
    pub key: &'static str,
    /// Unit, empty for pure numbers.
    pub unit: &'static str,
    /// Smallest valid value.
    pub min: f64,
    /// Largest valid value.
    pub max: f64,
}

/// One law.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Name in scene files and commands.
    pub name: &'static str,
    /// Number on the wire and in hashes.
    pub id: u32,
    /// Whether the law needs Young's modulus and Poisson's ratio.
    pub elastic: bool,
    /// What the law needs besides density and, if elastic, Young's modulus and Poisson's ratio; at most 4, in the
    /// order of the wire.
    pub parameters: &'static [Parameter],
    /// The law with its parameters, in that order.
    law: fn([f64; 4]) -> Law,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.id == other.id
    }
}

/// A number of a material is outside its valid range, NaN included.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {value}, expected {min} to {max}")]
pub struct OutOfRange {
    /// Which number.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// Smallest valid value.
    pub min: f64,
    /// Largest valid value.
    pub max: f64,
}

const fn parameter(key: &'static str, unit: &'static str, min: f64, max: f64) -> Parameter {
    Parameter {
        key,
        unit,
        min,
        max,
    }
}

const YIELD_STRESS: Parameter = parameter("yield_stress_pa", "Pa", 0.0, 1e13);

/// Every law, in the order of their numbers.
pub const LAWS: &[Entry] = &[
    Entry {
        name: "fixed_corotated",
        id: 1,
        elastic: true,
        parameters: &[],
        law: |_| Law::FixedCorotated,
    },
    Entry {
        name: "neo_hookean",
        id: 2,
        elastic: true,
        parameters: &[],
        law: |_| Law::NeoHookean,
    },
    Entry {
        name: "von_mises",
        id: 3,
        elastic: true,
        parameters: &[YIELD_STRESS, parameter("hardening_pa", "Pa", 0.0, 1e13)],
        law: |[yield_stress, hardening, ..]| Law::VonMises {
            yield_stress,
            hardening,
        },
    },
    Entry {
        name: "drucker_prager",
        id: 4,
        elastic: true,
        parameters: &[
            parameter("friction_angle_deg", "degrees", 1.0, 60.0),
            parameter("cohesion", "Pa", 0.0, 1e9),
        ],
        law: |[friction_angle, cohesion, ..]| Law::DruckerPrager {
            friction_angle,
            cohesion,
        },
    },
    Entry {
        name: "snow",
        id: 5,
        elastic: true,
        // Up to a tenth, for which the short polar decomposition is made.
        parameters: &[
            parameter("critical_compression", "", 1e-4, 0.1),
            parameter("critical_stretch", "", 1e-4, 0.1),
            parameter("hardening", "", 0.0, 100.0),
        ],
        law: |[critical_compression, critical_stretch, hardening, _]| Law::Snow {
            critical_compression,
            critical_stretch,
            hardening,
        },
    },
    Entry {
        name: "foam",
        id: 6,
        elastic: true,
        parameters: &[
            YIELD_STRESS,
            parameter("viscosity_pa_s", "Pa s^exponent", 0.0, 1e9),
            parameter("exponent", "", super::foam::EXPONENT_MIN, 1.0),
        ],
        law: |[yield_stress, viscosity, exponent, _]| Law::Foam {
            yield_stress,
            viscosity,
            exponent,
        },
    },
    Entry {
        name: "plasticine",
        id: 7,
        elastic: true,
        parameters: &[YIELD_STRESS, parameter("softening", "Pa", 0.0, 1e13)],
        law: |[yield_stress, softening, ..]| Law::Plasticine {
            yield_stress,
            softening,
        },
    },
    Entry {
        name: "fluid",
        id: 8,
        elastic: false,
        parameters: &[
            parameter("bulk_modulus_pa", "Pa", 1e-3, 1e13),
            parameter("viscosity_pa_s", "Pa s", 0.0, 1e9),
        ],
        law: |[bulk_modulus, viscosity, ..]| Law::Fluid {
            bulk_modulus,
            viscosity,
        },
    },
    Entry {
        name: "rigid",
        id: 9,
        elastic: false,
        parameters: &[],
        law: |_| Law::Rigid,
    },
    Entry {
        name: "hencky",
        id: 10,
        elastic: true,
        parameters: &[],
        law: |_| Law::Hencky,
    },
];

/// The entry of that number.
pub fn by_id(id: u32) -> Option<&'static Entry> {
    LAWS.iter().find(|entry| entry.id == id)
}

/// The entry of that name.
pub fn by_name(name: &str) -> Option<&'static Entry> {
    LAWS.iter().find(|entry| entry.name == name)
}

/// Laws without parameters that spring back from any deformation, in the order of their numbers.
pub fn elastic_laws() -> impl Iterator<Item = Law> {
    let plain = LAWS.iter().filter(|entry| entry.parameters.is_empty());
    let laws = plain.map(|entry| (entry.law)([0.0; 4]));
    laws.filter(|law| law.keeps_elastic())
}

/// Names of the laws that solids on grids of their own may have, in the order of their numbers.
pub fn names_of_solids() -> impl Iterator<Item = &'static str> {
    let solid = LAWS
        .iter()
        .filter(|entry| (entry.law)([0.0; 4]).may_be_solid());
    solid.map(|entry| entry.name)
}

impl Material {
    /// Checks every number of the material.
    ///
    /// # Errors
    /// The first number outside its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        within("density", self.density, 1e-6, 1e9)?;
        within("loss", self.loss, 0.0, 1.0)?;
        if self.law.is_elastic() {
            within("youngs_modulus", self.youngs_modulus, 1e-6, 1e15)?;
            within("poisson_ratio", self.poisson_ratio, 0.0, 0.4999)?;
        }
        let values = self.law.parameters();
        for (parameter, value) in self.law.entry().parameters.iter().zip(values) {
            within(parameter.key, value, parameter.min, parameter.max)?;
        }
        if let Law::Plasticine { softening, .. } = self.law {
            // Strength must not fall faster than elastic strain takes it up.
            let steepest = plasticine::SOFTENING_MAX * 3.0 * self.mu();
            within("softening", softening, 0.0, steepest)?;
        }
        Ok(())
    }
}

fn within(key: &'static str, value: f64, min: f64, max: f64) -> Result<(), OutOfRange> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(OutOfRange {
        key,
        value,
        min,
        max,
    })
}

impl Law {
    /// Number of the law on the wire and in hashes.
    pub fn id(self) -> u32 {
        match self {
            Self::FixedCorotated => 1,
            Self::NeoHookean => 2,
            Self::VonMises { .. } => 3,
            Self::DruckerPrager { .. } => 4,
            Self::Snow { .. } => 5,
            Self::Foam { .. } => 6,
            Self::Plasticine { .. } => 7,
            Self::Fluid { .. } => 8,
            Self::Rigid => 9,
            Self::Hencky => 10,
        }
    }

    /// The law's entry in the table.
    pub fn entry(self) -> &'static Entry {
        &LAWS[self.id() as usize - 1]
    }

    /// Name of the law.
    pub fn name(self) -> &'static str {
        self.entry().name
    }

    /// The law's numbers in the order of the table; the rest 0.
    pub fn parameters(self) -> [f64; 4] {
        match self {
            Self::FixedCorotated | Self::NeoHookean | Self::Hencky | Self::Rigid => [0.0; 4],
            Self::VonMises {
                yield_stress,
                hardening,
            } => [yield_stress, hardening, 0.0, 0.0],
            Self::DruckerPrager {
                friction_angle,
                cohesion,
            } => [friction_angle, cohesion, 0.0, 0.0],
            Self::Snow {
                critical_compression,
                critical_stretch,
                hardening,
            } => [critical_compression, critical_stretch, hardening, 0.0],
            Self::Foam {
                yield_stress,
                viscosity,
                exponent,
            } => [yield_stress, viscosity, exponent, 0.0],
            Self::Plasticine {
                yield_stress,
                softening,
            } => [yield_stress, softening, 0.0, 0.0],
            Self::Fluid {
                bulk_modulus,
                viscosity,
            } => [bulk_modulus, viscosity, 0.0, 0.0],
        }
    }

    /// The law of that number with these parameters, in the order of the table; `None` where there is no such law.
    /// Ranges are not checked, see [`Material::check`].
    pub fn from_parameters(id: u32, parameters: [f64; 4]) -> Option<Self> {
        by_id(id).map(|entry| (entry.law)(parameters))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_names_and_parameters_go_there_and_back() {
        for (n, entry) in LAWS.iter().enumerate() {
            assert_eq!(entry.id as usize, n + 1);
            let mut numbers = [0.0; 4];
            for (m, parameter) in entry.parameters.iter().enumerate() {
                numbers[m] =
                    parameter.min + 0.25 * (m + 1) as f64 * (parameter.max - parameter.min);
            }
            let law = Law::from_parameters(entry.id, numbers).expect("listed");
            assert_eq!(law.parameters(), numbers);
            assert_eq!((law.name(), law.id()), (entry.name, entry.id));
            assert_eq!(by_name(entry.name), Some(entry));
            assert_eq!(by_id(entry.id), Some(entry));
        }
        assert_eq!(Law::from_parameters(0, [0.0; 4]), None);
        assert_eq!(Law::from_parameters(11, [0.0; 4]), None);
    }

    #[test]
    fn numbers_out_of_range_are_named_with_their_range() {
        let material = |law, youngs_modulus| Material {
            name: "tested".into(),
            law,
            youngs_modulus,
            poisson_ratio: 0.3,
            density: 1000.0,
            loss: 0.0,
        };
        let plasticine = |softening| Law::Plasticine {
            yield_stress: 1e4,
            softening,
        };
        assert_eq!(material(plasticine(1e5), 1e6).check(), Ok(()));
        let steep = material(plasticine(2e6), 1e6).check().expect_err("steep");
        assert!(
            steep.to_string().starts_with("softening is 2000000"),
            "{steep}"
        );
        for law in LAWS.iter().filter(|entry| !entry.parameters.is_empty()) {
            for broken in [f64::NAN, -1.0, f64::INFINITY] {
                let law = Law::from_parameters(law.id, [broken; 4]).expect("listed");
                let error = material(law, 1e6).check().expect_err("broken");
                assert_eq!(error.key, law.entry().parameters[0].key);
            }
        }
        // Fluid and rigid matter have no Young's modulus.
        let fluid = Law::Fluid {
            bulk_modulus: 1e5,
            viscosity: 0.0,
        };
        assert_eq!(material(fluid, 0.0).check(), Ok(()));
        assert_eq!(material(Law::Rigid, 0.0).check(), Ok(()));
        let soft = material(Law::NeoHookean, 0.0).check();
        assert_eq!(soft.expect_err("no stiffness").key, "youngs_modulus");
    }

    #[test]
    fn lists_of_laws_come_from_the_table() {
        let elastic: Vec<&str> = elastic_laws().map(Law::name).collect();
        assert_eq!(elastic, ["fixed_corotated", "neo_hookean", "hencky"]);
        // What may be a solid without parameters springs back, and tells its stress.
        for law in elastic_laws() {
            assert!(law.may_be_solid() && law.without_flow() == law);
        }
        let solid: Vec<&str> = names_of_solids().collect();
        assert_eq!(
            solid,
            [
                "fixed_corotated",
                "neo_hookean",
                "von_mises",
                "foam",
                "plasticine",
                "hencky"
            ]
        );
    }
}
