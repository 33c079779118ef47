//! What an import changed, corrected, ignored or doubts, key by key.

use std::fmt;

use serde::Serialize;
use serde_json::Value;

/// Kind of a [`Note`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NoteKind {
    /// Means the same and is written differently, or is done differently here.
    Changed,
    /// A defect of the original program is not repeated.
    Corrected,
    /// A defect of the original program is repeated, as asked for.
    Reproduced,
    /// Known and without effect here.
    Ignored,
    /// Not a key of this format.
    Unknown,
    /// Valid, and probably not what was meant.
    Warning,
}

/// One finding of an import.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Note {
    /// Kind.
    pub kind: NoteKind,
    /// Path of the key in the configuration, such as `boundary_conditions[1].surface`.
    pub key: String,
    /// What the configuration says; null when it says nothing.
    pub old: Value,
    /// What the scene says instead; null when nothing takes its place.
    pub new: Value,
    /// Why, as a sentence.
    pub message: String,
}

impl fmt::Display for NoteKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Changed => "changed",
            Self::Corrected => "corrected",
            Self::Reproduced => "reproduced",
            Self::Ignored => "ignored",
            Self::Unknown => "unknown",
            Self::Warning => "warning",
        })
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<10} {}", self.kind.to_string(), self.key)?;
        match (&self.old, &self.new) {
            (Value::Null, Value::Null) => {}
            (old, Value::Null) => write!(f, " = {}", short(old))?,
            (Value::Null, new) => write!(f, " -> {}", short(new))?,
            (old, new) => write!(f, ": {} -> {}", short(old), short(new))?,
        }
        write!(f, ": {}", self.message)
    }
}

/// A value as JSON, cut where it is too long for a line.
fn short(value: &Value) -> String {
    const LONGEST: usize = 60;
    let text = value.to_string();
    if text.chars().count() <= LONGEST {
        return text;
    }
    let head: String = text.chars().take(LONGEST).collect();
    format!("{head}...")
}

/// Notes and errors, collected while a configuration is read and converted.
#[derive(Clone, Debug, Default)]
pub(super) struct Notes {
    pub notes: Vec<Note>,
    /// What makes the configuration unusable, each with its key.
    pub errors: Vec<String>,
}

impl Notes {
    pub fn add(
        &mut self,
        kind: NoteKind,
        key: impl Into<String>,
        old: impl Into<Value>,
        new: impl Into<Value>,
        message: impl Into<String>,
    ) {
        self.notes.push(Note {
            kind,
            key: key.into(),
            old: old.into(),
            new: new.into(),
            message: message.into(),
        });
    }

    pub fn warn(
        &mut self,
        key: impl Into<String>,
        old: impl Into<Value>,
        message: impl Into<String>,
    ) {
        self.add(NoteKind::Warning, key, old, Value::Null, message);
    }

    pub fn ignore(
        &mut self,
        key: impl Into<String>,
        old: impl Into<Value>,
        message: impl Into<String>,
    ) {
        self.add(NoteKind::Ignored, key, old, Value::Null, message);
    }

    pub fn error(&mut self, key: &str, message: impl fmt::Display) {
        self.errors.push(format!("{key}: {message}"));
    }
}
