//! Scenes from files: assets and filling on real files, and what becomes of scenes in the solver.

mod balls;
mod converter;
mod costs;
mod filling;
mod frictions;
mod rolling;
mod shipped;
mod splats;

use std::{
    fs,
    path::{Path, PathBuf},
};

use cosplat_scene::{
    assets::{self, Gaussians},
    scene_file::{SceneFile, build},
};
use cosplat_sim_core::World;

/// The world of a scene that names no file.
fn world(text: &str) -> World {
    let file = SceneFile::parse(text).expect("valid");
    let (scene, _) = build(&file, &mut |_| unreachable!("no files")).expect("builds");
    World::new(scene).expect("valid scene")
}

fn skip(test: &str, why: &str) {
    let sentence = format!("SKIPPED: {test}: {why}");
    assert!(
        std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(),
        "{sentence}"
    );
    eprintln!("{sentence}");
}

/// Path of a real splat file, if the test data is there.
fn data(test: &str, name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("COSPLAT_TEST_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    skip(
        test,
        &format!(
            "{} does not exist; COSPLAT_TEST_DATA names the folder",
            path.display()
        ),
    );
    None
}

fn read(path: &Path) -> Gaussians {
    let bytes = fs::read(path).expect("the file exists");
    let (gaussians, report) =
        assets::read(&path.to_string_lossy(), &bytes).expect("a readable asset");
    assert_eq!(report.dropped.total(), 0);
    gaussians
}
