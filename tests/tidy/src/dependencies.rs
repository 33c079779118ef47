//! Licences and sources of all dependencies are those that `deny.toml` allows.

use std::{collections::BTreeSet, process::Command};

use serde_json::Value;

use crate::{assert_clean, root};

/// Every package that the workspace is built from on this machine.
fn packages() -> Vec<Value> {
    let host = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let run = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--locked", "--offline"])
        .args(["--filter-platform", &host])
        .current_dir(root())
        .output()
        .expect("cargo starts");
    let errors = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{errors}");
    let metadata: Value = serde_json::from_slice(&run.stdout).expect("metadata are JSON");
    let packages = metadata["packages"].as_array().cloned();
    packages.expect("a list of packages")
}

/// Licences that `deny.toml` allows.
fn allowed() -> BTreeSet<String> {
    let text = std::fs::read_to_string(root().join("deny.toml")).expect("deny.toml is readable");
    let table: toml::Table = text.parse().expect("deny.toml is TOML");
    let allowed = table["licenses"]["allow"].as_array().expect("a list");
    let names = allowed.iter().map(|name| name.as_str().expect("a name"));
    names.map(str::to_owned).collect()
}

/// Parts of a licence expression about one operator outside parentheses.
fn parts<'a>(expression: &'a str, operator: &str) -> Vec<&'a str> {
    let (mut depth, mut start) = (0, 0);
    let mut found = Vec::new();
    for (at, c) in expression.char_indices() {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        if depth == 0 && at >= start && expression[at..].starts_with(operator) {
            found.push(expression[start..at].trim());
            start = at + operator.len();
        }
    }
    found.push(expression[start..].trim());
    found
}

/// Whether an SPDX expression, or an old one with `/` for `OR`, can be met by allowed licences.
fn is_allowed(expression: &str, allowed: &BTreeSet<String>) -> bool {
    for (operator, all) in [(" OR ", false), ("/", false), (" AND ", true)] {
        let parts = parts(expression, operator);
        if parts.len() > 1 {
            let mut each = parts.into_iter().map(|part| is_allowed(part, allowed));
            return if all {
                each.all(|ok| ok)
            } else {
                each.any(|ok| ok)
            };
        }
    }
    match expression
        .strip_prefix('(')
        .and_then(|e| e.strip_suffix(')'))
    {
        Some(inner) => is_allowed(inner, allowed),
        None => allowed.contains(expression),
    }
}

#[test]
fn every_dependency_has_an_allowed_licence_and_source() {
    let allowed = allowed();
    let mut findings = Vec::new();
    for package in packages() {
        let name = &package["name"];
        match package["source"].as_str() {
            None => continue,
            Some(source) if source.starts_with("registry+") => {}
            Some(source) => findings.push(format!("{name} comes from {source}")),
        }
        let licence = package["license"].as_str().unwrap_or_default();
        if !is_allowed(licence, &allowed) {
            findings.push(format!("{name} is under '{licence}'"));
        }
    }
    assert_clean("not allowed by deny.toml", &findings);
}

#[test]
fn licence_expressions_are_read_as_spdx_has_them() {
    let allowed: BTreeSet<String> = ["MIT", "Zlib"].map(String::from).into();
    for good in [
        "MIT",
        "MIT/GPL-3.0",
        "GPL-3.0 OR MIT",
        "(GPL-3.0 OR MIT) AND Zlib",
        "GPL-3.0 OR (MIT AND Zlib)",
    ] {
        assert!(is_allowed(good, &allowed), "{good}");
    }
    for bad in [
        "",
        "GPL-3.0",
        "MIT AND GPL-3.0",
        "(GPL-3.0 OR MIT) AND BSL-1.0",
    ] {
        assert!(!is_allowed(bad, &allowed), "{bad}");
    }
}
