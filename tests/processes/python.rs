//! The Python package: installed as a user installs it, its types checked, its stories told against live servers.

use std::{
    path::{Path, PathBuf},
    sync::OnceLock,
};

use crate::stage::command;

const PACKAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/clients/python");

/// The interpreter of an environment with the package; `None`, said aloud, when it cannot be had.
fn python() -> Option<&'static Path> {
    // Made once: tests run side by side.
    static PYTHON: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match PYTHON.get_or_init(environment) {
        Ok(python) => Some(python),
        Err(why) => {
            let required = std::env::var_os("COSPLAT_REQUIRE_ALL").is_some();
            assert!(!required, "{why}");
            eprintln!("SKIPPED: python3 with venv and the packages of {PACKAGE}: {why}");
            None
        }
    }
}

/// A Python environment below the target folder, with the package as it is now.
fn environment() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-cosplat");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let output = command(program).args(arguments).output();
        let output = output.map_err(|error| format!("{}: {error}", program.display()))?;
        let words = || String::from_utf8_lossy(&output.stderr).into_owned();
        output.status.success().then_some(()).ok_or_else(words)
    };
    if !python.exists() {
        run(
            Path::new("python3"),
            &["-m", "venv", &folder.to_string_lossy()],
        )?;
    }
    let package = format!("{PACKAGE}[test]");
    run(&python, &["-m", "pip", "install", "--quiet", &package])?;
    let again = ["--quiet", "--no-deps", "--force-reinstall", PACKAGE];
    run(&python, &[&["-m", "pip", "install"], &again[..]].concat())?;
    Ok(python)
}

/// Runs a tool of the environment in the package's folder.
fn passes(tool: &[&str]) {
    let Some(python) = python() else { return };
    let output = command(python)
        .arg("-m")
        .args(tool)
        .current_dir(PACKAGE)
        .env("COSPLAT", env!("CARGO_BIN_EXE_cosplat"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .expect("python runs");
    let words = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}\n{errors}");
}

#[test]
fn the_python_package_tells_its_stories() {
    passes(&["pytest", "--quiet", "--tb=short"]);
}

#[test]
fn the_python_package_is_typed_strictly() {
    let cache = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mypy");
    passes(&["mypy", "--cache-dir", &cache.to_string_lossy()]);
}

#[test]
fn the_python_package_has_the_release_of_the_others() {
    let file = std::fs::read_to_string(Path::new(PACKAGE).join("pyproject.toml"));
    let project: toml::Table = file.expect("a project").parse().expect("TOML");
    let version = project["project"]["version"].as_str();
    assert_eq!(version, Some(env!("CARGO_PKG_VERSION")));
}
