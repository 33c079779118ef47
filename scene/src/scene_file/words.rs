//! Words for things and the materials that they are mostly made of: a table that a person may edit.

use std::{collections::BTreeMap, fmt::Write};

use cosplat_sim_core::materials::Material;
use toml::de::DeTable;

use super::{
    error::SceneErrors,
    materials::{self, Known},
    reader::{Context, Table},
};
use crate::materials::presets::{PRESETS, SOURCES};

/// The table that comes with cosplat, as text to copy and edit.
pub const WORDS: &str = include_str!("words.toml");

/// From this Young's modulus on an object keeps its shape for the eye: at its own weight a metre of it gives way by less than a
/// thousandth [Pa].
const STIFF: f64 = 1e8;

/// Words with their materials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WordTable {
    /// Material by word; words are in lower case.
    pub words: BTreeMap<String, Material>,
    /// Where the numbers of the table's own materials are from, by name of the material.
    sources: BTreeMap<String, String>,
}

impl WordTable {
    /// The table that comes with cosplat.
    pub fn builtin() -> Self {
        Self::parse(WORDS).unwrap_or_default()
    }

    /// Reads `[words]`, `[materials]` (as in a scene file) and `[sources]`.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with line and field.
    pub fn parse(text: &str) -> Result<Self, SceneErrors> {
        let context = Context::new(text);
        let (root, syntax) = DeTable::parse_recoverable(text);
        for error in &syntax {
            let span = error.span().unwrap_or_default();
            context.error(&context.at(&span, ""), error.message());
        }
        let mut found = Self::default();
        if syntax.is_empty() {
            let table = context.table(root.get_ref(), String::new(), 0..0);
            // What is odd about numbers is said when a scene with them is loaded.
            let known = materials::read(&table, &mut Vec::new());
            found.read_words(&table, &known);
            found.read_sources(&table, &known);
            table.finish();
        }
        SceneErrors::check(context.into_findings())?;
        Ok(found)
    }

    fn read_words(&mut self, root: &Table, known: &Known) {
        let table = root.required("words").and_then(|e| e.table());
        for (word, entry) in table.iter().flat_map(|t| t.named()) {
            if entry.text().is_none() {
                continue;
            }
            if let Some(material) = materials::from_entry(&entry, known, &mut Vec::new()) {
                self.words.insert(normal(word), material);
            }
        }
    }

    fn read_sources(&mut self, root: &Table, known: &Known) {
        let table = root.get("sources").and_then(|e| e.table());
        for (name, entry) in table.iter().flat_map(|t| t.named()) {
            match entry.text() {
                Some(text) if known.contains_key(name) => {
                    self.sources.insert(name.to_owned(), text.to_owned());
                }
                Some(_) => entry.error(format!("[materials] has no `{name}`")),
                None => {}
            }
        }
    }

    /// The word of the table that a name means, with its material: the name itself, else its last word that the table has. Of
    /// `rubber_duck_2` that is `duck`.
    pub fn of(&self, name: &str) -> Option<(&str, &Material)> {
        let name = normal(name);
        let words = std::iter::once(name.as_str()).chain(name.rsplit(' '));
        let mut found = words.filter_map(|word| {
            let singular = word.strip_suffix('s').unwrap_or(word);
            let entry = self.words.get_key_value(word);
            entry.or_else(|| self.words.get_key_value(singular))
        });
        found
            .next()
            .map(|(word, material)| (word.as_str(), material))
    }

    /// Where the numbers of a material are from, in words.
    pub fn source(&self, material: &Material) -> String {
        if let Some(source) = self.sources.get(&material.name) {
            return source.clone();
        }
        let preset = PRESETS.iter().find(|preset| preset.name == material.name);
        let Some(preset) = preset else {
            return "not said".to_owned();
        };
        // Letters of works first, then what of it.
        let (letters, rest) = preset
            .source
            .split_once([':', ';'])
            .unwrap_or((preset.source, ""));
        let work = |letter: &str| {
            let mut letters = letter.trim().chars();
            let first = letters.next().filter(|_| letters.next().is_none())?;
            SOURCES.iter().find(|s| s.0 == first).map(|s| s.1)
        };
        let parts = letters.split(',').map(|l| work(l).unwrap_or(l.trim()));
        let parts = parts.chain(Some(rest.trim()).filter(|rest| !rest.is_empty()));
        parts.collect::<Vec<_>>().join("; ")
    }
}

/// A name as the table has it: lower case, words parted by single spaces, without numbers.
fn normal(name: &str) -> String {
    let lower = name.to_lowercase();
    let words = lower.split(|c: char| !c.is_alphabetic());
    words
        .filter(|w| !w.is_empty())
        .collect::<Vec<_>>()
        .join(" ")
}

/// Whether an object of a material keeps its shape for the eye, so that it may be simulated as one body.
pub fn keeps_shape(material: &Material) -> bool {
    material.law.is_rigid() || material.youngs_modulus >= STIFF
}

/// A material as lines of a scene file's table, all its numbers stated.
pub fn material_text(material: &Material) -> String {
    let law = material.law.entry();
    let mut text = format!("law = \"{}\"\n", law.name);
    if law.elastic {
        let (modulus, ratio) = (material.youngs_modulus, material.poisson_ratio);
        let _ = writeln!(
            text,
            "youngs_modulus_pa = {modulus:?}\npoisson_ratio = {ratio:?}"
        );
    }
    let _ = writeln!(text, "density_kg_m3 = {:?}", material.density);
    if material.loss > 0.0 {
        let _ = writeln!(text, "loss = {:?}", material.loss);
    }
    for (parameter, value) in law.parameters.iter().zip(material.law.parameters()) {
        let _ = writeln!(text, "{} = {value:?}", parameter.key);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::SceneFile;

    #[test]
    fn the_table_that_comes_along_can_be_read() {
        let table = WordTable::parse(WORDS).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(table.words["vase"].name, "ceramic");
        for material in table.words.values() {
            let source = table.source(material);
            assert!(
                !source.is_empty() && source != "not said",
                "{}",
                material.name
            );
        }
    }

    #[test]
    fn a_name_means_its_last_known_word() {
        let table = WordTable::builtin();
        let of = |name: &str| table.of(name).map(|(word, m)| (word, m.name.as_str()));
        assert_eq!(of("vase"), Some(("vase", "ceramic")));
        assert_eq!(of("Rubber-Duck_2"), Some(("duck", "soft_rubber")));
        assert_eq!(of("plant pots"), Some(("pot", "brick")));
        assert_eq!(of("object_1"), None);
        assert_eq!(of(""), None);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let refused = |text: &str, words: &str| {
            let error = WordTable::parse(text).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        };
        refused("[words]\nvase = \"cerramic\"", "did you mean `ceramic`?");
        refused("[words]\nvase = 3", "line 2");
        refused("[materials]", "`words` is missing");
        refused(
            "[words]\n[sources]\ngold = \"x\"",
            "[materials] has no `gold`",
        );
        refused("[words]\n[word]\n", "unknown key");
        refused("[words", "line 1");
        let own = "[words]\nvase = \"porcelain\"\n[materials.porcelain]\npreset = \"ceramic\"\ndensity_kg_m3 = 2300";
        let table = WordTable::parse(own).unwrap_or_else(|e| panic!("{e}"));
        let (_, found) = table.of("vase").expect("there");
        assert_eq!((found.name.as_str(), found.density), ("porcelain", 2300.0));
        assert_eq!(table.source(found), "not said");
    }

    #[test]
    fn materials_come_back_as_they_were_written() {
        let table = WordTable::builtin();
        for material in table.words.values() {
            let name = &material.name;
            let text = format!(
                "version = 1\n[materials.\"{name}\"]\n{}[[objects]]\nname = \"a\"\nshape = {{ kind = \"sphere\", radius = 1 }}\nmaterial = \"{name}\"\n",
                material_text(material)
            );
            let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
            assert_eq!(&file.objects[0].material, material);
            let is_stiff = ["ceramic", "steel", "wood", "glass"].contains(&name.as_str());
            let is_soft = ["soft_rubber", "foam", "foliage", "water"].contains(&name.as_str());
            assert!(!(is_stiff && !keeps_shape(material) || is_soft && keeps_shape(material)));
        }
    }
}
