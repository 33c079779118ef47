//! The scene reference and the example scenes say what is true.

use std::{
    fs,
    path::{Path, PathBuf},
};

use cosplat_scene::{
    assets::{self, Gaussians},
    load::{LoadedScene, load_scene, load_text},
    scene_file::{Axis, DropOptions, SceneErrors, SceneFile, drop_scene, guess_up},
    summary::SceneSummary,
};
use cosplat_sim_core::scene::{Fidelity, Scene};

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

fn reference() -> String {
    fs::read_to_string(root().join("docs/scene.md")).expect("the reference is readable")
}

fn example() -> String {
    let text = reference();
    let (_, rest) = text.split_once("```toml\n").expect("an example");
    let (example, _) = rest.split_once("```").expect("the end of the example");
    example.to_owned()
}

fn loaded(path: &Path) -> LoadedScene {
    load_scene(path).unwrap_or_else(|e| panic!("{e}"))
}

fn scenes() -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for folder in ["scenes", "scenes/paper"] {
        let entries = fs::read_dir(root().join(folder)).expect("scenes are readable");
        paths.extend(entries.map(|e| e.expect("an entry").path()));
    }
    // Some show captures that are not part of cosplat.
    let is_capture = |p: &Path| {
        let text = fs::read_to_string(p).unwrap_or_default();
        text.contains("is not part of cosplat")
    };
    // Scripts for the controller lie beside their scenes.
    let is_script = |p: &Path| {
        p.file_stem()
            .is_some_and(|s| s.to_string_lossy().ends_with("_push"))
    };
    paths.retain(|p| p.extension().is_some_and(|e| e == "toml") && !is_script(p) && !is_capture(p));
    paths.sort();
    paths
}

#[test]
fn the_example_of_the_reference_is_a_scene() {
    let loaded = load_text(example(), Path::new("docs/scene.md")).unwrap_or_else(|e| panic!("{e}"));
    let names: Vec<&str> = loaded
        .scene
        .objects
        .iter()
        .map(|o| o.name.as_str())
        .collect();
    assert_eq!(names, ["body", "neck", "ball", "second ball", "table"]);
    assert_eq!(loaded.scene.probes.len(), 3);
    // The neck is a thin wall, and says so; nothing else is suspicious.
    for warning in &loaded.report.warnings {
        assert!(warning.message.contains("thin"), "{warning}");
    }
}

/// Keys that the parser knows in a table: it lists them all for a key that resembles none.
fn known_keys(text: &str) -> Vec<String> {
    let SceneErrors(errors) = SceneFile::parse(text).expect_err("an unknown key");
    let unknown = errors.iter().find(|e| e.at.field.ends_with("qqqq"));
    let message = &unknown.unwrap_or_else(|| panic!("{errors:?}")).message;
    let keys: Vec<String> = message
        .split('`')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect();
    assert!(keys.len() > 1, "{message}");
    keys
}

#[test]
fn the_reference_names_every_key() {
    let reference = reference();
    let tables = [
        "qqqq = 1",
        "[[assets]]\nqqqq = 1",
        "[[objects]]\nqqqq = 1",
        "[[objects]]\nshape = { qqqq = 1 }",
        "[[objects]]\ncoherence = { qqqq = 1, rate = 1 }",
        "[[objects]]\npath = \"x\"\nselect = { qqqq = 1, component = 0 }",
        "[[objects]]\npath = \"x\"\nsplit = { qqqq = 1, by = \"components\" }",
        "[materials.m]\nqqqq = 1",
        "[[colliders]]\nqqqq = 1",
        "[[colliders]]\nshape = \"box\"\nqqqq = 1",
        "[[colliders]]\nshape = \"capsule\"\nqqqq = 1",
        "[[colliders]]\nshape = \"mesh\"\nqqqq = 1",
        "[[colliders]]\nmotion = { qqqq = 1 }",
        "[[pinned_regions]]\nqqqq = 1",
        "[[prescribed]]\nqqqq = 1",
        "[[impulses]]\nqqqq = 1",
        "[[releases]]\nqqqq = 1",
        "[[probes]]\nqqqq = 1",
        "[domain]\nqqqq = 1",
        "[view]\nqqqq = 1",
    ];
    for table in tables {
        for key in known_keys(table) {
            assert!(
                reference.contains(&format!("`{key}`")),
                "docs/scene.md does not name `{key}` of {table:?}"
            );
        }
    }
}

#[test]
fn every_example_scene_builds_without_errors() {
    let paths = scenes();
    assert!(paths.len() >= 5, "{paths:?}");
    for path in paths {
        let loaded = loaded(&path);
        let summary = SceneSummary::new(&loaded.scene);
        assert!(summary.particles > 0, "{}", path.display());
        check_invariants(&loaded.scene, &path);
        for warning in &loaded.report.warnings {
            assert!(
                warning.message.contains("thin"),
                "{}: {warning}",
                path.display()
            );
        }
    }
}

/// What the solver and the wire rely on.
fn check_invariants(scene: &Scene, path: &Path) {
    let g: &Gaussians = &scene.gaussians;
    assert_eq!(scene.binding.weight.len(), g.len(), "{}", path.display());
    assert_eq!(g.sh.len(), g.len() * g.sh_stride());
    let (mut particle, mut gaussian) = (0, 0);
    for object in &scene.objects {
        assert_eq!(object.particles.start, particle);
        assert_eq!(object.gaussians.start, gaussian);
        (particle, gaussian) = (object.particles.end, object.gaussians.end);
        for i in object.gaussians.clone() {
            let sum: f32 = scene.binding.weight[i].iter().sum();
            match object.fidelity {
                Fidelity::Static => assert_eq!(sum, 0.0),
                // Eight single-precision weights.
                Fidelity::Mpm | Fidelity::Auto | Fidelity::Rigid => {
                    assert!((sum - 1.0).abs() < 1e-5);
                    let ids = &scene.binding.particle[i];
                    let own = |p: &u32| object.particles.contains(&(*p as usize));
                    assert!(ids.iter().all(own), "{}: {}", path.display(), object.name);
                }
            }
        }
    }
    assert_eq!(particle, scene.particles.position.len());
    assert_eq!(gaussian, g.len());
}

#[test]
fn the_demo_scene_stays_within_its_budget() {
    let loaded = loaded(&root().join("scenes/two_vases.toml"));
    let summary = SceneSummary::new(&loaded.scene);
    // Two cores, four processes: what the solver can do in real time beside the renderer. Solids have eight points per cell.
    assert!(summary.particle_updates_per_second < 1e7, "{summary:?}");
    let height = |i: usize| summary.objects[i].gaussian_box.expect("visible").size[1];
    assert!((0.2..0.35).contains(&height(0)) && (0.2..0.35).contains(&height(1)));
    let velocities = loaded.scene.objects.iter().map(|o| o.linear_velocity);
    assert!(
        velocities.into_iter().all(|v| v == [0.0; 3]),
        "pushed by a command"
    );
}

/// A real splat, or `None` after saying why the test is skipped.
fn real_splat(test: &str, name: &str) -> Option<PathBuf> {
    let given = std::env::var_os("COSPLAT_TEST_DATA");
    let folder = given.map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    let why = format!("{} does not exist", path.display());
    assert!(
        std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(),
        "{test}: {why}"
    );
    eprintln!("SKIPPED: {test}: {why}");
    None
}

#[test]
fn real_splats_drop_as_solids_of_one_metre_in_real_time() {
    // Up is known from looking at them: all three stand upside down in their files.
    for name in ["plant.splat", "playbot_lod3.ply", "spot_10k.splat"] {
        let Some(path) = real_splat("real_splats_drop", name) else {
            return;
        };
        let bytes = fs::read(&path).expect("the splat is readable");
        let (gaussians, _) = assets::read(name, &bytes).expect("a splat");
        assert_eq!(guess_up(&gaussians), Axis::NegY, "{name}");
        let path = path.to_str().expect("a path in UTF-8");
        let text = drop_scene(&gaussians, path, &DropOptions::default());
        let text = text.unwrap_or_else(|e| panic!("{name}: {e}"));
        let loaded = load_text(text, Path::new("drop.toml")).unwrap_or_else(|e| panic!("{e}"));
        let summary = SceneSummary::new(&loaded.scene);
        check_invariants(&loaded.scene, Path::new(name));
        let object = &summary.objects[0];
        let body = object.body.as_ref().expect("simulated");
        assert!(
            (2_000..=10_000).contains(&body.particles),
            "{name}: {} particles",
            body.particles
        );
        // Two cores beside renderer and recorder; see the constants of `drop_scene`.
        let cost = summary.particle_updates_per_second;
        assert!(cost < 1.1e7, "{name}: {cost} particle-substeps/s");
        let height = object.gaussian_box.expect("visible").size[1];
        // Quantiles leave a rim of at most a tenth on either side.
        assert!((0.98..1.25).contains(&height), "{name}: {height} m");
        assert!(
            body.particle_box.min[1] > 0.0,
            "{name}: starts in the floor"
        );
    }
}
