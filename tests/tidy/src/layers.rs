//! Order inside the crates: modules stand on floors, each naming those below, and functions of the solver are short.

use std::path::Path;

use crate::{assert_clean, edges::members, files, modules::Modules, root, shown};

/// Crates of the solver, the lowest first.
pub(crate) const SOLVER: [&str; 4] = ["matter", "rigid", "solid", "sim-core"];

/// Longest function of the solver, in lines.
const MAX_LINES: usize = 80;

/// Circles of parts of one folder that name each other: crate, folder, parts. None may come, and what is gone leaves this list.
const CIRCLES: &[(&str, &str, &[&str])] = &[
    ("solid", "", &["kernel", "memory"]),
    (
        "scene",
        "scene_file",
        &[
            "assembly",
            "boundaries",
            "build",
            "captures",
            "cells",
            "checks",
            "contact",
            "formed",
            "objects",
            "parse",
            "placement",
            "probes",
            "quality",
            "regions",
            "report",
            "sampling",
            "select",
            "shapes",
            "solids",
            "solver",
            "spec",
        ],
    ),
    (
        "ipc",
        "",
        &[
            "domain",
            "limits",
            "management",
            "remains",
            "session",
            "sweeper",
        ],
    ),
    (
        "ipc",
        "server",
        &["commands", "monitor", "pool", "publish", "scene", "status"],
    ),
    ("server", "", &["publish", "serve"]),
    ("semantics", "", &["lift", "tree"]),
    (
        "clients/renderer",
        "",
        &[
            "client", "drawing", "output", "painter", "raster", "shade", "source", "taker",
        ],
    ),
    (
        "clients/recorder",
        "",
        &[
            "decoder",
            "file_records",
            "files",
            "reader",
            "topics",
            "writer",
        ],
    ),
    ("clients/web", "", &["http", "strokes"]),
    ("objects", "", &["page", "pick"]),
    ("demo", "", &["run", "scene"]),
    ("bench", "faults", &["act", "doors", "events", "watch"]),
    ("bench", "validate", &["case", "report"]),
];

#[test]
fn modules_of_a_crate_stand_on_floors() {
    let mut found = Vec::new();
    for of_crate in members() {
        let source = root().join(&of_crate).join("src");
        for (folder, parts) in Modules::of_sources(&source).circles() {
            found.push((of_crate.clone(), folder, parts));
        }
    }
    let known: Vec<(String, String, Vec<String>)> = CIRCLES
        .iter()
        .map(|(of_crate, folder, parts)| {
            let parts = parts.iter().map(|part| (*part).to_owned()).collect();
            ((*of_crate).to_owned(), (*folder).to_owned(), parts)
        })
        .collect();
    let line = |(of_crate, folder, parts): &(String, String, Vec<String>)| {
        format!("{of_crate}/src/{folder}: {}", parts.join(", "))
    };
    let new: Vec<String> = found
        .iter()
        .filter(|c| !known.contains(c))
        .map(line)
        .collect();
    assert_clean("circle of modules that name each other", &new);
    let gone: Vec<String> = known
        .iter()
        .filter(|c| !found.contains(c))
        .map(line)
        .collect();
    assert_clean("circle that is no more: take it out of CIRCLES", &gone);
}

/// Files of the solver with their code, up to their tests.
fn solver() -> Vec<(String, String)> {
    let mut found = Vec::new();
    for of_solver in SOLVER {
        let source = root().join(of_solver).join("src");
        let is_code = |path: &Path| {
            let inner = path.strip_prefix(&source).unwrap_or(path).to_string_lossy();
            inner.ends_with(".rs") && !inner.contains("tests/") && !inner.ends_with("tests.rs")
        };
        for path in files(&source, &is_code) {
            let text = std::fs::read_to_string(&path).expect("source is readable");
            let code = text.split("#[cfg(test)]\nmod tests {").next();
            found.push((shown(&path), code.unwrap_or_default().to_owned()));
        }
    }
    found
}

#[test]
fn functions_of_the_solver_are_short() {
    let mut findings = Vec::new();
    for (name, code) in solver() {
        let lines: Vec<&str> = code.lines().collect();
        for (n, line) in lines.iter().enumerate() {
            let inner = line.trim_start();
            let is_function = ["fn ", "pub fn ", "unsafe fn "]
                .iter()
                .any(|start| inner.starts_with(start))
                || inner.starts_with("pub(") && inner.contains(") fn ");
            // What a trait only declares has no body.
            let head = lines[n..].iter().find(|l| l.ends_with(['{', ';', '}']));
            if !is_function || head.is_some_and(|l| l.ends_with(';')) {
                continue;
            }
            let end = format!("{}}}", &line[..line.len() - inner.len()]);
            let length = lines[n..].iter().position(|l| l.starts_with(&end));
            let length = length.map_or(0, |length| length + 1);
            if length > MAX_LINES {
                findings.push(format!("{name}:{}: {length} lines", n + 1));
            }
        }
    }
    assert_clean("function too long", &findings);
}
