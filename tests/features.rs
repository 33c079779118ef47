//! From a splat to words for its objects, by networks with random weights: `cargo test --features features --test features`.

use std::{
    path::Path,
    process::{Command, Output},
};

use cosplat_scene::assets::{Paint, generate, ply};

fn cosplat(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cosplat"));
    let run = command.current_dir(folder).args(line.split(' ')).output();
    run.expect("cosplat starts")
}

fn json(output: &Output) -> serde_json::Value {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

#[test]
fn networks_of_a_user_lead_from_pictures_to_words() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let networks = Path::new(env!("CARGO_MANIFEST_DIR")).join("features/tests/networks");
    let networks = networks.display();
    let style = generate::Style {
        spacing: 0.03,
        paint: Paint::Plain([0.7, 0.5, 0.3]),
        seed: 1,
    };
    let splat = generate::surface_box([0.3, 0.3, 0.3], &style);
    std::fs::write(folder.join("box.ply"), ply::write(&splat)).expect("written");
    let views = cosplat(
        folder,
        "views box.ply --out seen --count 6 --size 64x48 --up +y",
    );
    assert!(views.status.success());

    let maps = format!(
        "features pictures seen/images --image {networks}/vit.toml --out maps --threads 2 --json"
    );
    let found = cosplat(folder, &maps);
    let told = String::from_utf8_lossy(&found.stderr).into_owned();
    assert!(
        told.contains("5 more pictures on 2 threads: about 0:00:01"),
        "{told}"
    );
    assert_eq!(json(&found)["done"], 6);
    assert_eq!(json(&cosplat(folder, &maps))["before"], 6);
    let masks = format!(
        "features pictures seen/images --image {networks}/vit.toml --masks {networks}/masks.toml --out masks --json"
    );
    assert_eq!(json(&cosplat(folder, &masks))["done"], 6);

    // Masks with vectors make objects of their own; maps give vectors to those.
    let lifted = json(&cosplat(
        folder,
        "lift box.ply --views seen --masks masks/vit --json",
    ));
    assert_eq!(
        (&lifted["views"], &lifted["values"]),
        (&6.into(), &32.into())
    );
    let lifted = json(&cosplat(
        folder,
        "lift box.ply --views seen --maps maps/vit --json",
    ));
    assert_eq!(
        (&lifted["views"], &lifted["values"]),
        (&6.into(), &32.into())
    );

    let words =
        format!("features words crate duck --text {networks}/text.toml --out words.safetensors");
    let made = cosplat(folder, &words);
    assert!(made.status.success());
    assert!(String::from_utf8_lossy(&made.stdout).starts_with("6 words of 32 values"));
    let find = "objects find box.ply --words words.safetensors --word duck --json";
    let found = json(&cosplat(folder, find));
    let score = found["objects"][0]["score"].as_f64().expect("a score");
    assert!((0.0..=1.0).contains(&score), "{found}");
}
