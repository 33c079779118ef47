//! Stories about scene files: what is wrong is all said at once, and what is right becomes a scene.

use cosplat_sim_core::scene::{Fidelity, Scene, Solver};

use super::*;
use crate::assets::{Gaussians, ReadReport};

/// Findings as `(line, field, message)`.
fn errors(text: &str) -> Vec<(usize, String, String)> {
    let SceneErrors(findings) = SceneFile::parse(text).expect_err("the file is wrong");
    let parts = |f: Finding| (f.at.line, f.at.field, f.message);
    findings.into_iter().map(parts).collect()
}

/// Panics unless there is exactly one error, at that line and field, that says all the words.
fn assert_one_error(text: &str, line: usize, field: &str, words: &[&str]) {
    let found = errors(text);
    let [(l, f, message)] = found.as_slice() else {
        panic!("expected one error, found {found:#?}");
    };
    assert_eq!((*l, f.as_str()), (line, field), "{message}");
    for word in words {
        assert!(message.contains(word), "{message:?} does not say {word:?}");
    }
}

fn no_assets(
    path: &str,
) -> Result<(Gaussians, ReadReport), Box<dyn std::error::Error + Send + Sync>> {
    Err(format!("{path}: no such file").into())
}

fn built(text: &str) -> (Scene, BuildReport) {
    let file = SceneFile::parse(text).unwrap_or_else(|e| panic!("{e}"));
    build(&file, &mut no_assets).unwrap_or_else(|e| panic!("{e}"))
}

const BALL: &str = r#"version = 1
dx = 0.05
[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.2 }
material = "jelly"
"#;

#[test]
fn a_short_file_is_a_scene_with_documented_defaults() {
    let file = SceneFile::parse(BALL).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(file.gravity, [0.0, -9.81, 0.0]);
    assert_eq!(
        (file.frame_rate, file.cfl, file.particles_per_cell),
        (60.0, 0.8, 8.0)
    );
    let (scene, report) = built(BALL);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let volume: f64 = scene.particles.volume.iter().sum();
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.008;
    assert!((volume / exact - 1.0).abs() < 1e-10);
    assert_eq!(scene.objects[0].fidelity, Fidelity::Mpm);
}

/// By default with jitter, and volumes that are those of the ball.
#[test]
fn a_lagrangian_ball_of_a_file_falls_and_bounces() {
    let floor = "solver = \"lagrangian\"\ntranslation = [0, 0.25, 0]\n[[colliders]]\nnormal = [0, 1, 0]\nname = \"floor\"\n";
    let (scene, _) = built(&format!("{BALL}{floor}"));
    assert_eq!(scene.objects[0].solver, Solver::Lagrangian);
    let mut world = cosplat_sim_core::World::new(scene).unwrap_or_else(|e| panic!("{e}"));
    let start = world.report().objects[0].mass;
    let mut speeds = vec![];
    for _ in 0..24 {
        speeds.push(world.step(1.0 / 60.0, &[]).objects[0].linear_velocity[1]);
    }
    let report = world.report();
    assert_eq!(report.objects[0].mass, start);
    assert!((start / (1000.0 * 0.0335) - 1.0).abs() < 0.2, "{start}");
    // Down at first, and up after it.
    assert!(
        speeds[3] < 0.0 && speeds.iter().any(|v| *v > 0.5),
        "{speeds:?}"
    );
    assert_eq!(report.rollbacks, 0);
    assert_one_error(
        &BALL.replace("material =", "solver = \"eulerian\"\nmaterial ="),
        6,
        "objects[0].solver",
        &["eulerian", "lagrangian"],
    );
}

/// The ball without its `dx`, with other lines at the top.
fn ball_with(lines: &str) -> String {
    BALL.replace("dx = 0.05", lines)
}

/// Resolution, density, step and tolerance.
#[test]
fn quality_sets_four_keys_and_those_of_the_file_win() {
    for (name, quality) in Quality::ALL {
        let file = SceneFile::parse(&ball_with(&format!("quality = {name:?}")))
            .unwrap_or_else(|e| panic!("{e}"));
        let numbers = QualityNumbers {
            resolution: file.resolution,
            particles_per_cell: file.particles_per_cell,
            cfl: file.cfl,
            tolerance: file.tolerance,
        };
        assert_eq!(numbers, quality.numbers(), "{name}");
        let own = "dx = 0.04\ncfl = 0.3\nparticles_per_cell = 5\ntolerance = 0.2";
        let both = ball_with(&format!("quality = {name:?}\n{own}"));
        let file = SceneFile::parse(&both).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(file.resolution, Resolution::Dx(0.04), "{name}");
        assert_eq!(
            (file.cfl, file.particles_per_cell, file.tolerance),
            (0.3, 5.0, 0.2)
        );
    }
    let [none, balanced] =
        ["", "quality = \"balanced\""].map(|l| built(&ball_with(l)).0.particles.position.len());
    assert_eq!(none, balanced, "balanced is the default");
}

#[test]
fn an_unknown_quality_names_the_known_ones() {
    let words = ["balnced", "balanced"];
    assert_one_error(&ball_with("quality = \"balnced\""), 2, "quality", &words);
    assert_one_error(&ball_with("quality = 2"), 2, "quality", &["a string"]);
}

#[test]
fn every_error_is_reported_at_once_with_its_line_and_field() {
    let text = r#"version = 1
gravty = [0, -9.81, 0]
dx = nan
cfl = 1.6
seed = -1
[[objects]]
name = "a"
shape = { kind = "shpere", radius = 1 }
material = { preset = "rubbr", youngs_modulus = 1e5 }
[[objects]]
name = "a"
shape = { kind = "box", size = [1, 2] }
material = { youngs_modulus_pa = -3.0, poisson_ratio = 0.5, density_kg_m3 = 1000 }
linear_velocity = [0, "fast", 0]
[[probes]]
name = "p"
kind = "extent"
object = "b"
[[colliders]]
name = "floor"
normal = [0, 0, 0]
surface = "stiky"
"#;
    let found = errors(text);
    let expected = [
        (2, "gravty", "did you mean `gravity`?"),
        (3, "dx", "is NaN m, expected 1e-6 to 1000.0 m"),
        (4, "cfl", "is 1.6, expected 0.01 to 1.5"),
        (5, "seed", "-1"),
        (8, "objects[0].shape.kind", "did you mean `sphere`?"),
        (9, "objects[0].material.preset", "did you mean `rubber`?"),
        (
            9,
            "objects[0].material.youngs_modulus",
            "did you mean `youngs_modulus_pa`?",
        ),
        (
            11,
            "objects[1].name",
            "object `a` exists already, in line 7",
        ),
        (12, "objects[1].shape.size", "has 2 elements, expected 3"),
        (
            13,
            "objects[1].material.youngs_modulus_pa",
            "is -3.0 Pa, expected 0.001",
        ),
        (13, "objects[1].material.poisson_ratio", "is 0.5, expected"),
        (
            14,
            "objects[1].linear_velocity[1]",
            "expected a number, found a string",
        ),
        (18, "probes[0].object", "object `b` does not exist"),
        (21, "colliders[0].normal", "has no direction"),
        (22, "colliders[0].surface", "did you mean `sticky`?"),
    ];
    for (line, field, words) in expected {
        let said =
            |(l, f, m): &&(usize, String, String)| *l == line && f == field && m.contains(words);
        assert!(
            found.iter().find(said).is_some(),
            "line {line}, {field}: {words:?} is not in {found:#?}"
        );
    }
    assert_eq!(found.len(), expected.len(), "{found:#?}");
}

#[test]
fn broken_toml_says_where() {
    let found = errors("version = 1\ndx = = 2\nname = \"x\ncfl = 0.5\n");
    let lines: Vec<usize> = found.iter().map(|f| f.0).collect();
    assert!(lines.contains(&2) && lines.contains(&3), "{found:?}");
}

#[test]
fn a_file_of_another_version_is_refused() {
    let text = BALL.replace("version = 1", "version = 2");
    assert_one_error(&text, 1, "version", &["is 2", "reads version 1"]);
    let text = BALL.replace("version = 1", "");
    assert_one_error(&text, 1, "", &["`version` is missing"]);
}

#[test]
fn keys_that_exclude_each_other_are_refused_together() {
    let text = BALL.replace("dx = 0.05", "dx = 0.05\ncells_per_object = 8");
    assert_one_error(&text, 3, "cells_per_object", &["excludes `dx`"]);
}

#[test]
fn an_object_without_geometry_or_material_says_so() {
    let text = "version = 1\n[[objects]]\nname = \"a\"\n";
    let found = errors(text);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found.iter().all(|f| f.0 == 2 && f.1 == "objects[0]"));
}

#[test]
fn a_clone_differs_only_in_what_it_says() {
    let text = format!(
        "{BALL}linear_velocity = [1, 0, 0]\n[[objects]]\nname = \"twin\"\nclone = \"ball\"\ntranslation = [1, 0, 0]\n"
    );
    let (scene, _) = built(&text);
    let [ball, twin] = scene.objects.as_slice() else {
        panic!("two objects")
    };
    assert_eq!(ball.material, twin.material);
    assert_eq!(ball.linear_velocity, twin.linear_velocity);
    for (p, q) in ball.particles.clone().zip(twin.particles.clone()) {
        let (p, q) = (scene.particles.position[p], scene.particles.position[q]);
        assert_eq!([p[0] + 1.0, p[1], p[2]], q);
    }
}

#[test]
fn a_clone_of_itself_is_refused() {
    let text = "version = 1\n[[objects]]\nname = \"a\"\nclone = \"b\"\n[[objects]]\nname = \"b\"\nclone = \"a\"\n";
    let found = errors(text);
    assert!(
        found
            .iter()
            .any(|f| f.0 == 4 && f.2.contains("clone of itself")),
        "{found:?}"
    );
}

#[test]
fn rotation_turns_about_x_then_y_then_z_of_the_world() {
    let text = BALL.replace(
        r#"shape = { kind = "sphere", radius = 0.2 }"#,
        "shape = { kind = \"box\", size = [0.6, 0.2, 0.2] }\nrotation_deg = [0, 0, 90]\ntranslation = [0, 2, 0]",
    );
    let (scene, _) = built(&text);
    let highest = scene
        .particles
        .position
        .iter()
        .map(|p| p[1])
        .fold(0.0, f64::max);
    // The long side now stands upright: 2 + 0.3 less half a particle spacing, give or take the jitter.
    assert!((highest - 2.3 + 0.0125).abs() < 0.0026, "{highest}");
}

#[test]
fn velocity_gradient_is_spin_plus_affine_part() {
    let text = format!(
        "{BALL}angular_velocity = [0, 0, 2]\nvelocity_gradient = [[1, 0, 0], [0, 0, 0], [0, 0, 0]]\n"
    );
    let (scene, _) = built(&text);
    let gradient = scene.objects[0].velocity_gradient;
    assert_eq!(gradient, [[1.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0; 3]]);
}

#[test]
fn warnings_name_what_is_suspicious() {
    let text = r#"version = 1
dx = 0.05
[[objects]]
name = "soft"
shape = { kind = "box", size = [0.4, 0.4, 0.4] }
material = { preset = "jelly", youngs_modulus_pa = 10.0 }
[[objects]]
name = "plate"
shape = { kind = "box", size = [0.4, 0.06, 0.4] }
translation = [0, 0.15, 0]
material = "jelly"
[[colliders]]
name = "floor"
point = [0, -0.1, 0]
normal = [0, 2, 0]
[[pinned_regions]]
min = [5, 5, 5]
max = [6, 6, 6]
"#;
    let (_, report) = built(text);
    let all: Vec<String> = report.warnings.iter().map(ToString::to_string).collect();
    for words in [
        "line 6, column 52: objects[0].material.youngs_modulus_pa: 10 Pa is softer",
        "`plate` is 0.06",
        "`soft` and `plate` overlap",
        "start inside collider `floor`, up to 0.0",
        "pinned_regions[0]: holds no particle",
    ] {
        assert!(
            all.iter().any(|w| w.contains(words)),
            "{words:?} not in {all:#?}"
        );
    }
    assert_eq!(all.len(), 5, "{all:#?}");
}

#[test]
fn a_copy_may_be_absent_and_then_overlaps_with_nothing() {
    let copy = |key: &str| format!("{BALL}[[objects]]\nname = 'copy'\nclone = 'ball'\n{key}\n");
    let (scene, report) = built(&copy("present = false"));
    let present: Vec<bool> = scene.objects.iter().map(|o| o.present).collect();
    assert_eq!(present, [true, false]);
    let overlaps = |report: &BuildReport| {
        let mut all = report.warnings.iter().map(ToString::to_string);
        all.any(|warning| warning.contains("overlap"))
    };
    assert!(!overlaps(&report));
    assert!(overlaps(&built(&copy("")).1));
}

#[test]
fn an_object_outside_the_domain_is_an_error() {
    let text =
        format!("{BALL}translation = [3, 0, 0]\n[domain]\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\n");
    let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{e}"));
    let error = build(&file, &mut no_assets).expect_err("outside");
    assert!(error.to_string().contains("outside the domain"), "{error}");
}

#[test]
fn a_grid_that_no_machine_holds_is_refused_before_it_is_made() {
    let text = BALL.replace("dx = 0.05", "dx = 1e-6");
    let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{e}"));
    let error = build(&file, &mut no_assets).expect_err("too fine");
    assert!(
        error.to_string().starts_with("line 2, column 6: dx: "),
        "{error}"
    );
}

#[test]
fn all_missing_assets_are_reported_at_once() {
    let text = r#"version = 1
[[assets]]
name = "one"
path = "one.ply"
[[objects]]
name = "a"
asset = "one"
fidelity = "static"
[[objects]]
name = "b"
path = "two.ply"
fidelity = "static"
"#;
    let file = SceneFile::parse(text).unwrap_or_else(|e| panic!("{e}"));
    let SceneErrors(found) = build(&file, &mut no_assets).expect_err("no assets");
    let lines: Vec<(usize, &str)> = found
        .iter()
        .map(|f| (f.at.line, f.message.as_str()))
        .collect();
    assert_eq!(
        lines,
        [(2, "one.ply: no such file"), (11, "two.ply: no such file")]
    );
}

#[test]
fn one_mistake_is_one_error() {
    let text = r#"version = 1
[materials.own]
youngs_modulus_pa = 1e5
poisson_ratio = 0.7
density_kg_m3 = 1000
[[objects]]
name = "a"
shape = { kind = "sphere", radius = 0.1 }
material = "own"
[[probes]]
name = "p"
kind = "extent"
object = "a"
"#;
    assert_one_error(text, 4, "materials.own.poisson_ratio", &["is 0.7"]);
}

#[test]
fn a_rigid_object_does_not_meet_as_a_sphere() {
    let text = format!("contact = \"com_sphere\"\n{BALL}fidelity = \"rigid\"\n");
    let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{e}"));
    let SceneErrors(found) = build(&file, &mut no_assets).expect_err("rigid");
    assert_eq!(found.len(), 1, "{found:#?}");
    assert!(
        found[0].message.contains("`ball` is rigid"),
        "{}",
        found[0].message
    );
}

#[test]
fn a_bar_of_two_cells_is_told_what_four_would_cost() {
    let bar_on = |solver: &str, numbers: &str| {
        let text = format!(
            "version = 1\n{numbers}\n[[objects]]\nname = \"bar\"\n{solver}\n\
             shape = {{ kind = \"box\", size = [0.8, 0.1, 0.1], gaussian_spacing = 0.1 }}\nmaterial = \"jelly\"\n"
        );
        let (scene, report) = built(&text);
        let warnings: Vec<String> = report.warnings.iter().map(ToString::to_string).collect();
        (scene, warnings)
    };
    let bar = |numbers: &str| bar_on("solver = \"spatial\"", numbers);
    let (scene, warnings) = bar("");
    let [warning] = warnings.as_slice() else {
        panic!("{warnings:?}")
    };
    // 16 cells along 0.8 m; twice as many make eight times the particles and sixteen times the work.
    assert_eq!(scene.particles.position.len(), 16 * 2 * 2 * 8);
    for words in [
        "`bar` is 2.0 cells thick",
        "cells_per_object = 3",
        "in place of 512",
        "4 cells",
    ] {
        assert!(warning.contains(words), "{words:?} not in {warning:?}");
    }
    // Its remedy is one.
    let remedy = warning.split('`').nth(3).expect("in marks");
    let (_, warnings) = bar(remedy);
    assert_eq!(warnings, [""; 0]);
    let (_, warnings) = bar("dx = 0.05");
    let remedy = warnings[0].split('`').nth(3).expect("in marks");
    let (_, warnings) = bar(remedy);
    assert_eq!(warnings, [""; 0]);
    // On a grid of its own two cells are enough to bend.
    assert_eq!(bar_on("", "").1, [""; 0]);
}

#[test]
fn what_shall_sleep_and_never_rests_is_warned_of() {
    let warnings = |material: &str| -> Vec<String> {
        let text = BALL.replace("\"jelly\"", &format!("{material}\nfidelity = \"auto\""));
        let (_, report) = built(&text);
        report.warnings.iter().map(ToString::to_string).collect()
    };
    let numbers =
        "law = \"neo_hookean\", youngs_modulus_pa = 1e5, poisson_ratio = 0.3, density_kg_m3 = 1000";
    let found = warnings(&format!("{{ {numbers} }}"));
    let [warning] = found.as_slice() else {
        panic!("{found:?}")
    };
    for words in ["`ball`", "`loss`", "does not sleep"] {
        assert!(warning.contains(words), "{words:?} not in {warning:?}");
    }
    for rests in [
        &format!("{{ {numbers}, loss = 0.01 }}"),
        "\"jelly\"",
        "\"clay\"",
    ] {
        assert_eq!(warnings(rests), [""; 0], "{rests}");
    }
}
