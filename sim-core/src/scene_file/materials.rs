//! Text to [`Material`]: a preset by name, with or without overrides, or all parameters.

use std::collections::BTreeMap;

use super::{
    error::{Finding, suggest},
    limits as l,
    reader::{Entry, Table},
};
use crate::materials::{Law, Material, presets::PRESETS};

/// Below this Young's modulus a material is softer than anything one can hold [Pa].
const SUSPICIOUS_YOUNGS_MODULUS: f64 = 100.0;

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
    let law = table.get("law").and_then(|e| {
        e.choice(&[
            ("fixed_corotated", Law::FixedCorotated),
            ("neo_hookean", Law::NeoHookean),
        ])
    });
    let number = |key, bounds| {
        let entry = match base_entry {
            Some(_) => table.get(key)?,
            None => table.required(key)?,
        };
        Some((entry.number(bounds)?, entry.at))
    };
    let youngs_modulus = number("youngs_modulus_pa", l::YOUNGS_MODULUS);
    let poisson_ratio = number("poisson_ratio", l::POISSON_RATIO);
    let density = number("density_kg_m3", l::DENSITY);
    table.finish();
    if let Some((value, at)) = &youngs_modulus
        && *value < SUSPICIOUS_YOUNGS_MODULUS
    {
        let message = format!(
            "{value} Pa is softer than any solid one can hold: is it meant in another unit, such as kPa or MPa?"
        );
        warnings.push(Finding::new(at, message));
    }
    let base = base.or_else(|| {
        Some(Material {
            name: "custom".into(),
            law: Law::FixedCorotated,
            youngs_modulus: youngs_modulus.as_ref()?.0,
            poisson_ratio: poisson_ratio.as_ref()?.0,
            density: density.as_ref()?.0,
        })
    })?;
    Some(Material {
        name: base.name,
        law: law.unwrap_or(base.law),
        youngs_modulus: youngs_modulus.map_or(base.youngs_modulus, |x| x.0),
        poisson_ratio: poisson_ratio.map_or(base.poisson_ratio, |x| x.0),
        density: density.map_or(base.density, |x| x.0),
    })
}

fn by_name(entry: &Entry, name: &str, known: &Known) -> Option<Material> {
    if let Some(material) = known.get(name) {
        return material.clone();
    }
    let preset = Material::preset(name).ok();
    if preset.is_none() {
        let names = known.keys().map(String::as_str);
        let hint = suggest(name, names.chain(PRESETS.iter().map(|p| p.name)));
        entry.error(format!("material `{name}` is not known: {hint}"));
    }
    preset
}
