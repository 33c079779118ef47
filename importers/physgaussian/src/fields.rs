//! One JSON object of a configuration, which remembers the keys it was asked for.

use serde_json::{Map, Value};

use crate::notes::{NoteKind, Notes};

/// Least likeness of a key to a known one that makes it a suggestion: accepts a missing suffix and one or two typing
/// errors, and little else.
const LIKENESS: f64 = 0.8;

/// A JSON object under reading.
pub(super) struct Fields<'j> {
    /// Path of the object with the dot behind it; empty at the top.
    prefix: String,
    map: &'j Map<String, Value>,
    asked: Vec<&'static str>,
}

impl<'j> Fields<'j> {
    /// The object at `path`, which is empty at the top; an error when it is no object.
    pub fn new(path: &str, value: &'j Value, notes: &mut Notes) -> Option<Self> {
        let Some(map) = value.as_object() else {
            let name = if path.is_empty() {
                "the configuration"
            } else {
                path
            };
            notes.error(name, format!("is {}, expected an object", kind(value)));
            return None;
        };
        let prefix = if path.is_empty() {
            String::new()
        } else {
            format!("{path}.")
        };
        Some(Self {
            prefix,
            map,
            asked: Vec::new(),
        })
    }

    /// Full path of a key.
    pub fn path(&self, key: &str) -> String {
        format!("{}{key}", self.prefix)
    }

    /// The value of a key; none when it is absent or null.
    pub fn get(&mut self, key: &'static str) -> Option<&'j Value> {
        self.asked.push(key);
        self.map.get(key).filter(|v| !v.is_null())
    }

    /// Whether a key is there, without reading it.
    pub fn has(&self, key: &str) -> bool {
        self.map.contains_key(key)
    }

    /// A finite number.
    pub fn number(&mut self, key: &'static str, notes: &mut Notes) -> Option<f64> {
        let value = self.get(key)?;
        let number = value.as_f64().filter(|n| n.is_finite());
        if number.is_none() {
            notes.error(
                &self.path(key),
                format!("is {}, expected a number", kind(value)),
            );
        }
        number
    }

    /// A number within a range.
    pub fn bounded(
        &mut self,
        key: &'static str,
        (min, max): (f64, f64),
        notes: &mut Notes,
    ) -> Option<f64> {
        let number = self.number(key, notes)?;
        if (min..=max).contains(&number) {
            return Some(number);
        }
        notes.error(
            &self.path(key),
            format!("is {number}, expected {min} to {max}"),
        );
        None
    }

    /// A whole number within a range; Python's `4.0` counts.
    pub fn count(
        &mut self,
        key: &'static str,
        (min, max): (u64, u64),
        notes: &mut Notes,
    ) -> Option<u64> {
        let number = self.bounded(key, (min as f64, max as f64), notes)?;
        if number.fract() != 0.0 {
            notes.error(
                &self.path(key),
                format!("is {number}, expected a whole number"),
            );
            return None;
        }
        Some(number as u64)
    }

    /// True or false; Python's 1 and 0 count.
    pub fn flag(&mut self, key: &'static str, notes: &mut Notes) -> Option<bool> {
        let value = self.get(key)?;
        let flag = value.as_bool().or(value.as_f64().map(|n| n != 0.0));
        if flag.is_none() {
            notes.error(
                &self.path(key),
                format!("is {}, expected true or false", kind(value)),
            );
        }
        flag
    }

    /// A text.
    pub fn text(&mut self, key: &'static str, notes: &mut Notes) -> Option<&'j str> {
        let value = self.get(key)?;
        let text = value.as_str();
        if text.is_none() {
            notes.error(
                &self.path(key),
                format!("is {}, expected a text", kind(value)),
            );
        }
        text
    }

    /// A list.
    pub fn list(&mut self, key: &'static str, notes: &mut Notes) -> Option<&'j [Value]> {
        let value = self.get(key)?;
        let list = value.as_array();
        if list.is_none() {
            notes.error(
                &self.path(key),
                format!("is {}, expected a list", kind(value)),
            );
        }
        list.map(Vec::as_slice)
    }

    /// A list of finite numbers.
    pub fn numbers(&mut self, key: &'static str, notes: &mut Notes) -> Option<Vec<f64>> {
        let list = self.list(key, notes)?;
        let numbers: Option<Vec<f64>> = list
            .iter()
            .map(|v| v.as_f64().filter(|n| n.is_finite()))
            .collect();
        if numbers.is_none() {
            notes.error(&self.path(key), "expected only numbers in it");
        }
        numbers
    }

    /// A list of exactly `N` finite numbers.
    pub fn vector<const N: usize>(
        &mut self,
        key: &'static str,
        notes: &mut Notes,
    ) -> Option<[f64; N]> {
        let numbers = self.numbers(key, notes)?;
        let count = numbers.len();
        let vector = numbers.try_into().ok();
        if vector.is_none() {
            notes.error(
                &self.path(key),
                format!("has {count} numbers, expected {N}"),
            );
        }
        vector
    }

    /// What the key must hold, `None` with an error noted when it is absent.
    pub fn required<T>(&self, key: &str, value: Option<T>, notes: &mut Notes) -> Option<T> {
        // A value of the wrong kind has been noted already.
        let absent = self.map.get(key).is_none_or(Value::is_null);
        if value.is_none() && absent {
            notes.error(&self.path(key), "is missing");
        }
        value
    }

    /// Keys without effect here: each that is present becomes a note.
    pub fn ignore(&mut self, keys: &[&'static str], why: &str, notes: &mut Notes) {
        for key in keys {
            if let Some(value) = self.get(key) {
                notes.ignore(self.path(key), value.clone(), why);
            }
        }
    }

    /// Warns about every key that nobody asked for.
    pub fn finish(self, notes: &mut Notes) {
        for (key, value) in self.map {
            if self.asked.contains(&key.as_str()) {
                continue;
            }
            notes.add(
                NoteKind::Unknown,
                self.path(key),
                value.clone(),
                Value::Null,
                format!("not a key of this format{}", suggestion(key, &self.asked)),
            );
        }
    }
}

/// Offers the known name that is most like `name`, if one is.
pub(super) fn suggestion(name: &str, known: &[&'static str]) -> String {
    let likeness = |k: &&&str| (strsim::jaro_winkler(name, k) * 1e6) as u64;
    let nearest = known.iter().max_by_key(likeness);
    match nearest {
        Some(nearest) if strsim::jaro_winkler(name, nearest) >= LIKENESS => {
            format!(": did you mean `{nearest}`?")
        }
        _ => String::new(),
    }
}

/// A value in words.
fn kind(value: &Value) -> String {
    match value {
        Value::Array(list) => format!("a list of {}", list.len()),
        Value::Object(_) => "an object".into(),
        other => other.to_string(),
    }
}
