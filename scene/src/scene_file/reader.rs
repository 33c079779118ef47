//! Reads TOML tables key by key and collects every error instead of stopping at the first.

use std::{cell::RefCell, ops::Range};

use cosplat_sim_core::expression::{Expression, VectorField};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{
    error::{At, Finding, suggest},
    places::Places,
};

/// Valid closed range of a number and its unit, for the message.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub min: f64,
    pub max: f64,
    pub unit: &'static str,
}

/// The text being read and what was found wrong with it so far.
pub(super) struct Context<'t> {
    places: Places<'t>,
    findings: RefCell<Vec<Finding>>,
}

impl<'t> Context<'t> {
    pub fn new(text: &'t str) -> Self {
        Self {
            places: Places::new(text),
            findings: RefCell::default(),
        }
    }

    pub fn at(&self, span: &Range<usize>, field: &str) -> At {
        let [line, column] = self.places.of(span.start);
        At {
            line,
            column,
            field: field.into(),
        }
    }

    pub fn error(&self, at: &At, message: impl Into<String>) {
        self.findings.borrow_mut().push(Finding::new(at, message));
    }

    pub fn into_findings(self) -> Vec<Finding> {
        self.findings.into_inner()
    }
}

/// A value and where it stands.
pub(super) struct Entry<'c, 't> {
    context: &'c Context<'t>,
    value: &'c DeValue<'t>,
    pub at: At,
    span: Range<usize>,
}

impl<'c, 't> Entry<'c, 't> {
    fn wrong_type(&self, expected: &str) {
        let found = match self.value {
            DeValue::String(_) => "a string",
            DeValue::Integer(_) => "an integer",
            DeValue::Float(_) => "a number",
            DeValue::Boolean(_) => "true or false",
            DeValue::Datetime(_) => "a date",
            DeValue::Array(_) => "an array",
            DeValue::Table(_) => "a table",
        };
        self.error(format!("expected {expected}, found {found}"));
    }

    pub fn error(&self, message: impl Into<String>) {
        self.context.error(&self.at, message);
    }

    pub fn number(&self, bounds: Bounds) -> Option<f64> {
        let value = match self.value {
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix())
                .ok()
                .map(|i| i as f64),
            DeValue::Float(x) => x.as_str().parse().ok(),
            _ => {
                self.wrong_type("a number");
                return None;
            }
        };
        let Bounds { min, max, unit } = bounds;
        match value {
            Some(x) if (min..=max).contains(&x) => Some(x),
            Some(x) => {
                let space = if unit.is_empty() { "" } else { " " };
                self.error(format!(
                    "is {x:?}{space}{unit}, expected {min:?} to {max:?}{space}{unit}"
                ));
                None
            }
            None => {
                self.error("is not a number that fits 64 bits");
                None
            }
        }
    }

    pub fn integer(&self, min: u64, max: u64) -> Option<u64> {
        let DeValue::Integer(i) = self.value else {
            self.wrong_type("a whole number");
            return None;
        };
        match u64::from_str_radix(i.as_str(), i.radix()) {
            Ok(value) if (min..=max).contains(&value) => Some(value),
            _ => {
                self.error(format!("is {i}, expected a whole number, {min} to {max}"));
                None
            }
        }
    }

    pub fn text(&self) -> Option<&'c str> {
        let text = self.value.as_str();
        match text {
            None => self.wrong_type("a string"),
            Some("") => self.error("is empty, expected a name"),
            Some(_) => return text,
        }
        None
    }

    pub fn boolean(&self) -> Option<bool> {
        let value = self.value.as_bool();
        if value.is_none() {
            self.wrong_type("true or false");
        }
        value
    }

    pub fn choice<T: Copy>(&self, choices: &[(&'static str, T)]) -> Option<T> {
        let text = self.text()?;
        let found = choices.iter().find(|(name, _)| *name == text);
        if found.is_none() {
            let hint = suggest(text, choices.iter().map(|c| c.0));
            self.error(format!("`{text}` is not known: {hint}"));
        }
        found.map(|(_, value)| *value)
    }

    /// The elements of an array.
    pub fn array(&self) -> Option<Vec<Self>> {
        let Some(array) = self.value.as_array() else {
            self.wrong_type("an array");
            return None;
        };
        let entries = array.iter().enumerate();
        Some(
            entries
                .map(|(i, value)| {
                    self.context
                        .entry(value, format!("{}[{i}]", self.at.field), value.span())
                })
                .collect(),
        )
    }

    pub fn numbers<const N: usize>(&self, bounds: Bounds) -> Option<[f64; N]> {
        let entries = self.array()?;
        if entries.len() != N {
            self.error(format!("has {} elements, expected {N}", entries.len()));
            return None;
        }
        let values: Vec<_> = entries.iter().map(|e| e.number(bounds)).collect();
        let values: Vec<f64> = values.into_iter().collect::<Option<_>>()?;
        values.try_into().ok()
    }

    /// Three formulas in the position at rest and time.
    pub fn formulas(&self) -> Option<VectorField> {
        let entries = self.array()?;
        if entries.len() != 3 {
            self.error(format!(
                "has {} elements, expected 3 formulas",
                entries.len()
            ));
            return None;
        }
        let formula = |entry: &Self| {
            let text = match entry.value {
                DeValue::Integer(number) => number.as_str(),
                DeValue::Float(number) => number.as_str(),
                _ => entry.text()?,
            };
            let parsed = Expression::parse(text);
            parsed.map_err(|found| entry.error(found)).ok()
        };
        let [x, y, z] = [0, 1, 2].map(|n| formula(&entries[n]));
        Some(VectorField::new([x?, y?, z?]))
    }

    pub fn is_text(&self) -> bool {
        self.value.is_str()
    }

    pub fn table(&self) -> Option<Table<'c, 't>> {
        let Some(table) = self.value.as_table() else {
            self.wrong_type("a table");
            return None;
        };
        let path = self.at.field.clone();
        Some(self.context.table(table, path, self.span.clone()))
    }

    /// The table behind the entry, for inheritance.
    pub fn raw_table(&self) -> Option<&'c DeTable<'t>> {
        self.value.as_table()
    }
}

impl<'t> Context<'t> {
    fn entry<'c>(
        &'c self,
        value: &'c Spanned<DeValue<'t>>,
        field: String,
        span: Range<usize>,
    ) -> Entry<'c, 't> {
        Entry {
            context: self,
            value: value.get_ref(),
            at: self.at(&span, &field),
            span,
        }
    }

    /// A table to read; `path` is what its keys are reported under.
    pub fn table<'c>(
        &'c self,
        own: &'c DeTable<'t>,
        path: String,
        span: Range<usize>,
    ) -> Table<'c, 't> {
        Table {
            context: self,
            layers: vec![own],
            at: self.at(&span, &path),
            known: RefCell::default(),
        }
    }
}

/// A table being read; [`finish`](Self::finish) reports the keys nobody asked for.
pub(super) struct Table<'c, 't> {
    context: &'c Context<'t>,
    layers: Vec<&'c DeTable<'t>>,
    pub at: At,
    known: RefCell<Vec<&'static str>>,
}

impl<'c, 't> Table<'c, 't> {
    /// Missing keys are looked up in these, nearest first.
    pub fn inherit(&mut self, layers: Vec<&'c DeTable<'t>>) {
        self.layers.extend(layers);
    }

    fn path_of(&self, key: &str) -> String {
        if self.at.field.is_empty() {
            key.into()
        } else {
            format!("{}.{key}", self.at.field)
        }
    }

    pub fn error(&self, message: impl Into<String>) {
        self.context.error(&self.at, message);
    }

    fn find(&self, layer: &'c DeTable<'t>, key: &str) -> Option<Entry<'c, 't>> {
        let (name, value) = layer.get_key_value(key)?;
        // Arrays of tables have no brackets of their own: their key says where they start.
        let span = if value.span().is_empty() {
            name.span()
        } else {
            value.span()
        };
        Some(self.context.entry(value, self.path_of(key), span))
    }

    pub fn get(&self, key: &'static str) -> Option<Entry<'c, 't>> {
        self.known.borrow_mut().push(key);
        self.layers.iter().find_map(|layer| self.find(layer, key))
    }

    /// A key that a clone does not inherit.
    pub fn get_own(&self, key: &'static str) -> Option<Entry<'c, 't>> {
        self.known.borrow_mut().push(key);
        self.find(self.layers[0], key)
    }

    /// Like [`get`](Self::get); a missing key is an error.
    pub fn required(&self, key: &'static str) -> Option<Entry<'c, 't>> {
        let entry = self.get(key);
        if entry.is_none() {
            self.error(format!("`{key}` is missing"));
        }
        entry
    }

    /// At most one of several keys, those of the table itself before inherited ones.
    pub fn one_of(&self, keys: &[&'static str]) -> Option<(&'static str, Entry<'c, 't>)> {
        self.known.borrow_mut().extend(keys);
        for layer in &self.layers {
            let mut found = keys
                .iter()
                .filter_map(|key| Some((*key, self.find(layer, key)?)));
            let first = found.next();
            if let (Some((first, _)), Some((second, entry))) = (&first, found.next()) {
                entry.error(format!(
                    "excludes `{first}`, which is given too: drop `{second}` or `{first}`"
                ));
            }
            if first.is_some() {
                return first;
            }
        }
        None
    }

    /// The tables of an array of tables.
    pub fn tables(&self, key: &'static str) -> Vec<Entry<'c, 't>> {
        let entries = self.get(key).and_then(|e| e.array());
        entries.unwrap_or_default()
    }

    /// Every key of the table itself with its value, for tables whose keys are names.
    pub fn named(&self) -> Vec<(&'c str, Entry<'c, 't>)> {
        let layer = self.layers[0];
        let keys = layer.iter();
        keys.map(|(key, value)| {
            let name: &'c str = key.get_ref().as_ref();
            let entry = self.context.entry(value, self.path_of(name), key.span());
            (name, entry)
        })
        .collect()
    }

    /// Reports unknown keys.
    pub fn finish(self) {
        let known = self.known.borrow();
        for (key, _) in self.layers[0].iter() {
            let name: &str = key.get_ref();
            if !known.contains(&name) {
                let at = self.context.at(&key.span(), &self.path_of(name));
                let hint = suggest(name, known.iter().copied());
                self.context.error(&at, format!("unknown key: {hint}"));
            }
        }
    }
}
