//! What is wrong with a scene file, or merely suspicious, and on which line.

use std::fmt;

/// A place in a scene file.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct At {
    /// Line, from 1; 0 when the finding concerns no line.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Path of the key, such as `objects[1].material.youngs_modulus_pa`.
    pub field: String,
}

/// One finding: an error of a scene file, or a warning about it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Finding {
    /// Where.
    pub at: At,
    /// What, as a sentence with expected and actual values.
    pub message: String,
}

impl Finding {
    /// A finding at a place of the file.
    pub fn new(at: &At, message: impl Into<String>) -> Self {
        Self {
            at: at.clone(),
            message: message.into(),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let At {
            line,
            column,
            field,
        } = &self.at;
        match (*line, field.as_str()) {
            (0, "") => write!(f, "{}", self.message),
            (0, field) => write!(f, "{field}: {}", self.message),
            (line, "") => write!(f, "line {line}, column {column}: {}", self.message),
            (line, field) => write!(f, "line {line}, column {column}: {field}: {}", self.message),
        }
    }
}

/// Everything that is wrong with a scene file, in the order of its lines; never empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneErrors(pub Vec<Finding>);

impl SceneErrors {
    /// `Err` when there are findings; sorted by line, each reported once.
    pub(super) fn check(mut findings: Vec<Finding>) -> Result<(), Self> {
        if findings.is_empty() {
            return Ok(());
        }
        findings.sort();
        findings.dedup();
        Err(Self(findings))
    }
}

/// A number of errors in words: `1 error`, `4 errors`.
pub fn count_of_errors(count: usize) -> String {
    match count {
        1 => "1 error".into(),
        _ => format!("{count} errors"),
    }
}

impl fmt::Display for SceneErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, finding) in self.0.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{finding}")?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneErrors {}

/// Names that a message lists at most: more than any table has keys.
const MAX_LISTED: usize = 100;

/// Sentence part that offers the names that exist, the nearest one first in the eye.
pub(super) fn suggest<'n>(name: &str, known: impl IntoIterator<Item = &'n str>) -> String {
    let known: Vec<&str> = known.into_iter().collect();
    let nearest = known
        .iter()
        .map(|k| (strsim::jaro_winkler(name, k), *k))
        // 0.8 accepts a missing unit suffix and one or two typing errors, and little else.
        .filter(|(likeness, _)| *likeness >= 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    match (nearest, known.len()) {
        (Some((_, nearest)), _) => format!("did you mean `{nearest}`?"),
        (None, 0) => "there are none".into(),
        (None, _) => {
            let listed = known.iter().take(MAX_LISTED);
            let list: Vec<String> = listed.map(|k| format!("`{k}`")).collect();
            let more = match known.len().saturating_sub(MAX_LISTED) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("expected one of {}{more}", list.join(", "))
        }
    }
}
