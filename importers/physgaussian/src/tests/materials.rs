//! Materials: each law of the original in the terms of the scene format, by arithmetic of its own.

use serde_json::{Value, json};

use super::{find, has, imported, near, number};
use crate::{Imported, NoteKind};

/// Lamé's second parameter of the test's material [Pa].
const MU: f64 = 1e5 / 2.6;

fn one(name: &str, more: Value, compat: bool) -> Imported {
    let mut config = json!({"material": name, "E": 1e5, "nu": 0.3});
    for (key, value) in more.as_object().expect("an object") {
        config[key] = value.clone();
    }
    imported(config, compat)
}

fn material(imported: &Imported) -> toml::Value {
    super::built(imported)["objects"][0]["material"].clone()
}

fn law(material: &toml::Value) -> &str {
    material["law"].as_str().unwrap_or_default()
}

#[test]
fn jelly_is_fixed_corotated() {
    let imported = one("jelly", json!({}), false);
    assert_eq!(law(&material(&imported)), "fixed_corotated");
    assert!(!has(&imported, NoteKind::Corrected), "{:?}", imported.notes);
}

#[test]
fn metal_yields_at_its_yield_stress_unless_compatible() {
    // Their norm of the deviator against ours: |dev tau| = sqrt(2/3) yield stress in tension.
    for (compat, kind, factor) in [
        (false, NoteKind::Corrected, 1.0),
        (true, NoteKind::Reproduced, (3.0f64 / 2.0).sqrt()),
    ] {
        let imported = one("metal", json!({"yield_stress": 100}), compat);
        find(&imported, kind, "yield_stress");
        let material = material(&imported);
        assert_eq!(law(&material), "von_mises");
        near(number(&material, "yield_stress_pa"), 100.0 * factor);
        near(number(&material, "hardening_pa"), 0.0);
    }
}

#[test]
fn hardening_counts_equivalent_plastic_strain() {
    // yield += 2 mu xi |d eps_p| with |d eps_p| = sqrt(3/2) d alpha; the yield stress itself grows by sqrt(3/2) of it
    // when their number is the norm.
    for (compat, factor) in [(false, (3.0f64 / 2.0).sqrt()), (true, 1.5)] {
        let keys = json!({"yield_stress": 100, "hardening": 1, "xi": 0.2});
        let material = material(&one("metal", keys, compat));
        near(number(&material, "hardening_pa"), 2.0 * MU * 0.2 * factor);
    }
    let off = one(
        "metal",
        json!({"yield_stress": 100, "hardening": 2, "xi": 0.2}),
        false,
    );
    find(&off, NoteKind::Warning, "hardening");
    near(number(&material(&off), "hardening_pa"), 0.0);
}

#[test]
fn a_metal_without_yield_stress_is_doubted() {
    find(
        &one("metal", json!({}), false),
        NoteKind::Warning,
        "yield_stress",
    );
}

#[test]
fn sand_keeps_its_angle() {
    let imported = one("sand", json!({"friction_angle": 30}), false);
    let sand = material(&imported);
    assert_eq!(law(&sand), "drucker_prager");
    near(number(&sand, "friction_angle_deg"), 30.0);
    near(number(&sand, "cohesion"), 0.0);
    let steep = one("sand", json!({"friction_angle": 80}), false);
    find(&steep, NoteKind::Changed, "friction_angle");
    near(number(&material(&steep), "friction_angle_deg"), 60.0);
}

#[test]
fn foam_relaxes_as_fast_as_the_original() {
    // Theirs: the excess falls by dt / (dt + eta / 2 mu) in a substep; ours, linear: dt / (dt + viscosity / mu).
    let foam = material(&one(
        "foam",
        json!({"yield_stress": 50, "plastic_viscosity": 8}),
        false,
    ));
    assert_eq!(law(&foam), "foam");
    near(number(&foam, "yield_stress_pa"), 50.0);
    near(number(&foam, "viscosity_pa_s") / MU, 8.0 / (2.0 * MU));
    near(number(&foam, "exponent"), 1.0);
}

#[test]
fn snow_is_snow_or_free_of_stress() {
    let corrected = one("snow", json!({}), false);
    find(&corrected, NoteKind::Corrected, "material");
    let snow = material(&corrected);
    assert_eq!(law(&snow), "snow");
    near(number(&snow, "youngs_modulus_pa"), 1e5);
    let repeated = one("snow", json!({}), true);
    find(&repeated, NoteKind::Reproduced, "material");
    near(number(&material(&repeated), "youngs_modulus_pa"), 1e-3);
}

#[test]
fn plasticine_softens_per_equivalent_strain() {
    for (compat, factor) in [(false, (3.0f64 / 2.0).sqrt()), (true, 1.5)] {
        let keys = json!({"yield_stress": 100, "softening": 40});
        let material = material(&one("plasticine", keys, compat));
        assert_eq!(law(&material), "plasticine");
        near(number(&material, "softening"), 40.0 * factor);
    }
    let steep = one(
        "plasticine",
        json!({"yield_stress": 100, "softening": 1e9}),
        false,
    );
    find(&steep, NoteKind::Warning, "softening");
    assert!(number(&material(&steep), "softening") < 0.9 * 3.0 * MU);
}

#[test]
fn a_fluid_has_the_bulk_modulus_that_it_states() {
    let stated = one(
        "fluid",
        json!({"bulk_modulus": 2e4, "plastic_viscosity": 0.5}),
        false,
    );
    find(&stated, NoteKind::Corrected, "bulk_modulus");
    let fluid = material(&stated);
    assert_eq!(law(&fluid), "fluid");
    near(number(&fluid, "bulk_modulus_pa"), 2e4);
    near(number(&fluid, "viscosity_pa_s"), 0.5);
    // E / (3 (1 - 2 nu))
    let derived = material(&one("fluid", json!({}), false));
    near(number(&derived, "bulk_modulus_pa"), 1e5 / 1.2);
}

#[test]
fn numbers_of_materials_are_those_of_the_original_or_of_pixie() {
    let law_of = |config: Value| law(&material(&imported(config, false))).to_owned();
    assert_eq!(law_of(json!({"material": 2})), "drucker_prager");
    assert_eq!(
        law_of(json!({"material": 5, "yield_stress": 10})),
        "plasticine"
    );
    assert_eq!(law_of(json!({"material": 4})), "snow");
    let pixie = |number: u32| json!({"material": number, "fix_ground": true, "yield_stress": 10});
    assert_eq!(law_of(pixie(4)), "fluid");
    assert_eq!(law_of(pixie(5)), "plasticine");
    let still = imported(pixie(6), false);
    find(&still, NoteKind::Warning, "material");
    let scene = super::built(&still);
    assert_eq!(scene["objects"][0]["fidelity"].as_str(), Some("static"));
}

#[test]
fn regions_have_their_own_numbers() {
    let region = json!({"additional_material_params": [
        {"point": [1, 1, 1.5], "size": [1, 1, 0.5], "E": 2e5, "nu": 0.4, "density": 70},
        {"point": [1, 1, 1.2], "size": [0.2, 0.2, 0.2], "E": 3e5, "nu": 0.2}
    ]});
    let scene = super::built(&one(
        "metal",
        json!({"yield_stress": 100, "density": 300,
        "additional_material_params": region["additional_material_params"]}),
        false,
    ));
    let regions = scene["objects"][0]["regions"]
        .as_array()
        .expect("a list")
        .clone();
    assert_eq!(regions.len(), 2);
    let corner = |end: &str, a: usize| regions[0]["box"][end][a].as_float().unwrap_or(f64::NAN);
    assert_eq!([corner("min", 2), corner("max", 2)], [1.0, 2.0]);
    let own = &regions[0]["material"];
    assert_eq!(law(own), "von_mises");
    near(number(own, "youngs_modulus_pa"), 2e5);
    near(number(own, "density_kg_m3"), 70.0);
    near(number(own, "yield_stress_pa"), 100.0);
    near(number(&regions[1]["material"], "density_kg_m3"), 300.0);
}

#[test]
fn a_stationary_region_of_pixie_is_held() {
    let scene = super::built(&one(
        "jelly",
        json!({"additional_material_params": [
            {"point": [1, 1, 0.7], "size": [1, 1, 0.1], "E": 2e5, "nu": 0.4, "material": 6}
        ]}),
        false,
    ));
    let held = &scene["prescribed"][0];
    assert_eq!(held["box"]["max"][2].as_float(), Some(0.8));
    assert!(held.get("linear_velocity").is_none());
}
