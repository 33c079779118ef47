//! Objects that are the same as others: which tables they inherit from.

use std::collections::HashMap;

use toml::de::DeTable;

use super::{error::suggest, reader::Table};

/// The tables of all objects, and what each of them inherits.
pub(super) struct Clones<'c, 't> {
    tables: Vec<&'c DeTable<'t>>,
    /// First table of each name.
    by_name: HashMap<&'c str, usize>,
    /// Per table its sources, once looked up.
    sources: Vec<Found<'c, 't>>,
    /// Tables asked for so far.
    asked: usize,
}

/// What became of looking for the sources of a table.
#[derive(Clone)]
enum Found<'c, 't> {
    /// Nothing yet.
    No,
    /// Somebody looks for them just now.
    Looking,
    /// Nearest first, without those of which nearer ones replace every key.
    Layers(Vec<&'c DeTable<'t>>),
    /// A name on the way is no object's.
    Missing(&'c str),
    /// The way leads back to a table with this name.
    Circle(&'c str),
}

fn text<'c>(table: &'c DeTable<'_>, key: &str) -> Option<&'c str> {
    table.get(key).and_then(|value| value.get_ref().as_str())
}

/// Whether a key is never inherited.
fn is_own(key: &str) -> bool {
    key == "name" || key == "clone"
}

impl<'c, 't> Clones<'c, 't> {
    /// Of the tables of all objects, in the order in which [`inherit`](Self::inherit) is asked.
    pub fn new(tables: Vec<&'c DeTable<'t>>) -> Self {
        let mut by_name = HashMap::new();
        for (i, table) in tables.iter().enumerate() {
            if let Some(name) = text(table, "name") {
                by_name.entry(name).or_insert(i);
            }
        }
        Self {
            sources: vec![Found::No; tables.len()],
            tables,
            by_name,
            asked: 0,
        }
    }

    /// Lets the next table inherit from what it is a clone of.
    pub fn inherit(&mut self, table: &mut Table<'c, 't>) {
        let number = self.asked;
        self.asked += 1;
        let Some(entry) = table.get_own("clone") else {
            return;
        };
        if entry.text().is_none() {
            return;
        }
        self.look(number);
        match &self.sources[number] {
            Found::Layers(layers) => table.inherit(layers.clone()),
            Found::Missing(name) => {
                let names = self.tables.iter().filter_map(|t| text(t, "name"));
                let hint = suggest(name, names);
                entry.error(format!("object `{name}` does not exist: {hint}"));
            }
            Found::Circle(name) => {
                entry.error(format!("`{name}` is in the end a clone of itself"));
            }
            Found::No | Found::Looking => {}
        }
    }

    /// Finds the sources of a table, and of all those on the way there.
    fn look(&mut self, number: usize) {
        let mut way = Vec::new();
        let mut at = number;
        let mut end = loop {
            match &self.sources[at] {
                Found::No => {}
                Found::Looking => break Found::Circle(text(self.tables[at], "name").unwrap_or("")),
                found => break found.clone(),
            }
            let Some(name) = text(self.tables[at], "clone") else {
                self.sources[at] = Found::Layers(Vec::new());
                continue;
            };
            self.sources[at] = Found::Looking;
            way.push(at);
            match self.by_name.get(name) {
                Some(&source) => at = source,
                None => break Found::Missing(name),
            }
        };
        for &clone in way.iter().rev() {
            if let Found::Layers(layers) = &mut end {
                *layers = self.behind(at, layers);
            }
            self.sources[clone] = end.clone();
            at = clone;
        }
    }

    /// A table and those it inherits from, as far as a clone of it can see them.
    fn behind(&self, source: usize, layers: &[&'c DeTable<'t>]) -> Vec<&'c DeTable<'t>> {
        let mut seen = vec![self.tables[source]];
        for layer in layers {
            let hidden = |key: &str| seen.iter().any(|nearer| nearer.contains_key(key));
            let mut keys = layer.keys().map(|key| key.get_ref());
            if keys.any(|key| !is_own(key) && !hidden(key)) {
                seen.push(layer);
            }
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn objects(text: &str) -> DeTable<'_> {
        DeTable::parse(text).expect("valid").into_inner()
    }

    /// Layers that each of some objects inherits from.
    fn depths(text: &str) -> Vec<usize> {
        let root = objects(text);
        let array = root["objects"].get_ref().as_array().expect("an array");
        let tables = array.iter().filter_map(|value| value.get_ref().as_table());
        let mut clones = Clones::new(tables.collect());
        (0..clones.tables.len())
            .map(|number| {
                clones.look(number);
                match &clones.sources[number] {
                    Found::Layers(layers) => layers.len(),
                    _ => usize::MAX,
                }
            })
            .collect()
    }

    #[test]
    fn a_long_line_of_clones_is_looked_up_in_few_tables() {
        let mut text = "[[objects]]\nname = \"0\"\nfriction = 1\nseed = 1\n".to_owned();
        for i in 1..1000 {
            let key = ["translation", "friction"][i % 2];
            text += &format!(
                "[[objects]]\nname = \"{i}\"\nclone = \"{}\"\n{key} = {i}\n",
                i - 1
            );
        }
        // The nearest with a translation, the nearest with a friction, and the first.
        assert_eq!(depths(&text).into_iter().max(), Some(3));
    }

    #[test]
    fn ways_that_lead_nowhere_or_back_end() {
        let text = "[[objects]]\nname = \"a\"\nclone = \"b\"\n[[objects]]\nname = \"b\"\nclone = \"c\"\n\
            [[objects]]\nname = \"c\"\nclone = \"b\"\n[[objects]]\nname = \"d\"\nclone = \"e\"\n";
        assert_eq!(depths(text), [usize::MAX; 4]);
    }
}
