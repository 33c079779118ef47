//! Readers against what other programs write: models by `pycolmap`, COLMAP's own writer.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use cosplat_semantics::colmap;
use glam::Vec3;
use serde_json::Value;

const PACKAGE: &str = "pycolmap==4.2.1";

/// An interpreter with the package, in an environment below the target folder.
fn environment() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-colmap");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output();
        output.is_ok_and(|output| output.status.success())
    };
    let install = ["-m", "pip", "install", "--quiet", PACKAGE, "numpy"];
    let make = ["-m", "venv", &folder.to_string_lossy()];
    let is_ready = run(&python, &["-c", "import pycolmap, numpy"])
        || (run(Path::new("python3"), &make) && run(&python, &install));
    is_ready.then_some(python)
}

#[test]
fn models_that_colmap_writes_are_read_as_it_projects() {
    let Some(python) = environment() else {
        let why = format!("needs python3 with venv and {PACKAGE}");
        assert!(std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(), "{why}");
        eprintln!("SKIPPED: models_that_colmap_writes_are_read_as_it_projects: {why}");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let output = Command::new(python)
        .args(["-c", include_str!("colmap.py")])
        .arg(folder.path())
        .output()
        .expect("started");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let number = |value: &Value| value.as_f64().expect("a number");
    let points = told["points"].as_array().expect("points");
    for form in ["text", "binary"] {
        let model = folder.path().join(form);
        assert!(colmap::is_model(&model));
        let views = colmap::read(&model).expect("readable");
        assert_eq!(views.len(), 6, "{form}");
        for view in views {
            let seen = &told["seen"][&view.name];
            let size = [view.camera.width, view.camera.height].map(f64::from);
            assert_eq!(size, [number(&seen[0]), number(&seen[1])], "{}", view.name);
            for (k, point) in points.iter().enumerate() {
                let at = [0, 1, 2].map(|axis| number(&point[axis]) as f32);
                let (x, y, _) = view.camera.project(Vec3::from_array(at));
                for (axis, pixel) in [x, y].into_iter().enumerate() {
                    let exact = number(&seen[2][k][axis]);
                    // f32 of coordinates of some hundred pixels.
                    let off = (f64::from(pixel) - exact).abs();
                    assert!(off < 2e-3, "{form}, {}: {pixel} {exact}", view.name);
                }
            }
        }
    }
}
