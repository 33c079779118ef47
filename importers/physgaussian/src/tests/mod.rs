//! Every key is understood or said not to be; every correction, and its repetition with `--compat`, has its test.

use cosplat_scene::{
    assets::{Gaussians, ReadReport, generate},
    scene_file::{SceneFile, build},
};
use serde_json::{Value, json};

use super::*;

mod conditions;
mod materials;

fn model() -> Gaussians {
    generate::builtin("vase").expect("known")
}

fn options(compat: bool) -> Options {
    Options {
        name: "test".into(),
        asset: "model.ply".into(),
        compat,
        e_multiplier: None,
    }
}

/// Imports a configuration that has `more` besides gravity.
fn imported(more: Value, compat: bool) -> Imported {
    let mut config = json!({"g": [0, 0, -9.8]});
    for (key, value) in more.as_object().expect("an object") {
        config[key] = value.clone();
    }
    import(&config.to_string(), &model(), &options(compat)).unwrap_or_else(|e| panic!("{e}"))
}

fn find<'i>(imported: &'i Imported, kind: NoteKind, key: &str) -> &'i Note {
    let mut found = imported
        .notes
        .iter()
        .filter(|n| n.kind == kind && n.key == key);
    let first = found.next();
    first.unwrap_or_else(|| panic!("no {kind} note on {key} in {:#?}", imported.notes))
}

fn has(imported: &Imported, kind: NoteKind) -> bool {
    imported.notes.iter().any(|n| n.kind == kind)
}

/// The scene builds; the text is returned as a table to look things up in.
fn built(imported: &Imported) -> toml::Table {
    let text = &imported.scene;
    let file = SceneFile::parse(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let mut load = |_: &str| Ok((model(), ReadReport::default()));
    build(&file, &mut load).unwrap_or_else(|e| panic!("{e}\n{text}"));
    text.parse().expect("TOML")
}

fn number(table: &toml::Value, key: &str) -> f64 {
    let value = table
        .get(key)
        .unwrap_or_else(|| panic!("no {key} in {table}"));
    let number = value.as_float().or(value.as_integer().map(|i| i as f64));
    number.unwrap_or_else(|| panic!("{key} is {value}"))
}

fn near(actual: f64, expected: f64) {
    let error = (actual - expected).abs() / expected.abs().max(1e-300);
    assert!(error < 1e-12, "{actual} instead of {expected}");
}

fn material(imported: &Imported) -> toml::Value {
    built(imported)["objects"][0]["material"].clone()
}

/// Every key of the original and of the forks, in its spelling there.
fn everything() -> Value {
    serde_json::from_str(include_str!("every_key.json")).expect("JSON")
}

#[test]
fn every_key_of_the_original_and_its_forks_is_known() {
    let imported = imported(everything(), false);
    assert!(!has(&imported, NoteKind::Unknown), "{:#?}", imported.notes);
}

#[test]
fn no_key_is_passed_over_in_silence() {
    // A key that is read but has no effect here is named in a note; one that has an effect stands in the scene.
    let everything = everything();
    let imported = imported(everything.clone(), false);
    for key in everything.as_object().expect("an object").keys() {
        let noted = imported
            .notes
            .iter()
            .any(|n| n.key.starts_with(key.as_str()));
        let written = imported.scene.contains(key.as_str());
        // These say nothing unless the material or the damping is another, gravity a number, the length of the run.
        let silent = [
            "yield_stress",
            "hardening",
            "xi",
            "softening",
            "friction_angle",
            "plastic_viscosity",
            "bulk_modulus",
            "rpic_damping",
            "grid_v_damping_scale",
            "mpm_space_vertical_upward_axis",
            "frame_num",
            "material",
        ];
        assert!(noted || written || silent.contains(&key.as_str()), "{key}");
    }
}

#[test]
fn the_documentation_maps_every_key() {
    let text = include_str!("../../../../docs/physgaussian.md");
    let everything = everything();
    let keys = everything.as_object().expect("an object").keys();
    let filling = everything["particle_filling"]
        .as_object()
        .expect("an object")
        .keys();
    let filling =
        filling.filter(|k| ["n_grid", "boundary", "max_partciels_per_cell"].contains(&k.as_str()));
    let types = everything["boundary_conditions"]
        .as_array()
        .expect("a list");
    let types = types.iter().filter_map(|b| b["type"].as_str());
    for name in keys.chain(filling).map(String::as_str).chain(types) {
        let named = text
            .split('`')
            .any(|word| word.trim_start_matches('.').ends_with(name));
        assert!(named, "{name} is not in docs/physgaussian.md");
    }
}

#[test]
fn an_unknown_key_is_named_with_the_nearest_known_one() {
    let imported = imported(
        json!({"densty": 3, "boundary_conditions": [{"type": "cubiod"}, {"type": "bounding_box", "padding": 4}]}),
        false,
    );
    let note = find(&imported, NoteKind::Unknown, "densty");
    assert!(note.message.contains("did you mean `density`?"), "{note}");
    let note = find(&imported, NoteKind::Unknown, "boundary_conditions[0].type");
    assert!(note.message.contains("did you mean `cuboid`?"), "{note}");
    find(
        &imported,
        NoteKind::Unknown,
        "boundary_conditions[1].padding",
    );
}

#[test]
fn everything_that_is_wrong_is_reported_at_once() {
    let config = json!({
        "E": "soft", "nu": 0.6, "n_grid": 50.5, "sim_area": [0, 1], "rotation_degree": [10], "material": "jely",
        "boundary_conditions": [{"type": "cuboid", "point": [1, 1, 1]}, 3]
    });
    let errors = import(&config.to_string(), &model(), &options(false))
        .expect_err("wrong")
        .0;
    for expected in [
        "E: is \"soft\", expected a number",
        "nu: is 0.6, expected 0 to 0.5",
        "n_grid: is 50.5, expected a whole number",
        "sim_area: has 2 numbers, expected 6",
        "rotation_degree: has 1 angles, and `rotation_axis` has 0 axes",
        "material: is \"jely\", expected one of jelly, metal, sand, foam, snow, plasticine, fluid: did you mean `jelly`?",
        "boundary_conditions[0].size: is missing",
        "boundary_conditions[0].velocity: is missing",
        "boundary_conditions[1]: is 3, expected an object",
    ] {
        assert!(
            errors.iter().any(|e| e == expected),
            "{expected} not in {errors:#?}"
        );
    }
    assert_eq!(errors.len(), 9, "{errors:#?}");
    let error = import("{", &model(), &options(false)).expect_err("cut off");
    assert!(error.to_string().contains("line 1"), "{error}");
}

#[test]
fn an_empty_configuration_has_the_defaults_of_the_original() {
    let imported = import("{}", &model(), &options(false)).unwrap_or_else(|e| panic!("{e}"));
    let scene = toml::Value::Table(built(&imported));
    near(number(&scene, "dx"), 0.04);
    near(number(&scene, "frame_rate"), 100.0);
    near(imported.duration, 1.0);
    assert_eq!((imported.frames, imported.fixed_substeps), (100, 10_000));
    let material = &scene["objects"][0]["material"];
    assert_eq!(material["law"].as_str(), Some("fixed_corotated"));
    near(number(material, "youngs_modulus_pa"), 1e5);
    near(number(material, "poisson_ratio"), 0.4);
    near(number(material, "density_kg_m3"), 200.0);
    assert_eq!(
        scene["objects"][0]["particles"].as_str(),
        Some("per_gaussian")
    );
    // The original fails on its own default.
    let note = find(&imported, NoteKind::Corrected, "g");
    assert_eq!(note.new, json!([0.0, 0.0, -9.8]));
}

#[test]
fn a_scalar_gravity_acts_against_the_upward_axis() {
    let config = json!({"g": 4, "mpm_space_vertical_upward_axis": [0, -2, 0]});
    let imported =
        import(&config.to_string(), &model(), &options(false)).unwrap_or_else(|e| panic!("{e}"));
    let note = find(&imported, NoteKind::Corrected, "g");
    assert_eq!((&note.old, &note.new), (&json!(4), &json!([0.0, 4.0, 0.0])));
}

#[test]
fn a_poisson_ratio_of_one_half_is_nearly_one_half() {
    let imported = imported(json!({"nu": 0.5}), false);
    assert_eq!(
        find(&imported, NoteKind::Corrected, "nu").new,
        json!(0.4999)
    );
    near(number(&material(&imported), "poisson_ratio"), 0.4999);
}

#[test]
fn moduli_in_another_unit_are_doubted_and_multiplied() {
    let soft = json!({"E": 0.2, "additional_material_params": [
        {"point": [1, 1, 1], "size": [0.1, 0.1, 0.1], "E": 0.005, "nu": 0.3}]});
    let doubted = imported(soft.clone(), false);
    for key in ["E", "additional_material_params[0].E"] {
        let note = find(&doubted, NoteKind::Warning, key);
        assert!(note.message.contains("--e-multiplier 1e7"), "{note}");
    }
    let options = Options {
        e_multiplier: Some(1e7),
        ..options(false)
    };
    let multiplied =
        import(&soft.to_string(), &model(), &options).unwrap_or_else(|e| panic!("{e}"));
    let note = find(&multiplied, NoteKind::Changed, "E");
    assert_eq!((&note.old, &note.new), (&json!(0.2), &json!(2e6)));
    assert!(
        !multiplied
            .notes
            .iter()
            .any(|n| n.kind == NoteKind::Warning && n.key == "E")
    );
}

#[test]
fn a_modulus_too_small_for_a_scene_file_is_raised() {
    let bird = imported(json!({"E": 1e-4}), false);
    find(&bird, NoteKind::Warning, "E");
    assert_eq!(find(&bird, NoteKind::Changed, "E").new, json!(1e-3));
    near(number(&material(&bird), "youngs_modulus_pa"), 1e-3);
}

#[test]
fn a_step_beyond_the_speed_of_sound_is_doubted() {
    // c = sqrt(M / rho) with M = E (1 - nu) / ((1 + nu) (1 - 2 nu)); the sand of Feature Splatting: C = 1.07.
    let config =
        json!({"E": 2.5e6, "nu": 0.24, "density": 1000, "n_grid": 128, "substep_dt": 3.08e-4});
    let note = imported(config.clone(), false);
    let note = find(&note, NoteKind::Warning, "substep_dt");
    assert!(note.message.contains("crosses 1.07 cells"), "{note}");
    let mut slower = config;
    slower["substep_dt"] = json!(2.8e-4);
    assert!(!has(&imported(slower, false), NoteKind::Warning));
}

#[test]
fn a_frame_keeps_the_substep_that_rounding_cut_off() {
    let wolf = json!({"substep_dt": 2e-5, "frame_dt": 4e-2, "frame_num": 50});
    let corrected = imported(wolf.clone(), false);
    assert_eq!(corrected.fixed_substeps, 99_950);
    find(&corrected, NoteKind::Corrected, "frame_dt");
    near(corrected.duration, 2.0);
    near(
        number(&toml::Value::Table(built(&corrected)), "frame_rate"),
        25.0,
    );
    let repeated = imported(wolf, true);
    find(&repeated, NoteKind::Reproduced, "frame_dt");
    near(repeated.duration, 50.0 * 1999.0 * 2e-5);
    let whole = imported(json!({}), false);
    assert!(!whole.notes.iter().any(|n| n.key == "frame_dt"));
}

#[test]
fn damping_per_substep_becomes_a_rate() {
    // 0.9999 in 1e-4 s is about 1 /s.
    for compat in [false, true] {
        let damped = imported(json!({"grid_v_damping_scale": 0.9999}), compat);
        find(&damped, NoteKind::Corrected, "grid_v_damping_scale");
        let rate = number(&toml::Value::Table(built(&damped)), "damping");
        near(rate, -0.9999f64.ln() / 1e-4);
        assert!((rate - 1.00005).abs() < 1e-7, "{rate}");
    }
    let undamped = imported(json!({"grid_v_damping_scale": 1.1}), false);
    assert!(!undamped.scene.contains("damping ="));
    let damped = imported(json!({"rpic_damping": 0.5}), false);
    near(
        number(&toml::Value::Table(built(&damped)), "rpic_damping"),
        0.5,
    );
    let averaged = imported(json!({"rpic_damping": -0.5}), false);
    assert_eq!(built(&averaged)["transfer"].as_str(), Some("pic"));
    assert!(!undamped.scene.contains("rpic_damping"));
}

#[test]
fn both_spellings_of_particles_per_cell_are_read() {
    let filling = |keys: Value| {
        let mut filling = json!({"n_grid": 100});
        for (key, value) in keys.as_object().expect("an object") {
            filling[key] = value.clone();
        }
        json!({"n_grid": 50, "particle_filling": filling})
    };
    // Twice as fine as the simulation's grid: 4 x 2^3.
    for (key, corrected) in [
        ("max_partciels_per_cell", false),
        ("max_particles_per_cell", true),
    ] {
        let imported = imported(filling(json!({ key: 4 })), true);
        near(
            number(&toml::Value::Table(built(&imported)), "particles_per_cell"),
            32.0,
        );
        let note = imported
            .notes
            .iter()
            .find(|n| n.kind == NoteKind::Corrected && n.key.ends_with(key));
        assert_eq!(note.is_some(), corrected, "{key}");
    }
    let both = imported(
        filling(json!({"max_partciels_per_cell": 1, "max_particles_per_cell": 4})),
        true,
    );
    near(
        number(&toml::Value::Table(built(&both)), "particles_per_cell"),
        8.0,
    );
    find(
        &both,
        NoteKind::Warning,
        "particle_filling.max_particles_per_cell",
    );
}

#[test]
fn filling_makes_a_solid_and_its_absence_particles_at_gaussians() {
    let filled = imported(json!({"particle_filling": {}}), false);
    assert_eq!(
        built(&filled)["objects"][0]["particles"].as_str(),
        Some("filled")
    );
    let surface = imported(json!({"particle_filling": null}), false);
    assert_eq!(
        built(&surface)["objects"][0]["particles"].as_str(),
        Some("per_gaussian")
    );
}

#[test]
fn what_is_outside_of_the_area_stays_visible() {
    let imported = imported(json!({"sim_area": [-1, 1, 0.1, 1, -1, 1]}), false);
    assert!(imported.simulated > 100 && imported.at_rest > 100);
    assert_eq!(
        imported.simulated + imported.at_rest + imported.transparent,
        model().len()
    );
    let scene = built(&imported);
    let objects = scene["objects"].as_array().expect("a list");
    assert_eq!(objects.len(), 2);
    assert_eq!(objects[1]["fidelity"].as_str(), Some("static"));
    let file = SceneFile::parse(&imported.scene).expect("parsed above");
    let mut load = |_: &str| Ok((model(), ReadReport::default()));
    let (scene, _) = build(&file, &mut load).expect("built above");
    assert_eq!(scene.objects[0].gaussians.len(), imported.simulated);
    assert_eq!(scene.objects[1].gaussians.len(), imported.at_rest);
    // The longest side of the simulated part is 1, and its middle (1, 1, 1).
    let shown = &scene.gaussians.position[scene.objects[0].gaussians.clone()];
    let side = |a: usize| {
        let of = shown.iter().map(|p| f64::from(p[a]));
        let (min, max) = of.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
        assert!((0.5 * (min + max) - 1.0).abs() < 1e-6, "{min} {max}");
        max - min
    };
    let longest = [0, 1, 2].map(side).into_iter().fold(0.0, f64::max);
    assert!((longest - 1.0).abs() < 1e-6, "{longest}");
}

#[test]
fn an_object_that_reaches_out_of_the_grid_gets_a_larger_domain() {
    let imported = imported(json!({"scale": 3.0}), false);
    find(&imported, NoteKind::Corrected, "grid_lim");
    built(&imported);
}
