//! The dependency direction of the workspace: `matter <- rigid <- solid <- sim-core <- scene <- server -> ipc <- clients`.

use std::collections::BTreeSet;

use crate::root;

/// Every allowed edge between crates of the workspace; the root package may name them all.
const ALLOWED: &[(&str, &[&str])] = &[
    ("files", &[]),
    ("matter", &[]),
    ("rigid", &["cosplat-matter"]),
    ("solid", &["cosplat-matter", "cosplat-rigid"]),
    (
        "sim-core",
        &["cosplat-matter", "cosplat-rigid", "cosplat-solid"],
    ),
    ("reference", &["cosplat-sim-core", "cosplat-solid"]),
    (
        "scene",
        &["cosplat-files", "cosplat-sim-core", "cosplat-reference"],
    ),
    ("ipc", &[]),
    ("pacing", &["cosplat-ipc"]),
    (
        "server",
        &[
            "cosplat-files",
            "cosplat-sim-core",
            "cosplat-scene",
            "cosplat-ipc",
            "cosplat-pacing",
        ],
    ),
    ("raster", &[]),
    (
        "semantics",
        &["cosplat-files", "cosplat-raster", "cosplat-scene"],
    ),
    ("features", &["cosplat-files", "cosplat-semantics"]),
    (
        "clients/renderer",
        &["cosplat-files", "cosplat-ipc", "cosplat-raster"],
    ),
    ("clients/recorder", &["cosplat-files", "cosplat-ipc"]),
    ("clients/controller", &["cosplat-ipc"]),
    ("clients/web", &["cosplat-ipc", "cosplat-controller"]),
    (
        "replay",
        &[
            "cosplat-files",
            "cosplat-sim-core",
            "cosplat-scene",
            "cosplat-ipc",
            "cosplat-pacing",
            "cosplat-server",
            "cosplat-recorder",
        ],
    ),
    (
        "clients/export",
        &[
            "cosplat-files",
            "cosplat-ipc",
            "cosplat-recorder",
            "cosplat-renderer",
            "cosplat-replay",
        ],
    ),
    ("console", &[]),
    (
        "objects",
        &[
            "cosplat-files",
            "cosplat-console",
            "cosplat-ipc",
            "cosplat-matter",
            "cosplat-renderer",
            "cosplat-scene",
            "cosplat-semantics",
            "cosplat-web",
        ],
    ),
    (
        "demo",
        &[
            "cosplat-files",
            "cosplat-export",
            "cosplat-ipc",
            "cosplat-renderer",
            "cosplat-scene",
            "cosplat-semantics",
            "cosplat-server",
            "cosplat-sim-core",
        ],
    ),
    (
        "importers/physgaussian",
        &["cosplat-files", "cosplat-scene"],
    ),
    (
        "bench",
        &[
            "cosplat",
            "cosplat-console",
            "cosplat-sim-core",
            "cosplat-ipc",
            "cosplat-reference",
            "cosplat-scene",
            "cosplat-server",
            "cosplat-recorder",
        ],
    ),
    (
        "fuzz",
        &[
            "cosplat-sim-core",
            "cosplat-scene",
            "cosplat-semantics",
            "cosplat-ipc",
            "cosplat-server",
            "cosplat-recorder",
            "cosplat-replay",
            "cosplat-physgaussian",
        ],
    ),
    ("tests/tidy", &[]),
];

/// Crates that only these members may name: transport and file formats stay out of the solver, the solver out of the clients.
const FENCED: &[(&str, &[&str])] = &[
    ("iceoryx2", &["ipc", "bench"]),
    ("mcap", &["clients/recorder"]),
    ("rten", &["features"]),
    ("rten-tensor", &["features"]),
    ("stl_io", &["scene"]),
    ("tobj", &["scene"]),
    (
        "toml",
        &[
            "scene",
            "features",
            "clients/controller",
            "importers/physgaussian",
            "bench",
            "tests/tidy",
        ],
    ),
];

/// Folders of the crates of the workspace.
pub(crate) fn members() -> Vec<String> {
    ALLOWED
        .iter()
        .map(|(member, _)| (*member).to_owned())
        .collect()
}

fn manifest(member: &str) -> toml::Table {
    let path = root().join(member).join("Cargo.toml");
    let text = std::fs::read_to_string(&path).expect("manifest is readable");
    text.parse().expect("manifest is TOML")
}

fn dependencies(member: &str) -> BTreeSet<String> {
    let manifest = manifest(member);
    ["dependencies", "build-dependencies", "dev-dependencies"]
        .iter()
        .filter_map(|table| manifest.get(*table)?.as_table())
        .flat_map(|table| table.keys().cloned())
        .collect()
}

#[test]
fn crates_depend_only_in_the_allowed_direction() {
    for (member, allowed) in ALLOWED {
        let ours: Vec<_> = dependencies(member)
            .into_iter()
            .filter(|d| d.starts_with("cosplat"))
            .collect();
        for dependency in ours {
            assert!(
                allowed.contains(&dependency.as_str()),
                "{member} depends on {dependency}; allowed: {allowed:?}"
            );
        }
    }
}

#[test]
fn every_member_is_in_the_table() {
    let root = manifest("");
    let members = root["workspace"]["members"]
        .as_array()
        .expect("members is a list");
    let listed: BTreeSet<_> = members.iter().filter_map(|m| m.as_str()).collect();
    let table: BTreeSet<_> = ALLOWED.iter().map(|(member, _)| *member).collect();
    assert_eq!(listed, table);
}

#[test]
fn transport_and_formats_stay_behind_their_fence() {
    for (fenced, owners) in FENCED {
        for (member, _) in ALLOWED {
            assert!(
                owners.contains(member) || !dependencies(member).contains(*fenced),
                "{member} names {fenced}, which belongs to {owners:?}"
            );
        }
    }
}

#[test]
fn versions_live_in_the_workspace_table() {
    for member in ALLOWED.iter().map(|(member, _)| *member).chain([""]) {
        let manifest = manifest(member);
        for table in ["dependencies", "dev-dependencies"] {
            let Some(table) = manifest.get(table).and_then(|t| t.as_table()) else {
                continue;
            };
            for (name, value) in table {
                let inherits = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
                assert!(
                    inherits,
                    "{member}/Cargo.toml: {name} does not inherit its version from the workspace"
                );
            }
        }
    }
}
