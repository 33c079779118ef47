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

/// Longest name of a test, in characters: conditions stand in a line above.
const MAX_NAME: usize = 60;

/// Names of tests of a source that are too long.
fn long_names(text: &str) -> Vec<&str> {
    let mut is_test = false;
    let mut findings = Vec::new();
    for line in text.lines().map(str::trim_start) {
        is_test |= line.starts_with("#[test]");
        let Some(rest) = line.strip_prefix("fn ") else {
            continue;
        };
        let name = rest.split('(').next().unwrap_or_default();
        if is_test && name.len() > MAX_NAME {
            findings.push(name);
        }
        is_test = false;
    }
    findings
}

#[test]
fn names_of_tests_have_at_most_60_characters() {
    let mut findings = Vec::new();
    for (file, text) in sources() {
        let names = long_names(&text);
        findings.extend(names.iter().map(|name| format!("{file}: {name}")));
    }
    assert_clean("name of a test too long", &findings);
}

#[test]
fn the_rule_for_names_looks_at_tests_alone() {
    let long = "a".repeat(MAX_NAME + 1);
    let text = format!("#[test]\nfn {long}() {{}}\nfn {long}() {{}}\n#[test]\nfn b() {{}}");
    assert_eq!(long_names(&text), [long.as_str()]);
}

/// Lines of unsafe functions whose documentation has no `# Safety`.
fn unexplained_unsafe(text: &str) -> Vec<usize> {
    let lines: Vec<&str> = text.lines().map(str::trim_start).collect();
    let is_above = |line: &&&str| line.starts_with("///") || line.starts_with("#[");
    let opens = |line: &str| {
        let code = line.split("//").next().unwrap_or_default();
        code.starts_with("unsafe fn ") || code.contains(" unsafe fn ")
    };
    (0..lines.len())
        .filter(|&n| opens(lines[n]))
        .filter(|&n| {
            let mut above = lines[..n].iter().rev().take_while(is_above);
            !above.any(|line| line.contains("# Safety"))
        })
        .map(|n| n + 1)
        .collect()
}

#[test]
fn every_unsafe_function_says_what_makes_it_safe() {
    let mut findings = Vec::new();
    for (name, text) in sources() {
        // This file names such functions in strings.
        let lines = match name.starts_with("tests/tidy") {
            true => Vec::new(),
            false => unexplained_unsafe(&text),
        };
        findings.extend(lines.iter().map(|line| format!("{name}:{line}")));
    }
    assert_clean("unsafe function without `# Safety`", &findings);
}

#[test]
fn the_rule_for_unsafe_functions_finds_them() {
    let explained = "/// # Safety\n/// Sixteen floats.\n#[inline]\npub unsafe fn a() {}\n";
    assert!(unexplained_unsafe(explained).is_empty());
    assert_eq!(unexplained_unsafe("/// Reads.\nunsafe fn a() {}\n"), [2]);
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
fn commands_print_through_one_place() {
    let macros = ["println!(", "print!(", "eprint!("];
    let findings: Vec<_> = lines_where(|line| macros.iter().any(|m| line.contains(m)))
        .into_iter()
        .filter(|found| found.starts_with("src/") && !found.starts_with("src/bench"))
        .collect();
    assert_clean("panics when nobody reads, see src/output.rs", &findings);
}

/// Lines of our own error types by which a cause is said twice: in the sentence of the error and in the chain behind it.
///
/// Errors say their cause themselves, in its place in the sentence, and keep it in a field of another name than `source`.
fn doubled_causes(text: &str) -> Vec<usize> {
    let mut findings = Vec::new();
    let (mut in_errors, mut is_transparent) = (false, false);
    for (number, line) in (1..).zip(text.lines()) {
        let code = line.trim_start().trim_start_matches("pub ");
        if code.starts_with("#[derive(") {
            in_errors = code.contains("thiserror::Error") || code.contains(" Error)");
        } else if code.starts_with("#[error(") {
            is_transparent = code.contains("transparent");
        }
        let names_it = code.starts_with("source:") || code.contains(" source: ");
        let passes_it_on = code.contains("#[from]") && !is_transparent;
        if in_errors && (names_it || passes_it_on || code.contains("#[source]")) {
            findings.push(number);
        }
        in_errors &= line != "}";
    }
    findings
}

#[test]
fn no_error_says_its_cause_twice() {
    let mut findings = Vec::new();
    for (name, text) in sources() {
        let lines = doubled_causes(&text);
        findings.extend(lines.iter().map(|line| format!("{name}:{line}")));
    }
    assert_clean("the cause is in the sentence and behind it", &findings);
}

#[test]
fn the_rule_against_doubled_causes_finds_them() {
    let error =
        |inner: &str| format!("#[derive(Debug, thiserror::Error)]\npub enum E {{\n{inner}\n}}\n");
    for bad in [
        "#[error(\"a: {source}\")]\nA { path: P, source: B },",
        "#[error(\"a: {source}\")]\nA {\n    source: B,\n},",
        "#[error(\"a: {0}\")]\nA(#[from] B),",
        "#[error(\"a: {0}\")]\nA(#[source] B),",
    ] {
        assert_eq!(doubled_causes(&error(bad)).len(), 1, "{bad}");
    }
    for good in [
        "#[error(transparent)]\nA(#[from] B),",
        "#[error(\"a: {cause}\")]\nA { cause: B },",
        "#[error(\"a: {0}\")]\nA(B),",
    ] {
        assert!(doubled_causes(&error(good)).is_empty(), "{good}");
    }
    assert!(doubled_causes("#[derive(Debug)]\nstruct A {\n    source: B,\n}\n").is_empty());
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

/// Ways to write a file that take along what was there, and where they may stand outside of tests.
const WRITES: [&str; 3] = ["fs::write(", "File::create(", ".truncate(true)"];
const MAY_WRITE: [&str; 7] = [
    "files/",
    // What processes tell each other of themselves, and checkpoints, in folders of their own.
    "ipc/",
    "server/",
    // Measurements, which write to a checkout or to a folder of their own.
    "bench/",
    "fuzz/",
    "demo/src/children.rs",
    "tests/",
];

#[test]
fn files_are_written_by_the_crate_that_keeps_old_ones() {
    let mut findings = Vec::new();
    for (name, text) in sources() {
        let is_test =
            name.contains("/tests/") || name.contains("/examples/") || name.ends_with("tests.rs");
        if is_test || MAY_WRITE.iter().any(|place| name.starts_with(place)) {
            continue;
        }
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for (number, line) in code.lines().enumerate() {
            let line = line.replace("cosplat_files::write(", "");
            let line = line.replace("NewFile::create(", "");
            if WRITES.iter().any(|way| line.contains(way)) {
                findings.push(format!("{name}:{}: {}", number + 1, line.trim()));
            }
        }
    }
    assert_clean(
        "use cosplat_files, which leaves the old file until the new one is complete",
        &findings,
    );
}
