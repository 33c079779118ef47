//! What `cosplat simulate` and `cosplat explain` promise to those who call them from scripts.

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

use serde_json::Value;

const SCENE: &str = r#"version = 1
dx = 0.05
[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.1 }
material = "jelly"
[[colliders]]
name = "floor"
point = [0, -0.2, 0]
normal = [0, 1, 0]
[[probes]]
name = "ball box"
kind = "extent"
object = "ball"
[[probes]]
name = "far away"
kind = "point"
position = [0.5, 0, 0]
"#;

fn cosplat(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cosplat"))
        .args(args)
        .output()
        .expect("cosplat starts")
}

/// A folder with a scene file of this text.
fn folder(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("the scene is written");
    (folder, path)
}

fn shown(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

fn json(text: &[u8]) -> Value {
    serde_json::from_slice(text).expect("JSON")
}

#[test]
fn a_bad_scene_file_ends_with_status_2_and_every_error() {
    let text = SCENE
        .replace("jelly", "jely")
        .replace("dx = 0.05", "dx = -1");
    let (_folder, path) = folder(&text);
    for command in ["simulate", "explain"] {
        let mut args = vec![command, shown(&path)];
        if command == "simulate" {
            args.extend(["--duration", "1"]);
        }
        let output = cosplat(&args);
        assert_eq!(output.status.code(), Some(2), "{command}");
        assert!(output.stdout.is_empty(), "{command}");
        let errors = String::from_utf8_lossy(&output.stderr);
        for words in [
            "scene.toml has 2 errors",
            "line 2, column 6: dx:",
            "line 6, column 12: objects[0].material:",
            "did you mean `jelly`?",
        ] {
            assert!(errors.contains(words), "{words:?} not in {errors}");
        }
    }
}

/// First column of the report table in the reference of scene files.
fn documented_fields() -> Vec<String> {
    let text = include_str!("../../docs/scene.md");
    let (_, report) = text
        .split_once("## The report of cosplat simulate")
        .expect("the section exists");
    let rows = report.lines().filter(|l| l.starts_with("| `"));
    let names = rows.flat_map(|row| {
        let column = row.split('|').nth(1).unwrap_or_default();
        column.split('`').skip(1).step_by(2).collect::<Vec<_>>()
    });
    names.map(str::to_owned).collect()
}

#[test]
fn a_report_line_has_exactly_the_documented_fields() {
    let (folder, path) = folder(SCENE);
    let report = folder.path().join("out.jsonl");
    let output = cosplat(&[
        "simulate",
        shown(&path),
        "--duration",
        "0.05",
        "--report",
        shown(&report),
        "--json",
    ]);
    assert!(output.status.success(), "{output:?}");
    let text = std::fs::read_to_string(&report).expect("the report exists");
    let lines: Vec<Value> = text.lines().map(|l| json(l.as_bytes())).collect();
    assert_eq!(lines.len(), 3);
    let mut fields: Vec<&String> = lines[0].as_object().expect("an object").keys().collect();
    let mut documented = documented_fields();
    fields.sort();
    documented.sort();
    assert_eq!(fields, documented.iter().collect::<Vec<_>>());
    assert!(lines[2]["probes"]["ball box"]["max"][1].is_number());
    assert!(lines[2]["probes"]["far away"].is_null());
    assert_eq!(lines[2]["objects"][0]["name"], "ball");

    let summary = json(&output.stdout);
    assert_eq!(summary["frames"], 3);
    assert_eq!(summary["state_hash"], lines[2]["state_hash"]);
}

#[test]
fn explain_says_what_the_scene_weighs_and_draws_it() {
    let (folder, path) = folder(SCENE);
    let picture = folder.path().join("scene.ply");
    let output = cosplat(&["explain", shown(&path), "--json", "--ply", shown(&picture)]);
    assert!(output.status.success(), "{output:?}");
    let said = json(&output.stdout);
    let ball = &said["objects"][0];
    // 4/3 pi 0.1^3 at jelly's 1020 kg/m^3.
    let mass = ball["mass"].as_f64().expect("a mass");
    assert!((mass - 4.272566).abs() < 1e-5, "{mass}");
    assert_eq!(said["colliders"][0]["surface"], "separate");
    let bytes = std::fs::read(&picture).expect("the picture exists");
    let (drawn, _) = cosplat_scene::assets::read("scene.ply", &bytes).expect("a splat");
    let shown = said["gaussians"].as_u64().expect("a count") as usize;
    assert!(drawn.len() > shown + 500, "{} of {shown}", drawn.len());
}

#[test]
fn explain_says_when_a_scene_would_be_refused() {
    // Only matter that nothing drives can come to rest before time 0.
    let (_folder, path) = folder(SCENE);
    let settled = ["explain", shown(&path), "--json", "--set", "settle=0.1"];
    let said = json(&cosplat(&settled).stdout);
    assert_eq!(said["warnings"].as_array().map(Vec::len), Some(0), "{said}");
    let driven = "objects.0.body_force=[\"0\", \"sin(t)\", \"0\"]";
    let output = cosplat(&[&settled[..], &["--set", driven]].concat());
    assert!(output.status.success(), "{output:?}");
    let warning = json(&output.stdout)["warnings"][0].to_string();
    assert!(warning.contains("cannot be simulated"), "{warning}");
    assert!(warning.contains("settle"), "{warning}");
}

#[test]
fn closing_the_pipe_early_is_no_failure() {
    use std::{
        io::{BufRead, BufReader},
        process::Stdio,
    };
    let (_folder, path) = folder(SCENE);
    // Some 600 lines of 1.5 kB: more than a pipe holds.
    let mut child = Command::new(env!("CARGO_BIN_EXE_cosplat"))
        .args(["simulate", shown(&path), "--duration", "10"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("cosplat starts");
    let mut out = BufReader::new(child.stdout.take().expect("piped"));
    let mut line = String::new();
    out.read_line(&mut line).expect("a line");
    drop(out);
    assert_eq!(json(line.as_bytes())["step"], 1);
    assert!(child.wait().expect("it ends").success());
}
