//! Laws of mechanics, seen from outside: `cosplat simulate` on scene files, held to closed forms.

mod batch;
mod conservation;
mod determinism;
mod free_fall;
mod incline;
mod physgaussian;
mod pushed;
mod samples;
mod sayable;

use std::process::{Command, Output};

use serde_json::Value;

/// A finished run of `cosplat simulate`.
struct Run {
    /// The report as printed, one JSON line per frame.
    text: String,
    /// The same, parsed.
    frames: Vec<Value>,
}

/// Simulates a scene file with this text.
fn simulate(scene: &str, duration: f64, options: &[&str]) -> Run {
    let output = cosplat_simulate(scene, duration, options);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cosplat simulate failed: {errors}");
    let text = String::from_utf8(output.stdout).expect("the report is text");
    let frames: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).expect("every line is JSON"))
        .collect();
    for frame in &frames {
        for field in ["left_domain", "quarantined"] {
            assert_eq!(
                frame[field].as_array().map(Vec::len),
                Some(0),
                "{field}: {frame}"
            );
        }
    }
    Run { text, frames }
}

/// Runs `cosplat simulate` on a scene file with this text, report to standard output.
fn cosplat_simulate(scene: &str, duration: f64, options: &[&str]) -> Output {
    let duration = duration.to_string();
    let own = ["--duration", &duration, "--report", "-"];
    cosplat("simulate", scene, &[&own, options].concat())
}

/// Runs a subcommand on a scene file with this text.
fn cosplat(command: &str, scene: &str, options: &[&str]) -> Output {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, scene).expect("the scene is written");
    Command::new(env!("CARGO_BIN_EXE_cosplat"))
        .arg(command)
        .arg(&path)
        .args(options)
        .output()
        .expect("cosplat starts")
}

impl Run {
    fn first(&self) -> &Value {
        self.frames.first().expect("at least one frame")
    }

    fn last(&self) -> &Value {
        self.frames.last().expect("at least one frame")
    }

    /// Substeps of the whole run.
    fn substeps(&self) -> f64 {
        self.frames.iter().map(|f| number(&f["substeps"])).sum()
    }
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("a number, got {value}"))
}

fn vector(value: &Value) -> [f64; 3] {
    std::array::from_fn(|i| number(&value[i]))
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    norm(std::array::from_fn(|i| a[i] - b[i]))
}
