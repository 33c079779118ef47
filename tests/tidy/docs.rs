//! Documentation must not name what does not exist.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::{assert_clean, files, root, shown};

/// A code span or link target that starts with one of these names a path of the checkout.
fn names_a_path(token: &str) -> bool {
    let is_path = !token.is_empty()
        && token
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c));
    let Some((first, rest)) = token.split_once('/') else {
        return is_path && token.ends_with(".md");
    };
    let known = [
        "src",
        "sim-core",
        "ipc",
        "server",
        "clients",
        "bench",
        "importers",
        "tests",
        "docs",
        "scenes",
        ".ci",
    ];
    // The crate `scene`, not a stream or a file of a recording of that name.
    let of_crate = first == "scene" && (rest.starts_with("src") || rest.starts_with("tests"));
    is_path && !rest.is_empty() && (of_crate || known.contains(&first))
}

/// Inline code spans and link targets of a Markdown text, outside fenced blocks.
fn tokens(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut fenced = false;
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced {
            continue;
        }
        found.extend(line.split('`').skip(1).step_by(2).map(str::to_owned));
        for part in line.split("](").skip(1) {
            if let Some((target, _)) = part.split_once(')') {
                found.push(target.to_owned());
            }
        }
    }
    found
}

/// All Markdown files with their text.
fn documents() -> Vec<(PathBuf, String)> {
    let is_markdown = |path: &Path| path.extension().is_some_and(|e| e == "md");
    files(root(), &is_markdown)
        .into_iter()
        .map(|path| {
            let text = std::fs::read_to_string(&path).expect("document is readable");
            (path, text)
        })
        .collect()
}

#[test]
fn every_path_named_in_the_docs_exists() {
    let mut findings = Vec::new();
    for (file, text) in documents() {
        let folder = file.parent().expect("a file has a folder");
        for token in tokens(&text) {
            let path = token.split('#').next().unwrap_or_default();
            let exists = root().join(path).exists() || folder.join(path).exists();
            if names_a_path(path) && !exists {
                findings.push(format!("{}: {token}", shown(&file)));
            }
        }
    }
    assert_clean("path does not exist", &findings);
}

/// Anchors of the headings of a Markdown text, as renderers make them: lower case, dashes for spaces, no punctuation.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = text.lines().filter(|l| l.starts_with('#'));
    headings
        .map(|line| {
            let title = line.trim_start_matches('#').trim().to_lowercase();
            let kept = title
                .chars()
                .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
            kept.map(|c| if c == ' ' { '-' } else { c }).collect()
        })
        .collect()
}

#[test]
fn every_section_that_a_link_names_exists() {
    let mut findings = Vec::new();
    for (file, text) in documents() {
        let folder = file.parent().expect("a file has a folder");
        for token in tokens(&text) {
            let Some((path, anchor)) = token.split_once('#') else {
                continue;
            };
            let target = match path {
                "" => file.clone(),
                path => folder.join(path),
            };
            let is_word = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
            if !anchor.chars().all(is_word) || target.extension().is_none_or(|e| e != "md") {
                continue;
            }
            let known = std::fs::read_to_string(&target).map(|text| anchors(&text));
            if !known.is_ok_and(|known| known.contains(anchor)) {
                findings.push(format!("{}: {token}", shown(&file)));
            }
        }
    }
    assert_clean("no section of that name", &findings);
}

/// Widest line of a Markdown file, in characters.
const MAX_COLUMNS: usize = 160;

/// Lines of a Markdown text that are too wide.
///
/// Tables between the markers `<!-- begin` and `<!-- end` may be wider: programs write them from measurements, Markdown
/// has no row of two lines, and a row with fewer figures would be another table.
fn wide_lines(text: &str) -> Vec<usize> {
    let mut findings = Vec::new();
    let mut is_generated = false;
    for (number, line) in (1..).zip(text.lines()) {
        if line.starts_with("<!-- begin") || line.starts_with("<!-- end") {
            is_generated = line.starts_with("<!-- begin");
        }
        let is_row = line.trim_start().starts_with('|');
        if line.chars().count() > MAX_COLUMNS && !(is_row && is_generated) {
            findings.push(number);
        }
    }
    findings
}

/// The wire contract, whose lines are broken when its words are next revised.
const NOT_YET: [&str; 1] = ["docs/wire-format.md"];

#[test]
fn lines_of_the_documents_have_at_most_160_columns() {
    let mut findings = Vec::new();
    for (file, text) in documents() {
        if NOT_YET.contains(&shown(&file).as_str()) {
            continue;
        }
        let lines = wide_lines(&text);
        findings.extend(lines.iter().map(|n| format!("{}:{n}", shown(&file))));
    }
    assert_clean("line too wide", &findings);
}

#[test]
fn the_rule_for_columns_spares_generated_tables_alone() {
    let wide = "x".repeat(MAX_COLUMNS + 1);
    assert_eq!(wide_lines(&format!("{wide}\n| {wide} |\n")), [1, 2]);
    let generated = format!("<!-- begin: a -->\n| {wide} |\n{wide}\n<!-- end: a -->\n| {wide} |");
    assert_eq!(wide_lines(&generated), [3, 5]);
}

#[test]
fn anchors_are_those_of_a_renderer() {
    let found = anchors("# Two fields, `a` and b\ntext\n## In 3D");
    assert_eq!(Vec::from_iter(found), ["in-3d", "two-fields-a-and-b"]);
}

#[test]
fn the_path_rule_knows_paths_from_prose() {
    assert!(names_a_path("sim-core/src/lib.rs"));
    assert!(names_a_path("CHANGELOG.md"));
    assert!(!names_a_path("cosplat/<session>/v1/frame"));
    assert!(!names_a_path("m/s"));
    assert_eq!(tokens("see `a/b` and [c](d/e.md)"), ["a/b", "d/e.md"]);
}
