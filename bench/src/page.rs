//! Parts of Markdown pages that are measured: what stands between `<!-- begin: NAME -->` and `<!-- end: NAME -->`.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::Context;
use cosplat_console::say;
use serde::Serialize;

use crate::machine::Run;

/// How a measurement of one table is told.
#[derive(clap::Args)]
pub struct Telling {
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Write the table between the markers of this Markdown file.
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

impl Telling {
    /// Whether the page has the part. To be asked before anything is measured.
    ///
    /// # Errors
    /// When it cannot be read or lacks a marker.
    pub fn check(&self, part: &str) -> anyhow::Result<()> {
        self.table.iter().try_for_each(|path| check(path, &[part]))
    }

    /// Prints a report, or its `text` in Markdown, and writes that below a caption: what was measured, and where.
    ///
    /// # Errors
    /// When it cannot be printed or written.
    pub fn tell(
        &self,
        part: &str,
        report: &impl Serialize,
        text: &str,
        (run, what): (&Run, &str),
    ) -> anyhow::Result<()> {
        if self.json {
            say!("{}", serde_json::to_string(report)?)?;
        } else {
            say!("{text}")?;
        }
        match &self.table {
            Some(path) => put(path, &[(part, format!("{}\n\n{text}", run.caption(what)))]),
            None => Ok(()),
        }
    }
}

/// Whether a page has these parts. To be asked before anything is measured.
///
/// # Errors
/// When it cannot be read or lacks a marker.
pub fn check(path: &Path, parts: &[&str]) -> anyhow::Result<()> {
    let parts: Vec<_> = parts.iter().map(|&name| (name, String::new())).collect();
    replaced(path, &parts).map(|_| ())
}

/// Replaces parts of a page.
///
/// # Errors
/// When it cannot be read or written or lacks a marker.
pub fn put(path: &Path, parts: &[(&str, String)]) -> anyhow::Result<()> {
    fs::write(path, replaced(path, parts)?)
        .with_context(|| format!("cannot write {}", path.display()))
}

fn replaced(path: &Path, parts: &[(&str, String)]) -> anyhow::Result<String> {
    let mut page =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    for (name, text) in parts {
        let [begin, end] = ["begin", "end"].map(|edge| format!("<!-- {edge}: {name} -->"));
        let missing = || format!("{} lacks the lines {begin} and {end}", path.display());
        let (head, rest) = page.split_once(&begin).with_context(missing)?;
        let (_, tail) = rest.split_once(&end).with_context(missing)?;
        page = format!(
            "{head}{begin}\n\n{}\n\n{end}{tail}",
            folded(text.trim_end())
        );
    }
    Ok(page)
}

/// Widest line of prose, in characters.
const COLUMNS: usize = 140;

/// Folds prose; rows of tables, headings and pictures stay as they are.
fn folded(text: &str) -> String {
    let is_prose = |line: &str| !line.starts_with(['|', '#', '!', ' ']);
    let lines = text.lines().map(|line| match is_prose(line) {
        true => folded_line(line),
        false => line.to_owned(),
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// A paragraph, or an item of a list, in several lines. Code is not broken.
fn folded_line(line: &str) -> String {
    let indent = if line.starts_with("- ") { "  " } else { "" };
    let (mut text, mut width, mut in_code) = (String::new(), 0, false);
    for word in line.split(' ') {
        let length = word.chars().count();
        if width > 0 && !in_code && width + 1 + length > COLUMNS {
            text = text + "\n" + indent;
            width = indent.len();
        } else if width > 0 {
            text.push(' ');
            width += 1;
        }
        text += word;
        width += length;
        in_code ^= word.matches('`').count() % 2 == 1;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_replaced_and_a_missing_one_is_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("page.md");
        let page = "head\n<!-- begin: one -->\nold\n<!-- end: one -->\ntail\n";
        fs::write(&path, page).expect("writable");
        put(&path, &[("one", "new\n".into())]).expect("the part is there");
        let found = fs::read_to_string(&path).expect("readable");
        assert_eq!(
            found,
            "head\n<!-- begin: one -->\n\nnew\n\n<!-- end: one -->\ntail\n"
        );
        let error = check(&path, &["one", "two"]).expect_err("there is no second part");
        assert!(error.to_string().contains("<!-- begin: two -->"), "{error}");
    }

    #[test]
    fn prose_is_folded_and_tables_are_not() {
        let words = "word ".repeat(40);
        let text = format!("{words}\n| {words}|\n- {words}`{words}`");
        let folded = folded(text.trim_end());
        let lines: Vec<&str> = folded.lines().collect();
        assert_eq!(
            folded.split_whitespace().count(),
            text.split_whitespace().count()
        );
        assert!(lines[0].len() <= COLUMNS && lines[1].starts_with("word"));
        assert!(lines.contains(&format!("| {words}|").as_str()));
        // The second line of the item; what is code stays whole.
        assert!(lines.iter().any(|line| line.starts_with("  word")));
        assert!(
            lines
                .iter()
                .any(|line| line.contains(&format!("`{words}`")))
        );
    }
}
