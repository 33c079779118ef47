//! Assets and filling on real files.

mod converter;
mod filling;

use std::{
    fs,
    path::{Path, PathBuf},
};

use cosplat_sim_core::assets::{self, Gaussians};

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
