//! Scene files and PhysGaussian configurations.

use std::cell::LazyCell;

use cosplat_physgaussian::{Options, import};
use cosplat_scene::{assets::Gaussians, scene_file::SceneFile};

use super::assets;

/// A scene file, as far as its text goes: what it takes to build one is the user's choice.
pub fn scene(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    if let Err(errors) = SceneFile::parse(text) {
        assert!(!errors.0.is_empty(), "a refusal without a reason");
    }
}

/// The scenes of this repository that use most of the format.
pub fn scene_seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 6] = [
        include_bytes!("../../../scenes/two_vases.toml"),
        include_bytes!("../../../scenes/materials.toml"),
        include_bytes!("../../../scenes/box_of_fifty.toml"),
        include_bytes!("../../../scenes/incline.toml"),
        include_bytes!("../../../scenes/drop_splat.toml"),
        super::world::SCENE.as_bytes(),
    ];
    files.map(<[u8]>::to_vec).into()
}

thread_local! {
    static MODEL: LazyCell<Gaussians> = LazyCell::new(assets::line);
}

/// A configuration of PhysGaussian for a model of some Gaussians; the first byte chooses between corrected and repeated
/// defects.
pub fn physgaussian(data: &[u8]) {
    let Some((first, data)) = data.split_first() else {
        return;
    };
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let options = Options {
        name: "fuzz".into(),
        asset: "model.ply".into(),
        compat: first & 1 == 1,
        e_multiplier: None,
    };
    if fills_finely(text) {
        return;
    }
    match MODEL.with(|model| import(text, model, &options)) {
        Err(errors) => assert!(!errors.0.is_empty(), "a refusal without a reason"),
        Ok(imported) => {
            if let Err(errors) = SceneFile::parse(&imported.scene) {
                panic!(
                    "the scene that was made is wrong: {errors}\n{}",
                    imported.scene
                );
            }
        }
    }
}

/// Finest cell for which the model is filled here, in sizes of the model; finer ones are the user's choice of time and memory.
const FINEST: f64 = 0.03;

/// Whether a configuration asks to fill the model for cells that are fine, and not yet refused.
fn fills_finely(text: &str) -> bool {
    let json: Option<serde_json::Value> = serde_json::from_str(text).ok();
    let number = |key: &str, default: f64| match json.as_ref().and_then(|json| json.get(key)) {
        Some(value) => value.as_f64().unwrap_or(default),
        None => default,
    };
    let dx = number("grid_lim", 2.0) / number("n_grid", 50.0) / number("scale", 1.0);
    dx > 0.0 && dx < FINEST
}

/// Every key, and as little as can be.
pub fn physgaussian_seeds() -> Vec<Vec<u8>> {
    let all = include_str!("../../../importers/physgaussian/src/tests/every_key.json");
    // Filling the model costs by the cube of the grid.
    let all = all.replace("\"n_grid\": 50", "\"n_grid\": 8");
    assert!(all.contains("\"n_grid\": 8"), "the grid of the example");
    let sand = r#"@{"g":[0,0,-9.8],"material":"sand","friction_angle":30,"E":1e5,"nu":0.3,"n_grid":8,
"boundary_conditions":[{"type":"bounding_box"},{"type":"particle_impulse","force":[1,0,0]}],"particle_filling":{"n_grid":8}}"#;
    vec![
        format!("@{all}").into(),
        format!("A{all}").into(),
        sand.into(),
        r#"A{"g":[0,0,-9.8]}"#.into(),
    ]
}
