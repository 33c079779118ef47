//! House rules that a machine can check: dependency direction, licences, file headers and sizes, dead code, documents.
//! A crate of its own, so that a changed word is checked in seconds: `cargo test -p cosplat-tidy`.

#![cfg(test)]

mod dependencies;
mod docs;
mod edges;
mod layers;
mod modules;
mod sources;
mod statements;
mod words;

use std::path::{Path, PathBuf};

/// Root of the checkout.
fn root() -> &'static Path {
    let of_crate = Path::new(env!("CARGO_MANIFEST_DIR"));
    of_crate.ancestors().nth(2).expect("two folders above")
}

/// Files below `folder` that `keep` accepts, sorted; build outputs and hidden folders are not entered.
fn files(folder: &Path, keep: &dyn Fn(&Path) -> bool) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("folder is readable") {
        let path = entry.expect("entry is readable").path();
        let name = path
            .file_name()
            .expect("entry has a name")
            .to_string_lossy()
            .into_owned();
        if path.is_dir() {
            if name != "target" && name != "out" && !name.starts_with('.') {
                found.extend(files(&path, keep));
            }
        } else if keep(&path) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Path relative to the root, for messages.
fn shown(path: &Path) -> String {
    path.strip_prefix(root())
        .unwrap_or(path)
        .display()
        .to_string()
}

/// Fails with one line per finding.
fn assert_clean(rule: &str, findings: &[String]) {
    assert!(findings.is_empty(), "{rule}:\n  {}", findings.join("\n  "));
}
