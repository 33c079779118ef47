//! Order inside the solver: modules name those below them alone, and functions are short.

use std::collections::{BTreeMap, BTreeSet};

use crate::{assert_clean, files, root, shown};

/// Crates of the solver, the lowest first.
pub(crate) const SOLVER: [&str; 4] = ["matter", "rigid", "solid", "sim-core"];

/// Modules of the solver, the lowest first: each may name those before it. The crate `solid` is one of them as a whole.
const FLOORS: [&str; 31] = [
    "expression",
    "num",
    "mat3",
    "simd",
    "contact_com",
    "kinematics",
    "particles",
    "rotation",
    "materials",
    "scene",
    "coherence",
    "colliders",
    "ledger",
    "report",
    "command",
    "moments",
    "notices",
    "pose",
    "test_scenes",
    "distance",
    "grid",
    "probe",
    "contact",
    "step",
    "bodies",
    "solid",
    "coupling",
    "model",
    "state",
    "substep",
    "world",
];

/// Longest function of the solver, in lines.
const MAX_LINES: usize = 80;

/// Files of the solver with the floors of their modules in [`FLOORS`] and their code, up to their tests.
fn solver() -> Vec<(String, Option<usize>, String)> {
    let mut found = Vec::new();
    for of_solver in SOLVER {
        let source = root().join(of_solver).join("src");
        let rust = files(&source, &|path| path.extension().is_some_and(|e| e == "rs"));
        for path in rust {
            let inner = path.strip_prefix(&source).expect("a file below its folder");
            let inner = inner.to_string_lossy().into_owned();
            let module = inner.split('/').next().unwrap_or_default();
            let module = module.trim_end_matches(".rs");
            let floor = FLOORS.iter().position(|name| *name == module);
            let is_solid = of_solver == "solid";
            if inner.contains("tests/")
                || inner.ends_with("tests.rs")
                || floor.is_none() && !is_solid
            {
                continue;
            }
            let floor = floor.filter(|_| !is_solid);
            let text = std::fs::read_to_string(&path).expect("source is readable");
            let code = text.split("#[cfg(test)]\nmod tests {").next();
            let code = code.unwrap_or_default().to_owned();
            found.push((shown(&path), floor, code));
        }
    }
    found
}

/// What some code names at the first level after `start`, comments aside: of `crate::`, modules of its crate.
fn named(code: &str, start: &str) -> Vec<String> {
    let lines = code.lines().filter(|l| !l.trim_start().starts_with("//"));
    let code = lines.collect::<Vec<_>>().join("\n");
    let mut found = Vec::new();
    for (at, start) in code.match_indices(start) {
        let rest = &code[at + start.len()..];
        let word = |text: &str| {
            let letters = text.trim_start().chars();
            let letters = letters.take_while(|c| c.is_alphanumeric() || *c == '_');
            letters.collect::<String>()
        };
        let Some(list) = rest.strip_prefix('{') else {
            found.push(word(rest));
            continue;
        };
        // Names at the first level of the braces.
        let (mut depth, mut begin) = (0, 0);
        for (n, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => {
                    found.push(word(&list[begin..n]));
                    break;
                }
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    found.push(word(&list[begin..n]));
                    begin = n + 1;
                }
                _ => {}
            }
        }
    }
    found
}

#[test]
fn solver_modules_name_only_those_below() {
    let mut findings = Vec::new();
    for (name, floor, code) in solver() {
        let Some(floor) = floor else {
            continue;
        };
        for other in named(&code, "crate::") {
            if FLOORS[floor + 1..].contains(&other.as_str()) {
                findings.push(format!("{name}: {} names {other}", FLOORS[floor]));
            }
        }
    }
    assert_clean("upward arrow", &findings);
}

#[test]
fn names_are_found_in_nested_lists() {
    let code =
        "use crate::{\n    a::{b, c::{d}},\n    e,\n};\nfn f() { crate::g::h(); }\n// crate::i";
    assert_eq!(named(code, "crate::"), ["a", "e", "", "g"]);
}

/// Per file of a folder the files beside it that it names, by their names, those among them whose items the folder's own
/// file hands on; without the folder's own file, which may name all of them as they may name it.
fn beside(
    folder: &str,
    sources: &[(String, Option<usize>, String)],
) -> BTreeMap<String, BTreeSet<String>> {
    let inside = |name: &str| {
        let stem = name.strip_prefix(folder)?.strip_suffix(".rs")?;
        let is_own = ["mod", "lib"].contains(&stem);
        (!stem.contains('/') && !is_own).then(|| stem.to_owned())
    };
    let stems: Vec<_> = sources.iter().filter_map(|s| inside(&s.0)).collect();
    let own = [
        format!("{folder}mod.rs"),
        format!("{folder}lib.rs"),
        format!("{}.rs", folder.trim_end_matches('/')),
    ];
    let own = sources.iter().find(|s| own.contains(&s.0));
    let own = own.map_or("", |s| &*s.2);
    let mut handed_on = BTreeMap::new();
    for stem in &stems {
        let names = named(own, &format!(" use {stem}::"));
        handed_on.extend(names.into_iter().map(|name| (name, stem)));
    }
    let files = sources.iter().filter_map(|s| Some((inside(&s.0)?, &s.2)));
    let of_file = |(stem, code): (String, &String)| {
        let words = named(code, "super::").into_iter();
        let others = words.filter_map(|word| match stems.contains(&word) {
            true => Some(word),
            false => handed_on.get(&word).map(|&stem| stem.clone()),
        });
        let others = others.filter(|other| *other != stem).collect();
        (stem, others)
    };
    files.map(of_file).collect()
}

/// What is left of a graph when all that leads to nowhere is taken out of it.
fn circle(mut graph: BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    loop {
        let ends: Vec<String> = graph
            .iter()
            .filter(|(_, others)| others.iter().all(|other| !graph.contains_key(other)))
            .map(|(name, _)| name.clone())
            .collect();
        if ends.is_empty() {
            return graph.into_keys().collect();
        }
        graph.retain(|name, _| !ends.contains(name));
    }
}

#[test]
fn solver_files_side_by_side_name_each_other_in_no_circle() {
    let sources = solver();
    let folders = sources
        .iter()
        .filter_map(|s| Some(&s.0[..=s.0.rfind('/')?]));
    let folders: BTreeSet<&str> = folders.collect();
    let mut findings = Vec::new();
    for folder in folders {
        let left = circle(beside(folder, &sources));
        if !left.is_empty() {
            findings.push(format!("{folder}: {}", left.join(", ")));
        }
    }
    assert_clean("circle of files", &findings);
}

#[test]
fn circles_are_found_through_what_is_handed_on() {
    let source = |name: &str, code: &str| (name.to_owned(), Some(0), code.to_owned());
    let straight = [
        source("m/mod.rs", "pub use b::{B, C};"),
        source("m/a.rs", "use super::{B, Own};"),
        source("m/b.rs", "use super::Own;"),
    ];
    assert_eq!(circle(beside("m/", &straight)), [""; 0]);
    let round = [
        straight[0].clone(),
        straight[1].clone(),
        source("m/b.rs", "use super::a::A;"),
        source("m/c.rs", "use super::a::A;"),
    ];
    assert_eq!(circle(beside("m/", &round)), ["a", "b", "c"]);
}

#[test]
fn functions_of_the_solver_are_short() {
    let mut findings = Vec::new();
    for (name, _, code) in solver() {
        let lines: Vec<&str> = code.lines().collect();
        for (n, line) in lines.iter().enumerate() {
            let inner = line.trim_start();
            let is_function = ["fn ", "pub fn ", "unsafe fn "]
                .iter()
                .any(|start| inner.starts_with(start))
                || inner.starts_with("pub(") && inner.contains(") fn ");
            if !is_function {
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
