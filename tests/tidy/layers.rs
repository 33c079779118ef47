//! Order inside the solver: modules name those below them alone, and functions are short.

use crate::{assert_clean, files, root, shown};

/// Modules of the solver, the lowest first: each may name those before it.
const FLOORS: [&str; 11] = [
    "materials",
    "particles",
    "colliders",
    "grid",
    "contact",
    "bodies",
    "step",
    "model",
    "state",
    "substep",
    "world",
];

/// Longest function of the solver, in lines.
const MAX_LINES: usize = 80;

/// Files of the modules in [`FLOORS`] with their floor and their code, up to their tests.
fn solver() -> Vec<(String, usize, String)> {
    let source = root().join("sim-core/src");
    let rust = files(&source, &|path| path.extension().is_some_and(|e| e == "rs"));
    let mut found = Vec::new();
    for path in rust {
        let inner = path.strip_prefix(&source).expect("a file below its folder");
        let inner = inner.to_string_lossy().into_owned();
        let module = inner.split('/').next().unwrap_or_default();
        let module = module.trim_end_matches(".rs");
        let Some(floor) = FLOORS.iter().position(|name| *name == module) else {
            continue;
        };
        if inner.contains("/tests/") || inner.ends_with("tests.rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("source is readable");
        let code = text.split("#[cfg(test)]\nmod tests {").next();
        let code = code.unwrap_or_default().to_owned();
        found.push((shown(&path), floor, code));
    }
    found
}

/// Modules of this crate that some code names, comments aside.
fn named(code: &str) -> Vec<String> {
    let lines = code.lines().filter(|l| !l.trim_start().starts_with("//"));
    let code = lines.collect::<Vec<_>>().join("\n");
    let mut found = Vec::new();
    for (at, start) in code.match_indices("crate::") {
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
        for other in named(&code) {
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
    assert_eq!(named(code), ["a", "e", "", "g"]);
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
