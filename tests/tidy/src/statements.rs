//! What documents say of the code, compared with it.

use crate::{assert_clean, files, root};

/// Text of a file of the checkout.
fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).expect("a file of the checkout")
}

/// Code spans of a text.
fn spans(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// The part of a text from `begin` to the first `end` after it.
fn between<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    let (_, rest) = text.split_once(begin).expect("the begin of the part");
    rest.split_once(end).expect("the end of the part").0
}

/// Words of the first words of lines that begin with `keyword`.
fn declared<'a>(text: &'a str, keyword: &'a str) -> impl Iterator<Item = &'a str> {
    text.lines().filter_map(move |line| {
        let rest = line.strip_prefix(keyword)?;
        rest.split(|c: char| !c.is_alphanumeric() && c != '_')
            .next()
    })
}

#[test]
fn every_order_of_python_is_named_for_its_users() {
    let orders = text("clients/python/src/cosplat/orders.py");
    let page = text("docs/attach-a-client.md");
    let list = between(&page, "- An order is a dataclass", "\n\n");
    let names: Vec<&str> = declared(&orders, "class ")
        .filter(|name| !name.starts_with('_') && !["Ack", "Order"].contains(name))
        .collect();
    assert!(
        names.len() > 20,
        "orders.py declares {} orders",
        names.len()
    );
    let missing: Vec<String> = names
        .iter()
        .filter(|name| !spans(list).any(|span| span == **name))
        .map(|name| (*name).to_owned())
        .collect();
    assert_clean("not in docs/attach-a-client.md", &missing);
    let unknown: Vec<String> = spans(list)
        .filter(|span| span.starts_with(char::is_uppercase) && !names.contains(span))
        .map(str::to_owned)
        .collect();
    assert_clean("not in orders.py", &unknown);
}

#[test]
fn every_level_of_an_object_is_explained() {
    let report = text("sim-core/src/report.rs");
    let levels = between(&report, "pub enum Level {", "\n}");
    let [scene, wire] = ["docs/scene.md", "docs/wire-format.md"].map(text);
    let said = between(&scene, "`level` says how it is modelled now:", "\n  - ");
    let coded = between(&wire, "Its `fidelity` says", "The header");
    let mut findings = Vec::new();
    let mut count = 0;
    for line in levels.lines() {
        let Some((name, number)) = line.trim().trim_end_matches(',').split_once(" = ") else {
            continue;
        };
        count += 1;
        if !spans(said).any(|span| span == name.to_lowercase()) {
            findings.push(format!("docs/scene.md: {name}"));
        }
        let is_coded = coded
            .split_whitespace()
            .any(|word| word.trim_end_matches(',') == number);
        if !is_coded {
            findings.push(format!("docs/wire-format.md: {number} ({name})"));
        }
    }
    assert!(count > 5, "{count} levels found in report.rs");
    assert_clean("levels without a word", &findings);
}

#[test]
fn sizes_in_decisions_are_those_of_the_wire() {
    let layout = text("ipc/src/schema/layout.rs");
    let size = between(&layout, "\"cosplat.v1.Status\" Status: ", " ");
    let decision = text("docs/decisions/0003-status-is-publish-subscribe.md");
    assert!(
        decision.contains(&format!("is {size} bytes")),
        "a status has {size} bytes"
    );
}

/// Functions of types, as the walks of ARCHITECTURE.md name them.
#[test]
fn functions_of_types_in_the_walks_exist() {
    let page = text("ARCHITECTURE.md");
    let walks = between(&page, "## Three walks", "## One frame");
    let sources: Vec<String> = files(root(), &|path| path.extension().is_some_and(|e| e == "rs"))
        .iter()
        .map(|path| std::fs::read_to_string(path).expect("source is readable"))
        .collect();
    let has = |source: &str, function: &str| {
        ["(", "<"]
            .iter()
            .any(|next| source.contains(&format!("fn {function}{next}")))
    };
    let mut count = 0;
    let mut findings = Vec::new();
    for (kind, function) in spans(walks).filter_map(|span| span.split_once("::")) {
        if !kind.starts_with(char::is_uppercase) {
            continue;
        }
        count += 1;
        let declares = |source: &&String| {
            ["impl ", "> "]
                .iter()
                .any(|before| source.contains(&format!("{before}{kind}")))
        };
        if !sources
            .iter()
            .filter(declares)
            .any(|source| has(source, function))
        {
            findings.push(format!("{kind}::{function}"));
        }
    }
    assert!(count > 10, "{count} functions found in the walks");
    assert_clean("named by ARCHITECTURE.md and not in the code", &findings);
}
