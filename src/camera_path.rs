//! The file of a camera path: `cosplat view --path`.

use std::path::{Path, PathBuf};

use cosplat_renderer::path::{CameraPath, PathError, WrittenKey};
use serde::Deserialize;

/// Why there is no path in a file.
#[derive(Debug, thiserror::Error)]
pub enum PathFileError {
    /// It cannot be read.
    #[error("cannot read the camera path {path}: {cause}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// It is no TOML, or JSON where its name ends so, or says other things than keys.
    #[error("{path} is no camera path: {reason}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What was found where.
        reason: String,
    },
    /// Its keys are none that a camera could go by.
    #[error("{path}: {cause}")]
    Keys {
        /// The file.
        path: PathBuf,
        /// Which, and why.
        cause: PathError,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    keys: Vec<WrittenKey>,
}

/// Reads a path from a TOML file, or a JSON file where its name ends in `.json`. See `docs/export.md`.
///
/// # Errors
/// [`PathFileError`] says what is wrong with it.
pub fn read(path: &Path) -> Result<CameraPath, PathFileError> {
    let text = cosplat_files::reading::read_text(path).map_err(|cause| PathFileError::Read {
        path: path.into(),
        cause,
    })?;
    let is_json = path
        .extension()
        .is_some_and(|end| end.eq_ignore_ascii_case("json"));
    let written: Result<Written, String> = match is_json {
        true => serde_json::from_str(&text).map_err(|error| error.to_string()),
        false => toml::from_str(&text).map_err(|error| error.to_string()),
    };
    let written = written.map_err(|reason| PathFileError::Syntax {
        path: path.into(),
        reason: reason.trim().into(),
    })?;
    CameraPath::new(&written.keys).map_err(|cause| PathFileError::Keys {
        path: path.into(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, text: &str) -> Result<CameraPath, PathFileError> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join(name);
        std::fs::write(&file, text).expect("writable");
        read(&file)
    }

    #[test]
    fn the_same_path_is_read_from_toml_and_json() {
        let toml = "[[keys]]\ntime = 0.5\neye = [1, 2, 3]\nlook_at = [0, 0, 0]\nup = [0, 0, 1]";
        let json = r#"{ "keys": [{ "time": 0.5, "eye": [1, 2, 3], "look_at": [0, 0, 0], "up": [0, 0, 1] }] }"#;
        let (toml, json) = (of("path.toml", toml), of("path.json", json));
        assert_eq!(toml.expect("TOML"), json.expect("JSON"));
    }

    #[test]
    fn what_is_no_path_is_refused_with_its_file() {
        let cases = [
            ("a.json", "[[keys]]", "a.json is no camera path"),
            ("a.toml", "{", "a.toml is no camera path"),
            ("a.toml", "speed = 3", "speed"),
            (
                "a.toml",
                "[[keys]]\neye = [1, 0]",
                "a.toml is no camera path",
            ),
            ("a.toml", "", "a.toml: the camera path has no keys"),
        ];
        for (name, text, expected) in cases {
            let error = of(name, text).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
        let missing = read(Path::new("no/such.toml")).expect_err("no file");
        assert!(
            missing
                .to_string()
                .contains("cannot read the camera path no/such.toml")
        );
    }
}
