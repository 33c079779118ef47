//! Named materials with handbook values.
//!
//! Sources, by letter at each entry. Values are mid-range for the class; a scene overrides what it knows better.
//! - A: M. F. Ashby, *Materials Selection in Mechanical Design*, 4th ed., appendix A (modulus, density, strength).
//! - D: B. M. Das, *Principles of Foundation Engineering* (moduli, friction angles and undrained strengths of soils).
//! - E: no single source: an estimate within the range in which measurements of the class scatter.
//! - G: L. J. Gibson & M. F. Ashby, *Cellular Solids*, 2nd ed. (cork, foams; Poisson's ratio near 0 in cork,
//!   near 0.3 in foams).
//! - L: loss factors of all, orders of magnitude at 10 Hz to 1 kHz: L. Cremer, M. Heckl, *Structure-Borne Sound*, 2nd ed. 1988, table
//!   3.1 (metals up to 0.001, glass 0.001, brick and wood 0.01, cork 0.15); R. S. Lakes, *Viscoelastic Materials*, 2009 (polymers and
//!   rubber 0.1); K for foams of soap; E for gels, clays and pastes.
//! - K: H. Komatsu, H. Yamada, S. Fukushima 1978, J. Soc. Cosmet. Chem. 29, 237 (soap foams: shear modulus 50 to 85 Pa,
//!   loss tangent 0.3).
//! - M: A. Z. Markidou, W. Y. Shih, W.-H. Shih 2005, Rev. Sci. Instrum. 76, 064302 (gelatine gels, some kPa to some tens of kPa).
//! - R: R. Morrell, *Handbook of Properties of Technical and Engineering Ceramics*, part 1 (porcelain).
//! - S: Smooth-On technical bulletin, Ecoflex 00-30 (68.9 kPa at 100 % strain, 1.07 g/cm^3).
//! - T: ASTM A36 structural steel (yield 250 MPa, strength 400 to 550 MPa at 20 % elongation), 6061-T6 aluminium (276
//!   and 310 MPa at 12 %): hardening is the slope between yield and strength, in true stress, rounded.
//! - Y: A. Stomakhin et al. 2013 (snow: 1.4e5 Pa, 0.2, 400 kg/m^3, limits 2.5e-2 and 7.5e-3, hardening 10); fresh snow is
//!   their softer, more powdery corner at a density of M. Mellor 1975, *A review of basic snow mechanics*.
//!
//! Rubber-like entries have Poisson's ratio 0.45 to 0.48 where the real value is 0.499 and more: a particle
//! method locks near 0.5, and the bulk stiffness would buy nothing but small time steps. For the same reason water and
//! honey have a thousandth of water's bulk modulus, 2.2 GPa: sound at 47 m/s, and a density that changes by less than one
//! per cent as long as the fluid moves at less than a tenth of that.
//! Sand is as stiff as the root of what presses it: 15 MPa hold at 100 kPa, deep in the ground, 2 MPa a decimetre deep in a heap. What is
//! too stiff costs substeps, and transfers damp what sand does in each of them (`docs/validation.md`).
//! The stiff entries (GPa) are exact but slow to simulate: the time step goes with `sqrt(rho / E)`.

use cosplat_sim_core::materials::{Law, Material};

/// A named material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name used in scene files.
    pub name: &'static str,
    /// Constitutive law.
    pub law: Law,
    /// Young's modulus [Pa]; 0 where the law has none.
    pub youngs_modulus: f64,
    /// Poisson's ratio; 0 where the law has none.
    pub poisson_ratio: f64,
    /// Density [kg/m^3].
    pub density: f64,
    /// Loss factor `tan delta`; 0 where the law has no vibration.
    pub loss: f64,
    /// Where the numbers are from, as letters of [`SOURCES`], and which of the class they are.
    pub source: &'static str,
}

/// Works that numbers are from, by the letter that presets name them by.
pub const SOURCES: &[(char, &str)] = &[
    (
        'A',
        "M. F. Ashby, Materials Selection in Mechanical Design, 4th ed. 2011, appendix A",
    ),
    ('D', "B. M. Das, Principles of Foundation Engineering"),
    (
        'E',
        "an estimate within the range in which measurements of the class scatter",
    ),
    (
        'G',
        "L. J. Gibson & M. F. Ashby, Cellular Solids, 2nd ed. 1997",
    ),
    (
        'K',
        "H. Komatsu, H. Yamada, S. Fukushima 1978, J. Soc. Cosmet. Chem. 29, 237",
    ),
    (
        'M',
        "A. Z. Markidou, W. Y. Shih, W.-H. Shih 2005, Rev. Sci. Instrum. 76, 064302",
    ),
    (
        'R',
        "R. Morrell, Handbook of Properties of Technical and Engineering Ceramics, part 1",
    ),
    ('S', "Smooth-On technical bulletin, Ecoflex 00-30"),
    ('T', "ASTM A36 structural steel, 6061-T6 aluminium"),
    (
        'Y',
        "A. Stomakhin et al. 2013; M. Mellor 1975, A review of basic snow mechanics",
    ),
];

/// Shorthand for one line of the table.
const fn preset(
    name: &'static str,
    law: Law,
    [e, nu, rho, loss]: [f64; 4],
    source: &'static str,
) -> Preset {
    Preset {
        name,
        law,
        youngs_modulus: e,
        poisson_ratio: nu,
        density: rho,
        loss,
        source,
    }
}

/// Metal that yields at `yield_stress` [Pa] and hardens by `hardening` [Pa].
const fn metal(yield_stress: f64, hardening: f64) -> Law {
    Law::VonMises {
        yield_stress,
        hardening,
    }
}

const fn sand(friction_angle: f64, cohesion: f64) -> Law {
    Law::DruckerPrager {
        friction_angle,
        cohesion,
    }
}

const fn snow(critical_compression: f64, critical_stretch: f64, hardening: f64) -> Law {
    Law::Snow {
        critical_compression,
        critical_stretch,
        hardening,
    }
}

const fn paste(yield_stress: f64, viscosity: f64, exponent: f64) -> Law {
    Law::Foam {
        yield_stress,
        viscosity,
        exponent,
    }
}

const fn fluid(viscosity: f64) -> Law {
    Law::Fluid {
        bulk_modulus: 2.2e6,
        viscosity,
    }
}

const PLASTICINE: Law = Law::Plasticine {
    yield_stress: 1.2e5,
    softening: 1.0e5,
};

/// Every preset: elastic ones, soft ones first, then those that flow.
pub const PRESETS: &[Preset] = &[
    preset("jelly", Law::NeoHookean, [1.0e4, 0.45, 1020.0, 0.1], "M"),
    preset(
        "soft_rubber",
        Law::NeoHookean,
        [1.0e5, 0.48, 1070.0, 0.1],
        "S",
    ),
    preset(
        "foam",
        Law::FixedCorotated,
        [1.0e6, 0.3, 60.0, 0.15],
        "A, G: flexible polymer foam",
    ),
    preset(
        "rubber",
        Law::NeoHookean,
        [2.0e6, 0.48, 925.0, 0.1],
        "A: natural rubber",
    ),
    preset(
        "cork",
        Law::FixedCorotated,
        [3.0e7, 0.05, 180.0, 0.15],
        "A, G",
    ),
    preset(
        "leather",
        Law::FixedCorotated,
        [3.0e8, 0.4, 930.0, 0.1],
        "A",
    ),
    preset(
        "polyethylene",
        Law::FixedCorotated,
        [7.5e8, 0.42, 950.0, 0.1],
        "A",
    ),
    preset(
        "wood",
        Law::FixedCorotated,
        [1.0e9, 0.3, 700.0, 0.01],
        "A: across the grain, taken as isotropic",
    ),
    preset(
        "brick",
        Law::FixedCorotated,
        [2.0e10, 0.2, 1900.0, 0.01],
        "A",
    ),
    preset(
        "concrete",
        Law::FixedCorotated,
        [3.0e10, 0.2, 2400.0, 0.01],
        "A",
    ),
    preset(
        "glass",
        Law::FixedCorotated,
        [7.0e10, 0.23, 2465.0, 0.001],
        "A: soda-lime",
    ),
    preset(
        "ceramic",
        Law::FixedCorotated,
        [7.0e10, 0.2, 2400.0, 0.001],
        "R: hard porcelain",
    ),
    preset(
        "aluminium",
        metal(2.76e8, 5.0e8),
        [7.0e10, 0.33, 2700.0, 0.001],
        "A, T: 6061-T6",
    ),
    preset(
        "steel",
        metal(2.5e8, 1.0e9),
        [2.1e11, 0.29, 7850.0, 0.001],
        "A, T: structural",
    ),
    preset(
        "clay",
        metal(4.0e4, 0.0),
        [5.0e6, 0.45, 1800.0, 0.1],
        "D: medium, undrained shear strength 23 kPa",
    ),
    preset("plasticine", PLASTICINE, [5.0e6, 0.4, 1800.0, 0.2], "E"),
    preset(
        "dry_sand",
        sand(32.0, 0.0),
        [2.0e6, 0.3, 1600.0, 0.0],
        "D: loose, in a heap",
    ),
    preset(
        "wet_sand",
        sand(34.0, 1.5e3),
        [2.0e6, 0.3, 1800.0, 0.0],
        "D, in a heap; cohesion E: capillary, about 1 kPa",
    ),
    preset(
        "fresh_snow",
        snow(0.019, 0.005, 5.0),
        [4.8e4, 0.2, 120.0, 0.0],
        "Y",
    ),
    preset(
        "packed_snow",
        snow(0.025, 0.0075, 10.0),
        [1.4e5, 0.2, 400.0, 0.0],
        "Y",
    ),
    preset(
        "shaving_foam",
        paste(35.0, 5.0, 0.4),
        [450.0, 0.45, 80.0, 0.3],
        "K, E: stiffer than soap foam",
    ),
    preset(
        "toothpaste",
        paste(300.0, 50.0, 0.4),
        [6.0e3, 0.45, 1300.0, 0.3],
        "E",
    ),
    preset(
        "water",
        fluid(1.0e-3),
        [0.0, 0.0, 998.0, 0.0],
        "tables, at 20 degrees C",
    ),
    preset(
        "honey",
        fluid(10.0),
        [0.0, 0.0, 1420.0, 0.0],
        "E: viscosity 2 to 20 Pa s with water and warmth",
    ),
    preset(
        "rigid",
        Law::Rigid,
        [0.0, 0.0, 1000.0, 0.0],
        "density of water",
    ),
];

/// No preset has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown material preset `{name}`{}; known presets: {}", self.hint(), self.known())]
pub struct UnknownPreset {
    /// The name asked for.
    pub name: String,
    /// The most similar known name, if one is close.
    pub suggestion: Option<&'static str>,
}

impl UnknownPreset {
    fn hint(&self) -> String {
        self.suggestion
            .map(|name| format!(", did you mean `{name}`?"))
            .unwrap_or_default()
    }

    fn known(&self) -> String {
        let names: Vec<_> = PRESETS.iter().map(|preset| preset.name).collect();
        names.join(", ")
    }
}

/// The preset of that name.
///
/// # Errors
/// [`UnknownPreset`], which lists the known names and the nearest one.
pub fn find(name: &str) -> Result<Material, UnknownPreset> {
    if let Some(preset) = PRESETS.iter().find(|preset| preset.name == name) {
        return Ok(Material {
            name: preset.name.to_owned(),
            law: preset.law,
            youngs_modulus: preset.youngs_modulus,
            poisson_ratio: preset.poisson_ratio,
            density: preset.density,
            loss: preset.loss,
        });
    }
    let wanted = name.to_lowercase().replace(['-', ' '], "_");
    let similarity = |preset: &Preset| strsim::jaro_winkler(&wanted, preset.name);
    let nearest = PRESETS
        .iter()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
    Err(UnknownPreset {
        name: name.to_owned(),
        suggestion: nearest
            .filter(|preset| similarity(preset) > 0.8)
            .map(|preset| preset.name),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_found_and_physically_valid() {
        for preset in PRESETS {
            let material = find(preset.name).expect("listed");
            assert_eq!(material.check(), Ok(()), "{}", preset.name);
            // Shaving foam to steel.
            assert!((50.0..10_000.0).contains(&material.density));
            if material.law.is_rigid() {
                continue;
            }
            // Wave speeds: jelly a few m/s, steel 5.9 km/s.
            let speed = ((material.lambda() + 2.0 * material.mu()) / material.density).sqrt();
            assert!((1.0..7000.0).contains(&speed), "{}: {speed}", preset.name);
        }
    }

    #[test]
    fn strengths_are_in_the_same_unit_as_stiffness() {
        for preset in PRESETS {
            // Metals flow from a strain of some thousandths, pastes and clays from some per cent.
            let (strength, high) = match preset.law {
                Law::VonMises { yield_stress, .. } => (yield_stress, 0.02),
                Law::Plasticine { yield_stress, .. } => (yield_stress, 0.05),
                Law::Foam { yield_stress, .. } => (yield_stress, 0.2),
                _ => continue,
            };
            let strain = strength / preset.youngs_modulus;
            assert!((5e-4..high).contains(&strain), "{}: {strain}", preset.name);
        }
        let viscosity = |name| match find(name).expect("listed").law {
            Law::Fluid { viscosity, .. } => viscosity,
            other => panic!("{other:?} is no fluid"),
        };
        // mPa s by tables, Pa s here.
        assert_eq!(viscosity("water"), 1e-3);
        assert!((1.0..100.0).contains(&viscosity("honey")));
    }

    #[test]
    fn sand_is_as_stiff_as_in_a_heap() {
        for name in ["dry_sand", "wet_sand"] {
            let sand = find(name).expect("listed");
            let pressed = sand.density * 9.81 * 0.1;
            // 15 MPa at 100 kPa (Das), as the root of the pressure.
            let stiffness = 15e6 * (pressed / 100e3).sqrt();
            let ratio = sand.youngs_modulus / stiffness;
            assert!((0.8..1.25).contains(&ratio), "{name}: {ratio}");
        }
    }

    #[test]
    fn every_preset_says_where_it_is_from() {
        for preset in PRESETS {
            let words = preset.source.split([',', ':', ';']).map(str::trim);
            let letters: Vec<_> = words.filter(|w| w.len() == 1).collect();
            let is_known = |w: &str| SOURCES.iter().any(|(letter, _)| w.starts_with(*letter));
            assert!(letters.iter().all(|w| is_known(w)), "{}", preset.name);
            let in_words = ["rigid", "water"].contains(&preset.name);
            assert!(in_words || !letters.is_empty(), "{}", preset.name);
        }
    }

    #[test]
    fn names_are_unique() {
        let mut names: Vec<_> = PRESETS.iter().map(|preset| preset.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), PRESETS.len());
    }

    #[test]
    fn a_misspelt_name_gets_the_list_and_a_suggestion() {
        let error = find("Soft Ruber").expect_err("misspelt");
        assert_eq!(error.suggestion, Some("soft_rubber"));
        let text = error.to_string();
        assert!(text.contains("did you mean `soft_rubber`?"), "{text}");
        assert!(text.contains("steel") && text.contains("jelly"), "{text}");
        let error = find("unobtainium").expect_err("not a material");
        assert_eq!(error.suggestion, None);
    }
}
