//! Boundary conditions: what the scene says for each type.

use serde_json::{Value, json};

use super::{built, find, has, imported, model};
use crate::{Imported, NoteKind};

/// Imports one boundary condition.
fn one(condition: Value, compat: bool) -> Imported {
    imported(json!({"boundary_conditions": [condition]}), compat)
}

/// The entries of an array of the scene.
fn entries(imported: &Imported, name: &str) -> Vec<toml::Value> {
    let scene = built(imported);
    let list = scene.get(name).and_then(|l| l.as_array());
    list.cloned().unwrap_or_default()
}

/// The only entry.
fn entry(imported: &Imported, name: &str) -> toml::Value {
    let mut all = entries(imported, name);
    assert_eq!(all.len(), 1, "{name} in {}", imported.scene);
    all.remove(0)
}

fn vector(value: &toml::Value) -> Vec<f64> {
    let list = value.as_array().unwrap_or_else(|| panic!("{value}"));
    list.iter().filter_map(toml::Value::as_float).collect()
}

fn near(actual: &toml::Value, expected: [f64; 3]) {
    let actual = vector(actual);
    let error = (0..3).map(|a| (actual[a] - expected[a]).abs());
    assert!(
        error.fold(0.0, f64::max) < 1e-12,
        "{actual:?} instead of {expected:?}"
    );
}

#[test]
fn the_bounding_box_is_six_separating_walls_three_cells_inside() {
    let walls = entries(&one(json!({"type": "bounding_box"}), false), "colliders");
    assert_eq!(walls.len(), 6);
    for wall in &walls {
        assert_eq!(wall["surface"].as_str(), Some("separate"));
    }
    // Nodes 0, 1, 2 and 47, 48, 49 of 50 at 0.04 m are walls.
    let holds = |node: f64| {
        let x = node * 0.04;
        walls.iter().any(|w| {
            let (p, n) = (vector(&w["point"]), vector(&w["normal"]));
            n[0] != 0.0 && (x - p[0]) * n[0] < 0.0
        })
    };
    let held: Vec<i32> = (0..50).filter(|n| holds(f64::from(*n))).collect();
    assert_eq!(held, [0, 1, 2, 47, 48, 49]);
}

#[test]
fn a_cuboid_is_a_box_of_nodes_that_moves_with_its_velocity() {
    let moving = json!({"type": "cuboid", "point": [1, 1, 0.5], "size": [0.5, 0.25, 0.1], "velocity": [0, 0, 0.5],
                        "start_time": 0.2, "end_time": 0.6});
    let region = entry(&one(moving, false), "pinned_regions");
    near(&region["min"], [0.5, 0.75, 0.4]);
    near(&region["max"], [1.5, 1.25, 0.6]);
    near(&region["velocity"], [0.0, 0.0, 0.5]);
    assert_eq!(region["start_time"].as_float(), Some(0.2));
    assert_eq!(region["end_time"].as_float(), Some(0.6));
    // The run is over after 1 s.
    let still = json!({"type": "cuboid", "point": [1, 1, 0.5], "size": [0.5, 0.25, 0.1], "velocity": [0, 0, 0]});
    let region = entry(&one(still, false), "pinned_regions");
    assert!(region.get("end_time").is_none() && region.get("start_time").is_none());
}

#[test]
fn a_cuboid_does_not_hold_the_nodes_on_its_faces() {
    // 1.04 and 0.96 are nodes of a grid with 0.04 m, 0.4 and 0.6 are too.
    let cuboid = json!({"type": "cuboid", "point": [1, 1, 0.5], "size": [0.04, 0.03, 0.1], "velocity": [0, 0, 0]});
    let region = entry(&one(cuboid, false), "pinned_regions");
    let (min, max) = (vector(&region["min"]), vector(&region["max"]));
    let nodes = |a: usize| {
        (0..50)
            .filter(|n| (min[a]..=max[a]).contains(&(f64::from(*n) * 0.04)))
            .count()
    };
    assert_eq!([nodes(0), nodes(1), nodes(2)], [1, 1, 4]);
}

#[test]
fn a_reset_is_dropped_or_repeated() {
    let cuboid = |end: f64| {
        json!({"type": "cuboid", "point": [1, 1, 0.5], "size": [0.5, 0.5, 0.1], "velocity": [0, 0, 0],
               "start_time": 0.1, "end_time": end, "reset": 1})
    };
    let corrected = one(cuboid(0.5), false);
    find(
        &corrected,
        NoteKind::Corrected,
        "boundary_conditions[0].reset",
    );
    assert_eq!(entries(&corrected, "pinned_regions").len(), 1);
    let repeated = one(cuboid(0.5), true);
    find(
        &repeated,
        NoteKind::Reproduced,
        "boundary_conditions[0].reset",
    );
    let spans: Vec<_> = entries(&repeated, "pinned_regions")
        .iter()
        .map(|r| ["start_time", "end_time"].map(|k| r[k].as_float().unwrap_or(f64::NAN)))
        .collect();
    assert_eq!(spans, [[0.1, 0.5], [0.0, 0.1], [0.5, 0.5 + 15.0 * 1e-4]]);
}

#[test]
fn a_reset_that_comes_too_late_says_so() {
    let late = one(
        json!({"type": "cuboid", "point": [1, 1, 0.5], "size": [0.5, 0.5, 0.1], "velocity": [0, 0, 0], "reset": 1}),
        true,
    );
    find(&late, NoteKind::Ignored, "boundary_conditions[0].reset");
}

fn surface(kind: &str, friction: f64) -> Value {
    json!({"type": "surface_collider", "point": [1, 1, 0.4], "normal": [0, 0, 2], "surface": kind,
           "friction": friction, "start_time": 0, "end_time": 1e3})
}

#[test]
fn surfaces_do_what_they_say_unless_compatible() {
    for (stated, corrected) in [
        ("sticky", "sticky"),
        ("slip", "slip"),
        ("separate", "separate"),
        ("cut", "separate"),
    ] {
        let friction = if stated == "sticky" { 0.0 } else { 0.3 };
        let wall = entry(&one(surface(stated, friction), false), "colliders");
        assert_eq!(wall["surface"].as_str(), Some(corrected));
        if stated != "sticky" {
            assert_eq!(wall["friction"].as_float(), Some(0.3));
        }
        near(&wall["normal"], [0.0, 0.0, 1.0]);
        let wall = entry(&one(surface(stated, friction), true), "colliders");
        assert_eq!(wall["surface"].as_str(), Some("sticky"));
    }
    find(
        &one(surface("slip", 0.0), false),
        NoteKind::Corrected,
        "boundary_conditions[0].surface",
    );
    find(
        &one(surface("slip", 0.0), true),
        NoteKind::Reproduced,
        "boundary_conditions[0].surface",
    );
    let plain = one(surface("sticky", 0.0), false);
    assert!(!has(&plain, NoteKind::Corrected), "{:?}", plain.notes);
}

#[test]
fn odd_surfaces_are_read_as_the_original_reads_them() {
    let odd = one(surface("seperate", 0.1), false);
    let note = find(&odd, NoteKind::Warning, "boundary_conditions[0].surface");
    assert!(note.message.contains("did you mean `separate`?"), "{note}");
    assert_eq!(
        entry(&odd, "colliders")["surface"].as_str(),
        Some("separate")
    );
    let rough = one(surface("sticky", 0.5), false);
    find(
        &rough,
        NoteKind::Corrected,
        "boundary_conditions[0].friction",
    );
}

#[test]
fn an_impulse_no_longer_depends_on_the_number_of_particles() {
    let impulse =
        json!({"type": "particle_impulse", "force": [-0.2, 0, 0], "num_dt": 3, "start_time": 0.1});
    let corrected = one(impulse.clone(), false);
    let kick = entry(&corrected, "impulses");
    // The box of the defaults holds everything.
    let each = -0.2 * 3.0 * 1e-4;
    near(
        &kick["impulse"],
        [each * corrected.simulated as f64, 0.0, 0.0],
    );
    assert!((kick["duration"].as_float().expect("a number") - 3e-4).abs() < 1e-15);
    assert_eq!(kick["start_time"].as_float(), Some(0.1));
    let repeated = entry(&one(impulse, true), "impulses");
    near(&repeated["impulse_per_particle"], [each, 0.0, 0.0]);
}

#[test]
fn an_impulse_on_a_part_counts_only_that() {
    let half = one(
        json!({"type": "particle_impulse", "force": [1, 0, 0], "point": [1, 0.5, 1], "size": [1, 0.5, 1]}),
        false,
    );
    let kick = entry(&half, "impulses");
    let count = vector(&kick["impulse"])[0] / 1e-4;
    assert!(
        count > 100.0 && count < half.simulated as f64 - 100.0,
        "{count}"
    );
    assert!(kick.get("duration").is_none());
}

#[test]
fn particles_of_a_filled_object_count_in_an_impulse() {
    // A grid of filling as fine as the simulation's, 1 point per cell of 0.04 m, in a vase of known volume.
    let config = |filling: Value| json!({"particle_filling": filling, "boundary_conditions": [{"type": "particle_impulse", "force": [1, 0, 0]}]});
    let count = |filling: Value| {
        let imported = imported(config(filling), false);
        vector(&entry(&imported, "impulses")["impulse"])[0] / 1e-4
    };
    let (sparse, dense) = (count(json!({"n_grid": 50})), count(json!({"n_grid": 100})));
    let surface = model().len() as f64;
    // Eight times as many points inside, the same on the surface; rounded to whole particles.
    let ratio = (dense - surface) / (sparse - surface);
    assert!(
        sparse > surface && (ratio - 8.0).abs() < 0.1,
        "{sparse} {dense} {surface}"
    );
}

#[test]
fn prescribed_velocities_select_at_rest() {
    let pulled = json!({"type": "enforce_particle_translation", "point": [1, 1.25, 1], "size": [1, 0.05, 1],
                        "velocity": [0, 0.2, 0], "start_time": 0, "end_time": 0.4});
    let motion = entry(&one(pulled, false), "prescribed");
    near(&motion["box"]["min"], [0.0, 1.2, 0.0]);
    near(&motion["box"]["max"], [2.0, 1.3, 2.0]);
    near(&motion["linear_velocity"], [0.0, 0.2, 0.0]);
    assert_eq!(motion["end_time"].as_float(), Some(0.4));
}

#[test]
fn a_rotating_cylinder_turns_the_way_of_the_original() {
    let turned = json!({"type": "enforce_particle_velocity_rotation", "point": [1, 1, 1], "normal": [0, 0, 2],
                        "half_height_and_radius": [0.3, 0.2], "rotation_scale": 1.5, "translation_scale": 0.1,
                        "start_time": 0, "end_time": 0.5});
    let motion = entry(&one(turned, false), "prescribed");
    near(&motion["cylinder"]["axis"], [0.0, 0.0, 1.0]);
    assert_eq!(motion["cylinder"]["half_height"].as_float(), Some(0.3));
    assert_eq!(motion["cylinder"]["radius"].as_float(), Some(0.2));
    near(&motion["center"], [1.0, 1.0, 1.0]);
    near(&motion["linear_velocity"], [0.0, 0.0, 0.1]);
    // Its second horizontal axis is the first one times the normal: the angle grows clockwise about the normal.
    near(&motion["angular_velocity"], [0.0, 0.0, -1.5]);
}

#[test]
fn a_release_has_the_layers_that_are_asked_for() {
    let release = json!({"type": "release_particles_sequentially", "normal": [1, 0, 0], "start_position": 1.5,
                         "end_position": 0.5, "num_layers": 20, "start_time": 0.0, "end_time": 0.5});
    let corrected = one(release.clone(), false);
    find(
        &corrected,
        NoteKind::Corrected,
        "boundary_conditions[0].num_layers",
    );
    let layers = entry(&corrected, "releases");
    assert_eq!(layers["layers"].as_integer(), Some(20));
    near(&layers["axis"], [1.0, 0.0, 0.0]);
    assert_eq!(layers["start_position"].as_float(), Some(1.5));
    assert_eq!(layers["end_position"].as_float(), Some(0.5));
    let repeated = one(release, true);
    find(
        &repeated,
        NoteKind::Reproduced,
        "boundary_conditions[0].num_layers",
    );
    assert_eq!(
        entry(&repeated, "releases")["layers"].as_integer(),
        Some(50)
    );
}

#[test]
fn what_never_acts_is_left_out_and_said() {
    let late = one(
        json!({"type": "cuboid", "point": [1, 1, 0.5], "size": [0.5, 0.5, 0.1], "velocity": [0, 0, 0],
               "start_time": 2, "end_time": 3}),
        false,
    );
    find(&late, NoteKind::Ignored, "boundary_conditions[0]");
    assert!(entries(&late, "pinned_regions").is_empty());
}

/// Found by `fuzz/run physgaussian`: a box without width made a scene file that nothing reads.
#[test]
fn what_no_scene_file_can_say_is_an_error() {
    let config = json!({"g": [0, 0, -9.8], "boundary_conditions": [{
        "type": "particle_impulse", "force": [1, 0, 0], "num_dt": 1, "start_time": 0,
        "point": [1, 1, 1], "size": [0, 1, 1],
    }]});
    let refused =
        crate::import(&config.to_string(), &model(), &super::options(false)).expect_err("no box");
    assert!(
        refused.to_string().contains("expected less than max x"),
        "{refused}"
    );
}
