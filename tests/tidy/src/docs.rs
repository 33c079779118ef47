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
        "matter",
        "objects",
        "rigid",
        "sim-core",
        "solid",
        "ipc",
        "server",
        "clients",
        "bench",
        "console",
        "fuzz",
        "importers",
        "pacing",
        "raster",
        "reference",
        "replay",
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

#[test]
fn lines_of_the_documents_have_at_most_160_columns() {
    let mut findings = Vec::new();
    for (file, text) in documents() {
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

/// Most words of a sentence.
const MAX_WORDS: usize = 25;

/// Whether a line ends the paragraph or item before it, and is none itself.
fn is_no_prose(line: &str) -> bool {
    let line = line.trim_start();
    line.is_empty()
        || ["|", "#", "<!--", "---"]
            .iter()
            .any(|s| line.starts_with(s))
}

/// Whether an item of a list begins with a line.
fn begins_item(line: &str) -> bool {
    let line = line.trim_start();
    let number = line.trim_start_matches(|c: char| c.is_ascii_digit());
    line.starts_with("- ") || line.starts_with("* ") || number != line && number.starts_with(". ")
}

/// Sentences of a Markdown text with more than [`MAX_WORDS`] words: line of the paragraph or item, words.
///
/// A colon or semicolon ends a sentence as a full stop does. Names in code and targets of links are no words; headings,
/// tables and blocks of code are no sentences.
fn long_sentences(text: &str) -> Vec<(usize, usize)> {
    let mut paragraphs: Vec<(usize, String)> = Vec::new();
    let (mut is_fenced, mut goes_on) = (false, false);
    for (number, line) in (1..).zip(text.lines()) {
        let is_fence = line.trim_start().starts_with("```");
        is_fenced ^= is_fence;
        if is_fenced || is_fence || is_no_prose(line) {
            goes_on = false;
            continue;
        }
        match paragraphs.last_mut() {
            Some((_, paragraph)) if goes_on && !begins_item(line) => {
                *paragraph += &format!(" {}", line.trim());
            }
            _ => paragraphs.push((number, line.trim().to_owned())),
        }
        goes_on = true;
    }
    let mut findings = Vec::new();
    for (number, paragraph) in paragraphs {
        let outside = paragraph.split('`').step_by(2).collect::<String>();
        let links = outside.split("](").enumerate();
        let prose = links.map(|(n, part)| match part.split_once(')') {
            Some((_, rest)) if n > 0 => rest,
            _ => part,
        });
        let mut words = 0;
        for token in prose.collect::<String>().split_whitespace() {
            words += usize::from(token.contains(|c: char| c.is_ascii_alphanumeric()));
            let end = token.trim_end_matches(|c: char| "\"')*".contains(c));
            if end.ends_with(['.', '!', '?', ':', ';']) {
                if words > MAX_WORDS {
                    findings.push((number, words));
                }
                words = 0;
            }
        }
        if words > MAX_WORDS {
            findings.push((number, words));
        }
    }
    findings
}

#[test]
fn sentences_of_the_documents_have_at_most_25_words() {
    let mut findings = Vec::new();
    for (file, text) in documents() {
        let name = shown(&file);
        // A line of it is a thing that changed, however much there is to say of it.
        if name == "CHANGELOG.md" {
            continue;
        }
        let long = long_sentences(&text).into_iter();
        findings.extend(long.map(|(line, words)| format!("{name}:{line}: {words} words")));
    }
    assert_clean("sentence too long", &findings);
}

#[test]
fn words_are_counted_between_stops_and_without_code() {
    let words = |n: usize| vec!["word"; n].join(" ");
    let (most, more) = (words(MAX_WORDS), words(MAX_WORDS + 1));
    assert_eq!(long_sentences(&format!("{most}. {most}: {most}")), []);
    let text = format!("# {more}\n| {more} |\n\n{most}\n`a` [b](c)\n\n- {more}.");
    assert_eq!(
        long_sentences(&text),
        [(4, MAX_WORDS + 1), (7, MAX_WORDS + 1)]
    );
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
