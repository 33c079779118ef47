//! Text to [`Material`]: a preset by name, with or without overrides, or all parameters.

use std::collections::BTreeMap;

use cosplat_sim_core::materials::{
    Law, Material,
    laws::{self, LAWS},
};

use crate::materials::presets;

use super::{
    error::{At, Finding, suggest},
    limits as l,
    reader::{Bounds, Entry, Table},
};

/// Below this Young's modulus a material is softer than anything one can hold [Pa].
const SUSPICIOUS_YOUNGS_MODULUS: f64 = 100.0;

/// Nothing solid is stretched elastically by more than this share before it flows.
const SUSPICIOUS_YIELD_STRAIN: f64 = 0.5;

/// Materials of the file's `[materials]` table, by name; `None` where an error has been noted.
pub(super) type Known = BTreeMap<String, Option<Material>>;

/// Reads `[materials]`.
pub(super) fn read(root: &Table, warnings: &mut Vec<Finding>) -> Known {
    let mut known = Known::new();
    let table = root.get("materials").and_then(|e| e.table());
    for (name, entry) in table.iter().flat_map(|t| t.named()) {
        let material = from_entry(&entry, &Known::new(), warnings).map(|material| Material {
            name: name.to_owned(),
            ..material
        });
        known.insert(name.to_owned(), material);
    }
    known
}

/// A material by name, or a table with its parameters.
pub(super) fn from_entry(
    entry: &Entry,
    known: &Known,
    warnings: &mut Vec<Finding>,
) -> Option<Material> {
    if entry.is_text() {
        let name = entry.text()?;
        return by_name(entry, name, known);
    }
    let table = entry.table()?;
    let base_entry = table.get("preset");
    let base = base_entry
        .as_ref()
        .and_then(|e| by_name(e, e.text()?, known));
    // Without a preset every number is required; with a broken one none is: one mistake is one error.
    let free = base_entry.is_none();
    let law = match table.get("law") {
        Some(entry) => {
            let names: Vec<_> = LAWS.iter().map(|law| (law.name, law)).collect();
            entry.choice(&names)
        }
        None if free => Some(Law::FixedCorotated.entry()),
        None => base.as_ref().map(|base| base.law.entry()),
    };
    let elastic = law.is_none_or(|law| law.elastic);
    let base_elastic = base.as_ref().filter(|base| base.law.is_elastic());
    let number = |key, bounds, required| {
        let entry = if required {
            table.required(key)?
        } else {
            table.get(key)?
        };
        Some((entry.number(bounds)?, entry.at))
    };
    let density = number("density_kg_m3", l::DENSITY, free && law.is_some());
    let loss = number("loss", l::LOSS, false);
    let mut youngs_modulus = None;
    let mut poisson_ratio = None;
    if elastic {
        let required = law.is_some() && base_elastic.is_none() && (free || base.is_some());
        youngs_modulus = number("youngs_modulus_pa", l::YOUNGS_MODULUS, required);
        poisson_ratio = number("poisson_ratio", l::POISSON_RATIO, required);
    }
    let parameters = law.map(|law| parameters(&table, law, base.as_ref(), free));
    refuse_foreign_keys(&table, law);
    let at = table.at.clone();
    table.finish();
    if let Some((value, at)) = &youngs_modulus
        && *value < SUSPICIOUS_YOUNGS_MODULUS
    {
        let message = format!(
            "{value} Pa is softer than any solid one can hold: is it meant in another unit, such as kPa or MPa?"
        );
        warnings.push(Finding::new(at, message));
    }
    let elastic_number = |read: Option<(f64, At)>, of_base: fn(&Material) -> f64| {
        if elastic {
            read.map(|x| x.0).or_else(|| base_elastic.map(of_base))
        } else {
            Some(0.0)
        }
    };
    let material = Material {
        name: base.as_ref().map_or("custom", |base| &base.name).into(),
        law: Law::from_parameters(law?.id, parameters??)?,
        youngs_modulus: elastic_number(youngs_modulus, |base| base.youngs_modulus)?,
        poisson_ratio: elastic_number(poisson_ratio, |base| base.poisson_ratio)?,
        density: density
            .map(|x| x.0)
            .or(base.as_ref().map(|base| base.density))?,
        loss: loss
            .map(|x| x.0)
            .or(base.map(|base| base.loss))
            .unwrap_or(0.0),
    };
    if let Err(found) = material.check() {
        entry.error(found.to_string());
        return None;
    }
    warnings.extend(late_yield(&material).map(|message| Finding::new(&at, message)));
    Some(material)
}

/// The warning about a yield stress that no strain comes near.
fn late_yield(material: &Material) -> Option<String> {
    let stated = material.law.entry().parameters.iter();
    let mut numbers = stated.zip(material.law.parameters());
    let (_, value) = numbers.find(|(parameter, _)| parameter.key == "yield_stress_pa")?;
    let modulus = material.youngs_modulus;
    (value > SUSPICIOUS_YIELD_STRAIN * modulus).then(|| {
        format!(
            "a yield stress of {value} Pa is more than half of Young's modulus, {modulus} Pa: is one of the two meant in another unit?"
        )
    })
}

/// The law's own numbers: those of the file, else those of a preset with the same law.
fn parameters(
    table: &Table,
    law: &laws::Entry,
    base: Option<&Material>,
    free: bool,
) -> Option<[f64; 4]> {
    let inherited = base
        .filter(|base| base.law.id() == law.id)
        .map(|base| base.law.parameters());
    let required = inherited.is_none() && (free || base.is_some());
    let mut numbers = [Some(0.0); 4];
    for (n, parameter) in law.parameters.iter().enumerate() {
        let entry = if required {
            table.required(parameter.key)
        } else {
            table.get(parameter.key)
        };
        let bounds = Bounds {
            min: parameter.min,
            max: parameter.max,
            unit: parameter.unit,
        };
        numbers[n] = match entry {
            Some(entry) => entry.number(bounds),
            None => inherited.map(|numbers| numbers[n]),
        };
    }
    let [a, b, c, d] = numbers;
    Some([a?, b?, c?, d?])
}

/// Keys that other laws have are errors that say which; where the law is not known, they pass.
fn refuse_foreign_keys(table: &Table, law: Option<&laws::Entry>) {
    let own = |law: &laws::Entry, key: &str| {
        let elastic = law.elastic && ["youngs_modulus_pa", "poisson_ratio"].contains(&key);
        elastic || law.parameters.iter().any(|p| p.key == key)
    };
    let parameters = LAWS.iter().flat_map(|law| law.parameters);
    let keys = parameters.map(|parameter| parameter.key);
    let mut seen = Vec::new();
    for key in ["youngs_modulus_pa", "poisson_ratio"]
        .into_iter()
        .chain(keys)
    {
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        let entry = table.get(key);
        if let (Some(entry), Some(law)) = (entry, law)
            && !own(law, key)
        {
            let having = LAWS.iter().filter(|law| own(law, key));
            let names: Vec<_> = having.map(|law| law.name).collect();
            entry.error(format!(
                "the law `{}` has no such number; those that have: {}",
                law.name,
                names.join(", ")
            ));
        }
    }
}

fn by_name(entry: &Entry, name: &str, known: &Known) -> Option<Material> {
    if let Some(material) = known.get(name) {
        return material.clone();
    }
    let preset = presets::find(name).ok();
    if preset.is_none() {
        let names = known.keys().map(String::as_str);
        let hint = suggest(name, names.chain(presets::PRESETS.iter().map(|p| p.name)));
        entry.error(format!("material `{name}` is not known: {hint}"));
    }
    preset
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::reader::Context;

    /// The material of an inline table and the warnings about it, or everything that is wrong.
    fn material(table: &str) -> Result<(Material, Vec<String>), Vec<String>> {
        let text = format!("material = {table}");
        let root = toml::de::DeTable::parse(&text).expect("valid TOML");
        let context = Context::new(&text);
        let mut warnings = Vec::new();
        let root = context.table(root.get_ref(), String::new(), 0..0);
        let entry = root.get("material").expect("there");
        let material = from_entry(&entry, &Known::new(), &mut warnings);
        drop((entry, root));
        let texts = |found: Vec<Finding>| found.iter().map(|f| f.message.clone()).collect();
        let errors: Vec<String> = texts(context.into_findings());
        match material {
            Some(material) if errors.is_empty() => Ok((material, texts(warnings))),
            _ => Err(errors),
        }
    }

    #[test]
    fn every_law_is_written_with_the_keys_of_the_table() {
        for law in LAWS {
            let mut text = format!("{{ law = \"{}\", density_kg_m3 = 1000", law.name);
            if law.elastic {
                text += ", youngs_modulus_pa = 1e6, poisson_ratio = 0.3";
            }
            let mut numbers = [0.0; 4];
            for (n, parameter) in law.parameters.iter().enumerate() {
                // The unit of every physical number stands in its key or in the format's document.
                numbers[n] = parameter.max.min(1e5).max(parameter.min);
                text += &format!(", {} = {:?}", parameter.key, numbers[n]);
            }
            let (found, warnings) = material(&(text + " }")).expect("valid");
            assert_eq!(Law::from_parameters(law.id, numbers), Some(found.law));
            assert_eq!(found.youngs_modulus, if law.elastic { 1e6 } else { 0.0 });
            assert_eq!(warnings, [] as [&str; 0]);
        }
    }

    #[test]
    fn missing_and_foreign_numbers_are_named() {
        let metal = "law = \"von_mises\", youngs_modulus_pa = 1e9, poisson_ratio = 0.3, density_kg_m3 = 2000";
        let errors =
            material(&format!("{{ {metal}, yield_stress_pa = 1e6 }}")).expect_err("no hardening");
        assert_eq!(errors, ["`hardening_pa` is missing"]);
        let errors = material(&format!(
            "{{ {metal}, yield_stress_pa = 1e6, hardening_pa = 0, cohesion = 5 }}"
        ));
        let errors = errors.expect_err("cohesion of metal");
        assert_eq!(
            errors,
            ["the law `von_mises` has no such number; those that have: drucker_prager"]
        );
        let errors = material("{ preset = \"water\", poisson_ratio = 0.3 }").expect_err("a fluid");
        assert!(
            errors.len() == 1 && errors[0].contains("fixed_corotated, neo_hookean"),
            "{errors:?}"
        );
        // A fluid has none of the moduli that a solid needs.
        let errors =
            material("{ preset = \"water\", law = \"neo_hookean\" }").expect_err("no modulus");
        assert_eq!(
            errors,
            [
                "`youngs_modulus_pa` is missing",
                "`poisson_ratio` is missing"
            ]
        );
        let errors = material("{ preset = \"steel\", law = \"plastcine\", softening = 1 }")
            .expect_err("typo");
        assert!(
            errors.len() == 1 && errors[0].contains("did you mean `plasticine`?"),
            "{errors:?}"
        );
    }

    #[test]
    fn a_preset_lends_the_numbers_of_its_law_and_no_others() {
        let steel = presets::find("steel").expect("listed");
        let (found, _) = material("{ preset = \"steel\", yield_stress_pa = 4e8 }").expect("valid");
        let Law::VonMises { hardening, .. } = steel.law else {
            panic!("steel yields");
        };
        let expected = Law::VonMises {
            yield_stress: 4e8,
            hardening,
        };
        assert_eq!((found.law, found.density), (expected, steel.density));
        let errors =
            material("{ preset = \"steel\", law = \"plasticine\" }").expect_err("no softening");
        assert_eq!(
            errors,
            ["`yield_stress_pa` is missing", "`softening` is missing"]
        );
        let (rigid, _) = material("{ preset = \"steel\", law = \"rigid\" }").expect("valid");
        assert_eq!(
            (rigid.law, rigid.youngs_modulus, rigid.density),
            (Law::Rigid, 0.0, steel.density)
        );
    }

    /// Sudden softening is refused.
    #[test]
    fn strength_beyond_stiffness_is_suspicious() {
        let text = "{ law = \"von_mises\", youngs_modulus_pa = 1e5, poisson_ratio = 0.3, density_kg_m3 = 2000, \
                    yield_stress_pa = 2.5e8, hardening_pa = 0 }";
        let (_, warnings) = material(text).expect("valid");
        assert!(
            warnings.len() == 1 && warnings[0].contains("meant in another unit?"),
            "{warnings:?}"
        );
        let errors =
            material("{ preset = \"plasticine\", softening = 1e9 }").expect_err("too steep");
        assert!(
            errors.len() == 1 && errors[0].starts_with("softening is 1000000000"),
            "{errors:?}"
        );
    }
}
