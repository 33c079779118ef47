//! Which module of a crate names which: read from the paths in its code.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::{files, shown};

/// Names from the root of a crate to a module; the root itself has none.
type ModulePath = Vec<String>;

/// The modules of a crate, without tests.
pub(crate) struct Modules {
    /// Code of each module's file, comments and strings aside.
    code: BTreeMap<ModulePath, String>,
    /// Modules whose items a module hands on under its own name.
    handed_on: BTreeMap<(ModulePath, String), ModulePath>,
}

/// Code without comments and without what stands in quotes.
fn stripped(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests {").next();
    let lines = code.unwrap_or_default().lines().map(|line| {
        let line = line.split("//").next().unwrap_or_default();
        let outside: Vec<&str> = line.split('"').step_by(2).collect();
        outside.join("\"\"")
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// The word that some code begins with.
fn word(code: &str) -> &str {
    let end = code.find(|c: char| !c.is_alphanumeric() && c != '_');
    &code[..end.unwrap_or(code.len())]
}

/// Adds all paths of a `use` tree or of a path in an expression, from `before` on, and returns what follows it.
fn paths<'a>(code: &'a str, before: &[&'a str], found: &mut Vec<Vec<&'a str>>) -> &'a str {
    let mut path = before.to_vec();
    let mut rest = code.trim_start();
    loop {
        if let Some(mut list) = rest.strip_prefix('{') {
            loop {
                list = list.trim_start().trim_start_matches(',').trim_start();
                if let Some(after) = list.strip_prefix('}') {
                    return after;
                }
                let after = paths(list, &path, found);
                if after.len() == list.len() {
                    return after;
                }
                list = after;
            }
        }
        let name = word(rest);
        if name.is_empty() {
            let after = rest.strip_prefix('*');
            path.push("*");
            found.push(path);
            return after.unwrap_or(rest);
        }
        path.push(name);
        rest = &rest[name.len()..];
        let Some(after) = rest.strip_prefix("::") else {
            found.push(path);
            let renamed = rest.trim_start().strip_prefix("as ");
            return renamed.map_or(rest, |rest| &rest[word(rest).len()..]);
        };
        rest = after.trim_start();
    }
}

/// All paths of some code that begin with one of `starts`.
fn paths_from<'a>(code: &'a str, starts: &[&str]) -> Vec<Vec<&'a str>> {
    let mut found = Vec::new();
    for start in starts {
        for (at, _) in code.match_indices(&format!("{start}::")) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || "_:".contains(c)) {
                continue;
            }
            paths(&code[at..], &[], &mut found);
        }
    }
    found
}

impl Modules {
    /// The modules below a folder of sources.
    pub(crate) fn of_sources(source: &Path) -> Self {
        let rust = files(source, &|path| path.extension().is_some_and(|e| e == "rs"));
        let texts = rust.iter().filter_map(|path| {
            let inner = path.strip_prefix(source).expect("a file below its folder");
            let inner = inner.to_string_lossy().into_owned();
            let is_test = inner.contains("tests/") || inner.ends_with("tests.rs");
            let text =
                || std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", shown(path)));
            (!is_test && inner != "main.rs").then(|| (inner, text()))
        });
        Self::of_texts(texts)
    }

    /// The modules of files, each with its path inside the folder of sources.
    pub(crate) fn of_texts(texts: impl Iterator<Item = (String, String)>) -> Self {
        let code = texts.map(|(inner, text)| {
            let mut path: ModulePath = inner
                .trim_end_matches(".rs")
                .split('/')
                .map(str::to_owned)
                .collect();
            if path
                .last()
                .is_some_and(|name| name == "mod" || path.len() == 1 && name == "lib")
            {
                path.pop();
            }
            (path, stripped(&text))
        });
        let mut modules = Self {
            code: code.collect(),
            handed_on: BTreeMap::new(),
        };
        modules.find_handed_on();
        modules
    }

    /// Finds what modules hand on: `pub use` of a module below them or of another one.
    fn find_handed_on(&mut self) {
        let mut found = BTreeMap::new();
        for (module, code) in &self.code {
            for (at, _) in code.match_indices("use ") {
                let line = code[..at].rsplit('\n').next().unwrap_or_default();
                if !line.trim_start().starts_with("pub") {
                    continue;
                }
                let mut named = Vec::new();
                paths(&code[at + 4..], &[], &mut named);
                for path in named {
                    let Some(item) = path.last() else { continue };
                    let from = self.resolved(module, &path);
                    if let Some(from) = from.filter(|from| from != module) {
                        found.insert((module.clone(), (*item).to_owned()), from);
                    }
                }
            }
        }
        self.handed_on = found;
    }

    /// The module whose item a path names that stands in `module`; nothing when it leads out of the crate.
    fn resolved(&self, module: &ModulePath, path: &[&str]) -> Option<ModulePath> {
        let mut at = module.clone();
        let mut names = path.iter().peekable();
        let is_child = |at: &ModulePath, name: &str| {
            let mut child = at.clone();
            child.push(name.to_owned());
            self.code.contains_key(&child).then_some(child)
        };
        match *names.peek()? {
            &"crate" => {
                at.clear();
                names.next();
            }
            &"super" => {
                while names.next_if(|name| **name == "super").is_some() {
                    at.pop()?;
                }
            }
            &"self" => {
                names.next();
            }
            name => {
                is_child(&at, name)?;
            }
        }
        for name in names {
            if let Some(child) = is_child(&at, name) {
                at = child;
            } else if let Some(from) = self.handed_on.get(&(at.clone(), (*name).to_owned())) {
                at.clone_from(from);
            } else {
                break;
            }
        }
        Some(at)
    }

    /// Per folder, as the path of its module, which of its parts names which; a part is a file or a folder with all below.
    fn arrows(&self) -> BTreeMap<ModulePath, BTreeMap<String, BTreeSet<String>>> {
        let mut arrows: BTreeMap<_, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
        for (module, code) in &self.code {
            for path in paths_from(code, &["crate", "super"]) {
                let Some(other) = self.resolved(module, &path) else {
                    continue;
                };
                let shared = module
                    .iter()
                    .zip(&other)
                    .take_while(|(a, b)| a == b)
                    .count();
                if let (Some(from), Some(to)) = (module.get(shared), other.get(shared)) {
                    let folder = arrows.entry(module[..shared].to_vec()).or_default();
                    folder.entry(from.clone()).or_default().insert(to.clone());
                }
            }
        }
        arrows
    }

    /// Circles of parts of one folder that name each other, each as the folder's path and its parts.
    pub(crate) fn circles(&self) -> Vec<(String, Vec<String>)> {
        let mut found = Vec::new();
        for (folder, arrows) in self.arrows() {
            for circle in circles(&arrows) {
                found.push((folder.join("/"), circle));
            }
        }
        found
    }
}

/// All that is reached from a part.
fn reached(arrows: &BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut open: Vec<&String> = arrows.get(from).into_iter().flatten().collect();
    while let Some(name) = open.pop() {
        if reached.insert(name.clone()) {
            open.extend(arrows.get(name).into_iter().flatten());
        }
    }
    reached
}

/// Groups of at least two parts that reach each other.
fn circles(arrows: &BTreeMap<String, BTreeSet<String>>) -> Vec<Vec<String>> {
    let reach: BTreeMap<&String, _> = arrows
        .keys()
        .map(|name| (name, reached(arrows, name)))
        .collect();
    let mut found: Vec<Vec<String>> = Vec::new();
    for (name, others) in &reach {
        if found.iter().any(|circle| circle.contains(name)) {
            continue;
        }
        let is_mutual =
            |other: &&&String| others.contains(**other) && reach[*other].contains(*name);
        let circle: Vec<String> = reach
            .keys()
            .filter(is_mutual)
            .map(|n| (*n).clone())
            .collect();
        if circle.len() > 1 {
            found.push(circle);
        }
    }
    found
}

#[test]
fn circles_are_found_through_folders_and_what_is_handed_on() {
    let source = |name: &str, code: &str| (name.to_owned(), code.to_owned());
    let found = |sources: &[(String, String)]| Modules::of_texts(sources.iter().cloned()).circles();
    let straight = [
        source("lib.rs", "pub use b::{B, C};\nmod a; mod b; mod c;"),
        source("a.rs", "use crate::{\n    B, c::deep::D,\n}; // crate::a"),
        source("b.rs", "use super::Own;"),
        source("c/mod.rs", "use crate::b::B;"),
        source(
            "c/deep.rs",
            "fn f() { super::own(); let text = \"crate::a\"; }",
        ),
    ];
    assert_eq!(found(&straight), []);
    let mut round = straight.clone();
    round[2] = source("b.rs", "use super::a::A;");
    let all = ["a", "b", "c"].map(str::to_owned).to_vec();
    assert_eq!(found(&round), [(String::new(), all)]);
    let mut inside = straight.clone();
    inside[3] = source("c/mod.rs", "pub use other::O;");
    inside[4] = source("c/deep.rs", "use super::O;");
    let inside = [
        &inside[..],
        &[source("c/other.rs", "use crate::c::deep::D as E;")],
    ]
    .concat();
    let two = ["deep", "other"].map(str::to_owned).to_vec();
    assert_eq!(found(&inside), [("c".to_owned(), two)]);
}
