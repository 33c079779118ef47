//! `--set KEY=VALUE`: a scene file with single values replaced, so that a sweep needs one file.

use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, TableLike, Value};

/// Why a setting cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SettingError {
    /// No equals sign, or an empty key.
    #[error("--set {0}: expected KEY=VALUE, like dx=0.01 or objects.0.friction=0.2")]
    Form(String),
    /// An entry that the file does not have.
    #[error(
        "--set {setting}: '{list}' has {count} entries, counted from 0, and none is '{index}'; '{count}' adds one"
    )]
    Entry {
        /// As given.
        setting: String,
        /// The list.
        list: String,
        /// Its length.
        count: usize,
        /// What was asked for.
        index: String,
    },
    /// A key below a plain value.
    #[error("--set {setting}: '{key}' is a plain value and has no keys")]
    Plain {
        /// As given.
        setting: String,
        /// The value's key.
        key: String,
    },
}

/// The text with each `KEY=VALUE` applied in order.
///
/// A key is dotted, entries of lists are counted from 0: `objects.0.material.poisson_ratio`. A value is TOML; what is
/// not is taken as a text, so `contact=multi_field` needs no quotes. Keys that the file lacks are added, and a list
/// grows by the entry whose number is its length. A text that is not TOML is returned as it is: reading it reports why.
///
/// # Errors
/// When a setting has another form or names a place that the file does not have.
pub fn apply(text: &str, settings: &[String]) -> Result<String, SettingError> {
    let Ok(mut document) = text.parse::<DocumentMut>() else {
        return Ok(text.to_owned());
    };
    for setting in settings {
        let parts = setting.split_once('=').map(|(k, v)| (k.trim(), v.trim()));
        let (key, value) = parts
            .filter(|(k, _)| k.split('.').all(|part| !part.is_empty()))
            .ok_or_else(|| SettingError::Form(setting.clone()))?;
        let value: Value = value.parse().unwrap_or_else(|_| value.into());
        let path: Vec<&str> = key.split('.').collect();
        let place = Place { setting, path };
        place.put(document.as_table_mut(), 0, value)?;
    }
    Ok(document.to_string())
}

/// Where a setting goes.
struct Place<'a> {
    setting: &'a str,
    path: Vec<&'a str>,
}

impl Place<'_> {
    /// Puts the value below `table`, whose keys are those at `depth` of the path.
    fn put(
        &self,
        table: &mut dyn TableLike,
        depth: usize,
        value: Value,
    ) -> Result<(), SettingError> {
        let key = self.path[depth];
        if depth + 1 == self.path.len() {
            table.insert(key, Item::Value(value));
            return Ok(());
        }
        let index = self.index(depth);
        let item = table.entry(key).or_insert_with(|| match index {
            Some(_) => Item::Value(Array::new().into()),
            None => Item::Value(InlineTable::new().into()),
        });
        let is_last = depth + 2 == self.path.len();
        if let Some(tables) = item.as_array_of_tables_mut() {
            if index == Some(tables.len()) {
                tables.push(Table::new());
            }
            let count = tables.len();
            let table = index.and_then(|i| tables.get_mut(i));
            let table = table.ok_or_else(|| self.no_entry(depth, count))?;
            if !is_last {
                return self.put(table, depth + 2, value);
            }
            let Value::InlineTable(whole) = value else {
                return Err(SettingError::Form(self.setting.to_owned()));
            };
            *table = whole.into_table();
            return Ok(());
        }
        if let Some(values) = item.as_array_mut() {
            if index == Some(values.len()) {
                values.push(InlineTable::new());
            }
            let count = values.len();
            let entry = index.and_then(|i| values.get_mut(i));
            let entry = entry.ok_or_else(|| self.no_entry(depth, count))?;
            if is_last {
                *entry = value;
                return Ok(());
            }
            let table = entry.as_inline_table_mut();
            let table = table.ok_or_else(|| self.plain(depth + 2))?;
            return self.put(table, depth + 2, value);
        }
        self.write_out(depth, item);
        let table = item.as_table_like_mut();
        let table = table.ok_or_else(|| self.plain(depth + 1))?;
        self.put(table, depth + 1, value)
    }

    /// Makes the table of a text that stands for one with a single key: a name of a material for its preset.
    fn write_out(&self, depth: usize, item: &mut Item) {
        let key = match self.path[depth] {
            "material" => "preset",
            "split" => "by",
            _ if depth == 1 && self.path[0] == "materials" => "preset",
            _ => return,
        };
        let Some(Value::String(text)) = item.as_value() else {
            return;
        };
        let mut table = InlineTable::new();
        table.insert(key, text.value().as_str().into());
        *table.decor_mut() = text.decor().clone();
        *item = Item::Value(table.into());
    }

    fn index(&self, depth: usize) -> Option<usize> {
        self.path.get(depth + 1)?.parse().ok()
    }

    fn no_entry(&self, depth: usize, count: usize) -> SettingError {
        SettingError::Entry {
            setting: self.setting.to_owned(),
            list: self.path[..=depth].join("."),
            count,
            index: self.path[depth + 1].to_owned(),
        }
    }

    /// The error for keys below a plain value, which the first `depth` parts of the path name.
    fn plain(&self, depth: usize) -> SettingError {
        SettingError::Plain {
            setting: self.setting.to_owned(),
            key: self.path[..depth].join("."),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    const TEXT: &str = "\
version = 1
dx = 0.1 # coarse

[[objects]]
name = \"a\"
translation = [0, 1, 0]
material = { preset = \"rubber\", poisson_ratio = 0.3 }

[materials.soft]
preset = \"jelly\"
";

    fn set(settings: &[&str]) -> Result<String, SettingError> {
        let settings: Vec<String> = settings.iter().map(ToString::to_string).collect();
        apply(TEXT, &settings)
    }

    fn value(settings: &[&str], path: &[&str]) -> toml::Value {
        let text = set(settings).unwrap_or_else(|e| panic!("{e}"));
        let mut at: toml::Value = text.parse::<toml::Table>().expect("TOML").into();
        for part in path {
            at = match part.parse::<usize>() {
                Ok(i) => at[i].clone(),
                Err(_) => at[*part].clone(),
            };
        }
        at
    }

    #[test]
    fn a_value_is_replaced_where_it_stands() {
        assert_eq!(value(&["dx=0.05"], &["dx"]), 0.05.into());
        assert_eq!(
            value(
                &["objects.0.translation.1=2"],
                &["objects", "0", "translation", "1"]
            ),
            2.into()
        );
        let path = ["objects", "0", "material", "poisson_ratio"];
        assert_eq!(
            value(&["objects.0.material.poisson_ratio=0.45"], &path),
            0.45.into()
        );
        // Lines do not move, so that messages still name those of the file.
        let text = set(&["dx=0.05"]).expect("a setting");
        assert_eq!(text.lines().count(), TEXT.lines().count());
    }

    #[test]
    fn a_text_that_stands_for_a_table_takes_more_keys() {
        let text = "[[objects]]\nmaterial = \"jelly\" # soft\nsplit = \"components\"\n\
                    [[objects.regions]]\nmaterial = \"rubber\"\n[materials]\nsoft = \"jelly\"\n";
        for (setting, line) in [
            (
                "objects.0.material.poisson_ratio=0.45",
                "material = { preset = \"jelly\", poisson_ratio = 0.45 } # soft",
            ),
            (
                "objects.0.regions.0.material.density_kg_m3=900",
                "material = { preset = \"rubber\", density_kg_m3 = 900 }",
            ),
            (
                "objects.0.split.min_gaussians=5",
                "split = { by = \"components\", min_gaussians = 5 }",
            ),
            (
                "materials.soft.density_kg_m3=900",
                "soft = { preset = \"jelly\", density_kg_m3 = 900 }",
            ),
        ] {
            let set = apply(text, &[setting.into()]).unwrap_or_else(|e| panic!("{e}"));
            assert!(set.lines().any(|found| found == line), "{set}");
            assert_eq!(set.lines().count(), text.lines().count());
        }
        let error = apply(text, &["objects.0.material.poisson_ratio.x=1".into()]);
        assert!(error.is_ok(), "its reader refuses it: {error:?}");
    }

    #[test]
    fn a_missing_key_is_added_and_bare_words_are_text() {
        assert_eq!(
            value(&["contact=multi_field"], &["contact"]),
            "multi_field".into()
        );
        assert_eq!(
            value(
                &["materials.soft.density_kg_m3=900"],
                &["materials", "soft", "density_kg_m3"]
            ),
            900.into()
        );
        assert_eq!(
            value(&["domain.policy=stop"], &["domain", "policy"]),
            "stop".into()
        );
        assert_eq!(
            value(&["dx=1", "dx=2"], &["dx"]),
            2.into(),
            "the last one counts"
        );
    }

    #[test]
    fn the_entry_behind_the_last_is_added() {
        let whole = "objects.1={name=\"b\", translation=[0, 2, 0]}";
        let by_key = ["objects.1.name=b", "objects.1.translation=[0, 2, 0]"];
        for settings in [&[whole][..], &by_key] {
            assert_eq!(value(settings, &["objects", "1", "name"]), "b".into());
            let place = ["objects", "1", "translation", "1"];
            assert_eq!(value(settings, &place), 2.into());
            assert_eq!(value(settings, &["objects", "0", "name"]), "a".into());
        }
        // Of a list that the file lacks, and of one that is written in place.
        let wall = "colliders.0={name=\"wall\", normal=[0, 1, 0]}";
        assert_eq!(value(&[wall], &["colliders", "0", "normal", "1"]), 1.into());
        let both = [wall, "colliders.1.name=floor"];
        assert_eq!(value(&both, &["colliders", "1", "name"]), "floor".into());
        assert_eq!(
            value(
                &["objects.0.translation.3=7"],
                &["objects", "0", "translation", "3"]
            ),
            7.into()
        );
        let replaced = value(&["objects.0={name=\"c\"}"], &["objects"]);
        assert_eq!(
            replaced,
            toml::Value::try_from([BTreeMap::from([("name", "c")])]).expect("TOML")
        );
    }

    #[test]
    fn what_cannot_be_set_is_said() {
        for (setting, words) in [
            ("dx", "expected KEY=VALUE"),
            ("=3", "expected KEY=VALUE"),
            (
                "objects.2.name=b",
                "'objects' has 1 entries, counted from 0, and none is '2'; '1' adds one",
            ),
            ("objects.0=b", "expected KEY=VALUE"),
            ("dx.fine=1", "'dx' is a plain value"),
            (
                "objects.0.translation.7=1",
                "'objects.0.translation' has 3 entries",
            ),
        ] {
            let error = set(&[setting]).expect_err(setting).to_string();
            assert!(error.contains(words), "{words:?} not in {error}");
        }
    }

    #[test]
    fn a_text_that_is_no_toml_is_left_to_the_reader() {
        assert_eq!(apply("dx = = 1", &["dx=2".into()]), Ok("dx = = 1".into()));
    }
}
