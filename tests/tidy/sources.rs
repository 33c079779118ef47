//! Rules for every Rust source file.

use std::path::Path;

use crate::{assert_clean, files, root, shown};

/// Longest file, in lines.
const MAX_LINES: usize = 600;

fn sources() -> Vec<(String, String)> {
    files(root(), &|path: &Path| {
        path.extension().is_some_and(|e| e == "rs")
    })
    .into_iter()
    .map(|path| {
        let text = std::fs::read_to_string(&path).expect("source is readable");
        (shown(&path), text)
    })
    .collect()
}

/// Findings of `rule` over all lines of all sources, as `file:line: text`.
fn lines_where(rule: impl Fn(&str) -> bool) -> Vec<String> {
    let mut findings = Vec::new();
    for (name, text) in sources() {
        for (number, line) in text.lines().enumerate() {
            if rule(line) {
                findings.push(format!("{name}:{}: {}", number + 1, line.trim()));
            }
        }
    }
    findings
}

#[test]
fn every_module_says_what_it_is_for() {
    let findings: Vec<_> = sources()
        .into_iter()
        .filter(|(_, text)| !text.starts_with("//!"))
        .map(|(name, _)| name)
        .collect();
    assert_clean("no `//!` on the first line", &findings);
}

#[test]
fn no_file_is_longer_than_the_cap() {
    let findings: Vec<_> = sources()
        .into_iter()
        .map(|(name, text)| (name, text.lines().count()))
        .filter(|(_, lines)| *lines > MAX_LINES)
        .map(|(name, lines)| format!("{name}: {lines} lines, at most {MAX_LINES}"))
        .collect();
    assert_clean("file too long", &findings);
}

#[test]
fn no_code_is_commented_out() {
    assert_clean("commented-out code", &lines_where(is_commented_code));
}

/// A plain comment that ends like a statement or opens like an item is code put to sleep.
fn is_commented_code(line: &str) -> bool {
    let Some(text) = line.trim_start().strip_prefix("//") else {
        return false;
    };
    if text.starts_with('/') || text.starts_with('!') {
        return false;
    }
    let text = text.trim();
    let opens = [
        "let ", "fn ", "pub fn ", "use ", "#[", "println!", "dbg!", "return ",
    ];
    let ends = [";", "{", "});", "},"];
    ends.iter().any(|e| text.ends_with(e))
        || (opens.iter().any(|o| text.starts_with(o)) && text.contains('('))
}

#[test]
fn no_work_is_left_for_later() {
    // Spelled in two halves so that this file does not find itself.
    let words = [
        ["TO", "DO"],
        ["FIX", "ME"],
        ["todo", "!("],
        ["unimplemented", "!("],
        ["#[ign", "ore"],
    ]
    .map(|halves| halves.concat());
    let findings = lines_where(|line| words.iter().any(|word| line.contains(word)));
    assert_clean("unfinished work", &findings);
}

#[test]
fn the_rule_against_sleeping_code_finds_it() {
    assert!(is_commented_code("    // let x = f(1);"));
    assert!(is_commented_code("// if a {"));
    assert!(!is_commented_code("// Why: the tail is padded, see below."));
    assert!(!is_commented_code("/// let x = 1;"));
}
