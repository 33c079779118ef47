//! The field's words in the solver's names: what `docs/glossary.md` replaced does not come back.

use std::path::Path;

use crate::{assert_clean, files, layers::SOLVER, root, shown};

/// Names that stood for terms of the field, or for several things at once. Whole identifiers, outside comments.
const BANNED: &[&str] = &[
    "Acting",
    "Allowed",
    "Approach",
    "BESIDE",
    "BlockTouch",
    "CLEAR",
    "FAR",
    "HERE",
    "Held",
    "Look",
    "MOST",
    "Meeting",
    "Met",
    "Near",
    "Nearest",
    "Remembered",
    "SOON",
    "STILL",
    "Seen",
    "Site",
    "Sites",
    "Standing",
    "Told",
    "Touch",
    "Touched",
    "WORTH",
    "Wader",
    "Water",
    "Wish",
    "grips",
    "pressing",
    "rub",
    "rubbed",
    "rubs",
    "wade",
    "waded",
    "yielding",
];

/// Identifiers of a line of code, without those in its comment and strings.
fn identifiers(line: &str) -> impl Iterator<Item = &str> {
    let code = line.split("//").next().unwrap_or_default();
    let outside = code.split('"').step_by(2);
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    outside.flat_map(move |part| part.split(move |c| !is_part(c)))
}

#[test]
fn the_solver_speaks_the_words_of_the_field() {
    let mut findings = Vec::new();
    let is_source = |path: &Path| path.extension().is_some_and(|e| e == "rs");
    let sources = SOLVER.map(|of_solver| files(&root().join(of_solver).join("src"), &is_source));
    for file in sources.into_iter().flatten() {
        let text = std::fs::read_to_string(&file).expect("source is readable");
        for (number, line) in (1..).zip(text.lines()) {
            for word in identifiers(line).filter(|word| BANNED.contains(word)) {
                findings.push(format!("{}:{number}: {word}", shown(&file)));
            }
        }
    }
    assert_clean("see docs/glossary.md", &findings);
}

#[test]
fn every_banned_word_is_an_older_word_of_the_glossary() {
    let text = std::fs::read_to_string(root().join("docs/glossary.md")).expect("the glossary");
    let (_, names) = text
        .split_once("## Names that do not come back")
        .expect("the section");
    let told: Vec<&str> = names.split('`').skip(1).step_by(2).collect();
    let missing: Vec<String> = BANNED
        .iter()
        .filter(|word| !told.contains(word))
        .map(|word| (*word).to_owned())
        .collect();
    assert_clean("not in docs/glossary.md", &missing);
}

#[test]
fn comments_and_strings_are_free_to_use_any_word() {
    let found = |line| identifiers(line).any(|word| BANNED.contains(&word));
    assert!(found("let most = SOON * dx;"));
    assert!(!found("let a = \"Water\"; // Water is wet"));
    assert!(!found("fn closest() -> Sooner {"));
}
