//! A material in words: a preset, a law and numbers by the keys of a scene file.

use cosplat_sim_core::materials::{
    Law, Material,
    laws::{Entry, LAWS, OutOfRange, by_name},
};

use super::presets::{self, UnknownPreset};

/// Why words are not a material.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoMaterial {
    /// No such preset.
    #[error(transparent)]
    Preset(#[from] UnknownPreset),
    /// No such law.
    #[error("unknown law `{name}`; known laws: {}", LAWS.iter().map(|law| law.name).collect::<Vec<_>>().join(", "))]
    Law {
        /// The name asked for.
        name: String,
    },
    /// Neither preset nor law.
    #[error("a material needs a preset or a law")]
    Empty,
    /// A number that the law needs.
    #[error("the law `{law}` needs `{key}`")]
    Missing {
        /// The law.
        law: &'static str,
        /// What is missing.
        key: &'static str,
    },
    /// A number that the law does not have.
    #[error("the law `{law}` has no `{key}`, only: {known}")]
    Foreign {
        /// The law.
        law: &'static str,
        /// What was given.
        key: String,
        /// What the law has.
        known: String,
    },
    /// A number out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
}

/// Young's modulus and Poisson's ratio, of laws that have them.
const ELASTIC: [&str; 2] = ["youngs_modulus_pa", "poisson_ratio"];

fn keys(law: &Entry) -> Vec<&'static str> {
    let elastic = if law.elastic { &ELASTIC[..] } else { &[] };
    let own = law.parameters.iter().map(|parameter| parameter.key);
    elastic.iter().copied().chain(own).collect()
}

/// The material that words and numbers state: a preset lends the numbers of its law that are not stated. Density
/// is that of the preset, or of water.
///
/// # Errors
/// [`NoMaterial`] says what is unknown, missing, too much or out of range.
pub fn material<'a>(
    preset: Option<&str>,
    law: Option<&str>,
    numbers: impl IntoIterator<Item = (&'a str, f64)>,
) -> Result<Material, NoMaterial> {
    let base = preset.map(presets::find).transpose()?;
    let entry = match (law, &base) {
        (Some(name), _) => by_name(name).ok_or_else(|| NoMaterial::Law { name: name.into() })?,
        (None, Some(base)) => base.law.entry(),
        (None, None) => return Err(NoMaterial::Empty),
    };
    let keys = keys(entry);
    let mut values = vec![None; keys.len()];
    if let Some(base) = &base {
        let mut lent = Vec::new();
        if base.law.is_elastic() && entry.elastic {
            lent.extend([base.youngs_modulus, base.poisson_ratio]);
        }
        // Parameters stand behind the moduli; where the law changes, only the latter are lent.
        if base.law.id() == entry.id {
            lent.extend(&base.law.parameters()[..entry.parameters.len()]);
        }
        for (value, lent) in values.iter_mut().zip(lent) {
            *value = Some(lent);
        }
    }
    for (key, number) in numbers {
        let Some(n) = keys.iter().position(|known| *known == key) else {
            return Err(NoMaterial::Foreign {
                law: entry.name,
                key: key.into(),
                known: keys.join(", "),
            });
        };
        values[n] = Some(number);
    }
    let mut stated = Vec::with_capacity(keys.len());
    for (key, value) in keys.iter().zip(values) {
        let law = entry.name;
        stated.push(value.ok_or(NoMaterial::Missing { law, key })?);
    }
    let (moduli, own) = stated.split_at(if entry.elastic { 2 } else { 0 });
    let mut parameters = [0.0; 4];
    parameters[..own.len()].copy_from_slice(own);
    let law = Law::from_parameters(entry.id, parameters);
    let material = Material {
        name: base.as_ref().map_or("custom", |base| &base.name).into(),
        law: law.ok_or_else(|| NoMaterial::Law {
            name: entry.name.into(),
        })?,
        youngs_modulus: moduli.first().copied().unwrap_or(0.0),
        poisson_ratio: moduli.get(1).copied().unwrap_or(0.0),
        density: base.as_ref().map_or(1000.0, |base| base.density),
        loss: base.map_or(0.0, |base| base.loss),
    };
    material.check()?;
    Ok(material)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_and_laws_are_stated_in_words() {
        let steel = presets::find("steel").expect("listed");
        assert_eq!(material(Some("steel"), None, []), Ok(steel.clone()));
        let harder = material(Some("steel"), None, [("hardening_pa", 2e9)]);
        let harder = harder.expect("valid").law.parameters();
        assert_eq!(harder[..2], [steel.law.parameters()[0], 2e9]);
        let sand = material(
            Some("steel"),
            Some("drucker_prager"),
            [("cohesion", 0.0), ("friction_angle_deg", 30.0)],
        );
        let sand = sand.expect("valid");
        assert_eq!(sand.law.parameters(), [30.0, 0.0, 0.0, 0.0]);
        assert_eq!(sand.youngs_modulus, steel.youngs_modulus);
        let oil = [("bulk_modulus_pa", 1e6), ("viscosity_pa_s", 0.1)];
        let oil = material(None, Some("fluid"), oil).expect("valid");
        assert_eq!((oil.youngs_modulus, oil.lambda()), (0.0, 1e6));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let error = |preset, law, numbers: &[(&str, f64)]| {
            let found = material(preset, law, numbers.iter().copied());
            found.expect_err("wrong").to_string()
        };
        assert_eq!(error(None, None, &[]), "a material needs a preset or a law");
        assert!(error(Some("steal"), None, &[]).contains("did you mean `steel`?"));
        assert!(error(None, Some("sand"), &[]).contains("drucker_prager"));
        assert_eq!(
            error(Some("water"), Some("snow"), &[]),
            "the law `snow` needs `youngs_modulus_pa`"
        );
        assert_eq!(
            error(Some("water"), None, &[("cohesion", 1.0)]),
            "the law `fluid` has no `cohesion`, only: bulk_modulus_pa, viscosity_pa_s"
        );
        let text = error(Some("dry_sand"), None, &[("friction_angle_deg", 90.0)]);
        assert_eq!(text, "friction_angle_deg is 90, expected 1 to 60");
    }
}
