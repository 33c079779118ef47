//! Named materials with handbook values.
//!
//! Sources, by letter at each entry. Values are mid-range for the class; a scene overrides what it knows better.
//! - A: M. F. Ashby, *Materials Selection in Mechanical Design*, 4th ed., appendix A (modulus, density).
//! - G: L. J. Gibson & M. F. Ashby, *Cellular Solids*, 2nd ed. (cork, foams; Poisson's ratio near 0 in cork,
//!   near 0.3 in foams).
//! - S: Smooth-On technical bulletin, Ecoflex 00-30 (68.9 kPa at 100 % strain, 1.07 g/cm^3).
//! - M: A. Z. Markidou, W. Y. Shih, W.-H. Shih 2005, Rev. Sci. Instrum. 76, 064302 (gelatine gels, some kPa to some tens of kPa).
//! - R: R. Morrell, *Handbook of Properties of Technical and Engineering Ceramics*, part 1 (porcelain).
//!
//! Rubber-like entries have Poisson's ratio 0.45 to 0.48 where the real value is 0.499 and more: a particle
//! method locks near 0.5, and the bulk stiffness would buy nothing but small time steps.
//! The stiff entries (GPa) are exact but slow to simulate: the time step goes with `sqrt(rho / E)`.

use super::{Law, Material};

/// A named material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name used in scene files.
    pub name: &'static str,
    /// Constitutive law.
    pub law: Law,
    /// Young's modulus [Pa].
    pub youngs_modulus: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Density [kg/m^3].
    pub density: f64,
}

/// Shorthand for one line of the table.
const fn preset(name: &'static str, law: Law, e: f64, nu: f64, rho: f64) -> Preset {
    Preset {
        name,
        law,
        youngs_modulus: e,
        poisson_ratio: nu,
        density: rho,
    }
}

/// Every preset, soft ones first.
pub const PRESETS: &[Preset] = &[
    preset("jelly", Law::NeoHookean, 1.0e4, 0.45, 1020.0), // M
    preset("soft_rubber", Law::NeoHookean, 1.0e5, 0.48, 1070.0), // S
    preset("foam", Law::FixedCorotated, 1.0e6, 0.3, 60.0), // A, G: flexible polymer foam
    preset("rubber", Law::NeoHookean, 2.0e6, 0.48, 925.0), // A: natural rubber
    preset("cork", Law::FixedCorotated, 3.0e7, 0.05, 180.0), // A, G
    preset("leather", Law::FixedCorotated, 3.0e8, 0.4, 930.0), // A
    preset("polyethylene", Law::FixedCorotated, 7.5e8, 0.42, 950.0), // A
    preset("wood", Law::FixedCorotated, 1.0e9, 0.3, 700.0), // A: across the grain, taken as isotropic
    preset("brick", Law::FixedCorotated, 2.0e10, 0.2, 1900.0), // A
    preset("concrete", Law::FixedCorotated, 3.0e10, 0.2, 2400.0), // A
    preset("aluminium", Law::FixedCorotated, 7.0e10, 0.33, 2700.0), // A
    preset("glass", Law::FixedCorotated, 7.0e10, 0.23, 2465.0), // A: soda-lime
    preset("ceramic", Law::FixedCorotated, 7.0e10, 0.2, 2400.0), // R: hard porcelain
    preset("steel", Law::FixedCorotated, 2.1e11, 0.29, 7850.0), // A: low-alloy
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

impl Material {
    /// The preset of that name.
    ///
    /// # Errors
    /// [`UnknownPreset`], which lists the known names and the nearest one.
    pub fn preset(name: &str) -> Result<Self, UnknownPreset> {
        if let Some(preset) = PRESETS.iter().find(|preset| preset.name == name) {
            return Ok(Self {
                name: preset.name.to_owned(),
                law: preset.law,
                youngs_modulus: preset.youngs_modulus,
                poisson_ratio: preset.poisson_ratio,
                density: preset.density,
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_found_and_physically_valid() {
        for preset in PRESETS {
            let material = Material::preset(preset.name).expect("listed");
            assert!(material.lambda() >= 0.0 && material.mu() > 0.0 && material.density > 0.0);
            assert!((0.0..0.5).contains(&material.poisson_ratio));
            // Wave speeds of solids: jelly a few m/s, steel 5.9 km/s.
            let speed = ((material.lambda() + 2.0 * material.mu()) / material.density).sqrt();
            assert!((1.0..7000.0).contains(&speed), "{}: {speed}", preset.name);
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
        let error = Material::preset("Soft Ruber").expect_err("misspelt");
        assert_eq!(error.suggestion, Some("soft_rubber"));
        let text = error.to_string();
        assert!(text.contains("did you mean `soft_rubber`?"), "{text}");
        assert!(text.contains("steel") && text.contains("jelly"), "{text}");
        let error = Material::preset("unobtainium").expect_err("not a material");
        assert_eq!(error.suggestion, None);
    }
}
