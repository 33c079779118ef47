//! Scenes of PhysGaussian: `cosplat import` writes what `cosplat simulate` runs, and the six samples of the original do.

use std::{
    path::Path,
    process::{Command, Output},
};

use cosplat_physgaussian::{Options, import};
use cosplat_scene::{
    assets::{ReadReport, generate, ply},
    scene_file::{SceneFile, build},
};
use cosplat_sim_core::World;
use serde_json::Value;

use crate::samples::SAMPLES;

fn cosplat(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cosplat"))
        .args(args)
        .output()
        .expect("cosplat starts")
}

fn succeeds(args: &[&str]) -> Vec<Value> {
    let output = cosplat(args);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {errors}");
    let text = String::from_utf8(output.stdout).expect("text");
    let lines = text.lines();
    lines
        .map(|l| serde_json::from_str(l).expect("JSON"))
        .collect()
}

fn shown(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

/// 5 ms of each; the wolf has 99,950 substeps in 2 s. The whole runs are in docs/physgaussian.md.
#[test]
fn the_six_sample_settings_run() {
    const DURATION: f64 = 0.005;
    for (sample, fixed) in SAMPLES.iter().zip([50.0, 50.0, 50.0, 50.0, 50.0, 249.875]) {
        let name = sample.name;
        let model = sample.model();
        let options = Options {
            name: name.into(),
            asset: format!("{name}.ply"),
            compat: false,
            e_multiplier: None,
        };
        let imported =
            import(sample.config, &model, &options).unwrap_or_else(|e| panic!("{name}: {e}"));
        let part = DURATION / imported.duration;
        assert_eq!(imported.fixed_substeps as f64 * part, fixed, "{name}");
        let file = SceneFile::parse(&imported.scene).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut load = |_: &str| Ok((model.clone(), ReadReport::default()));
        let (scene, _) = build(&file, &mut load).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(scene.particles.position.len() > 5_000, "{name}");
        let mut world = World::new(scene).unwrap_or_else(|e| panic!("{name}: {e}"));
        let report = world.step(DURATION, &[]);
        assert!((report.sim_time - DURATION).abs() < 1e-9, "{name}");
        assert!(report.substeps >= 1 && report.rollbacks == 0, "{name}");
        assert!(report.left_domain.is_empty(), "{name}");
        assert!(report.quarantined.is_empty(), "{name}");
    }
}

#[test]
fn an_imported_scene_is_simulated() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| folder.path().join(name);
    let (config, model, out) = (file("vasedeck.json"), file("vasedeck.ply"), file("out"));
    let sample = SAMPLES.iter().find(|sample| sample.name == "vasedeck");
    let sample = sample.expect("listed");
    std::fs::write(&config, sample.config).expect("written");
    std::fs::write(&model, ply::write(&sample.model())).expect("written");
    let said = succeeds(&[
        "import",
        shown(&config),
        shown(&model),
        "-o",
        shown(&out),
        "--json",
    ]);
    let said = &said[0];
    assert_eq!(said["frames"], 75);
    assert_eq!(said["fixed_substeps"], 30_000);
    assert_eq!(said["duration"], 3.0);
    assert!(
        said["static_gaussians"].as_u64().expect("a count") > 100,
        "{said}"
    );
    let findings = said["findings"].as_array().expect("a list");
    for key in ["kind", "key", "old", "new", "message"] {
        assert!(findings[0].get(key).is_some(), "{key} in {}", findings[0]);
    }
    let scene = out.join("scene.toml");
    let frames = succeeds(&["simulate", shown(&scene), "--duration", "0.08"]);
    assert_eq!(frames.len(), 2);
    assert_eq!(frames[1]["quarantined"].as_array().map(Vec::len), Some(0));
    // The flower is turned by 1.9 rad/s and drags the stem along.
    assert!(frames[1]["kinetic_energy"].as_f64().expect("a number") > 0.0);
}

#[test]
fn a_bad_configuration_ends_with_status_2_and_every_error() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = folder.path().join("config.json");
    std::fs::write(&config, r#"{"nu": 0.7, "E": [1]}"#).expect("written");
    let model = folder.path().join("point_cloud.ply");
    let ply = generate::builtin("vase").expect("known");
    std::fs::write(&model, ply::write(&ply)).expect("written");
    let output = cosplat(&[
        "import",
        shown(&config),
        shown(folder.path()),
        "-o",
        shown(folder.path()),
    ]);
    assert_eq!(output.status.code(), Some(2));
    let errors = String::from_utf8_lossy(&output.stderr);
    for words in [
        "has 2 errors",
        "nu: is 0.7, expected 0 to 0.5",
        "E: is a list of 1, expected a number",
    ] {
        assert!(errors.contains(words), "{words:?} not in {errors}");
    }
}
