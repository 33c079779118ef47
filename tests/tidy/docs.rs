//! Documentation must not name what does not exist.

use std::path::Path;

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
    is_path && !rest.is_empty() && known.contains(&first)
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

#[test]
fn every_path_named_in_the_docs_exists() {
    let mut findings = Vec::new();
    for file in files(root(), &|path: &Path| {
        path.extension().is_some_and(|e| e == "md")
    }) {
        let text = std::fs::read_to_string(&file).expect("document is readable");
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

#[test]
fn the_path_rule_knows_paths_from_prose() {
    assert!(names_a_path("sim-core/src/lib.rs"));
    assert!(names_a_path("CHANGELOG.md"));
    assert!(!names_a_path("cosplat/<session>/v1/frame"));
    assert!(!names_a_path("m/s"));
    assert_eq!(tokens("see `a/b` and [c](d/e.md)"), ["a/b", "d/e.md"]);
}
