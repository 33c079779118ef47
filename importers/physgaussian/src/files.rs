//! Finds the files of a PhysGaussian scene and writes the imported one.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use cosplat_files::reading;
use cosplat_scene::{
    assets::{self, AssetError},
    scene_file::count_of_errors,
};

use crate::{ImportErrors, Imported, Options, import};

/// Why a scene cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file or folder cannot be read or written.
    #[error("cannot {what} {}: {cause}", path.display())]
    File {
        /// Read or write.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        cause: io::Error,
    },
    /// The model folder holds no model.
    #[error("{}: expected a PLY file or a folder with point_cloud/iteration_<N>/point_cloud.ply", path.display())]
    NoModel {
        /// The folder.
        path: PathBuf,
    },
    /// The model is read and wrong.
    #[error(transparent)]
    Model(#[from] AssetError),
    /// A path that no scene file can name.
    #[error("{} is not UTF-8, rename it", path.display())]
    NotText {
        /// The path.
        path: PathBuf,
    },
    /// The configuration is read and wrong.
    #[error("{} has {}:\n{errors}", path.display(), count_of_errors(errors.0.len()))]
    Config {
        /// The configuration.
        path: PathBuf,
        /// All of them.
        errors: ImportErrors,
    },
}

/// A scene, imported and written.
#[derive(Clone, Debug)]
pub struct Written {
    /// The scene file.
    pub scene: PathBuf,
    /// The model that it names.
    pub model: PathBuf,
    /// The conversion.
    pub imported: Imported,
}

/// Imports `config` with the model at `model`, a PLY file or a 3DGS model folder, into the folder `out`, which is
/// made. The scene file refers to the model where it lies.
///
/// # Errors
/// When a file cannot be read or written, or the configuration cannot be converted.
pub fn import_files(
    config: &Path,
    model: &Path,
    out: &Path,
    compat: bool,
    e_multiplier: Option<f64>,
) -> Result<Written, ImportError> {
    let failed = |what, path: &Path| {
        let path = path.to_owned();
        move |cause| ImportError::File { what, path, cause }
    };
    let text = reading::read_text(config).map_err(failed("read", config))?;
    let ply = find_model(model)?;
    let bytes = reading::read(&ply, reading::LARGEST_DATA).map_err(failed("read", &ply))?;
    let (gaussians, _) = assets::read(&ply.display().to_string(), &bytes)?;
    fs::create_dir_all(out).map_err(failed("make", out))?;
    let stem = config.file_stem().unwrap_or_default();
    let options = Options {
        name: stem.to_string_lossy().into_owned(),
        asset: seen_from(&ply, out)?,
        compat,
        e_multiplier,
    };
    let imported = import(&text, &gaussians, &options).map_err(|errors| ImportError::Config {
        path: config.into(),
        errors,
    })?;
    let scene = out.join("scene.toml");
    cosplat_files::write(&scene, &imported.scene).map_err(failed("write", &scene))?;
    Ok(Written {
        scene,
        model: ply,
        imported,
    })
}

/// The PLY of a model: the file itself, or that of the highest iteration in a model folder.
fn find_model(model: &Path) -> Result<PathBuf, ImportError> {
    if model.is_file() {
        return Ok(model.into());
    }
    let folder = model.join("point_cloud");
    let entries = fs::read_dir(&folder).or_else(|_| fs::read_dir(model));
    let entries = entries.map_err(|cause| ImportError::File {
        what: "read",
        path: model.into(),
        cause,
    })?;
    let iteration = |path: &Path| {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix("iteration_")?.parse::<u64>().ok()
    };
    let highest = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter_map(|path| Some((iteration(&path)?, path.join("point_cloud.ply"))))
        .filter(|(_, ply)| ply.is_file())
        .max();
    let alone = [
        model.join("point_cloud.ply"),
        folder.join("point_cloud.ply"),
    ];
    let alone = alone.into_iter().find(|ply| ply.is_file());
    highest
        .map(|(_, ply)| ply)
        .or(alone)
        .ok_or_else(|| ImportError::NoModel { path: model.into() })
}

/// A file as seen from an existing folder, both made absolute first.
fn seen_from(file: &Path, folder: &Path) -> Result<String, ImportError> {
    let absolute = |path: &Path| {
        path.canonicalize().map_err(|cause| ImportError::File {
            what: "find",
            path: path.into(),
            cause,
        })
    };
    let (file, folder) = (absolute(file)?, absolute(folder)?);
    let common = file
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    let up = folder.components().skip(common).map(|_| Path::new(".."));
    let down = file.components().skip(common);
    let mut path: PathBuf = up.collect();
    path.extend(down);
    match path.to_str() {
        Some(text) => Ok(text.into()),
        None => Err(ImportError::NotText { path }),
    }
}

#[cfg(test)]
mod tests {
    use cosplat_scene::assets::{generate, ply};

    use super::*;

    #[test]
    fn the_highest_iteration_is_taken_and_found_from_the_scene_file() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let model = folder.path().join("model");
        let vase = generate::builtin("vase").expect("known");
        for iteration in [7000, 30000, 9999] {
            let place = model.join(format!("point_cloud/iteration_{iteration}"));
            fs::create_dir_all(&place).expect("made");
            fs::write(place.join("point_cloud.ply"), ply::write(&vase)).expect("written");
        }
        fs::create_dir_all(model.join("point_cloud/iteration_99999")).expect("made");
        let config = folder.path().join("config.json");
        fs::write(&config, r#"{"g": [0, 0, 0]}"#).expect("written");
        let out = folder.path().join("a/b");
        let written =
            import_files(&config, &model, &out, false, None).unwrap_or_else(|e| panic!("{e}"));
        assert!(
            written
                .model
                .ends_with("point_cloud/iteration_30000/point_cloud.ply")
        );
        let expected = "path = \"../../model/point_cloud/iteration_30000/point_cloud.ply\"";
        assert!(
            written.imported.scene.contains(expected),
            "{}",
            written.imported.scene
        );
        let loaded =
            cosplat_scene::load::load_scene(&written.scene).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.scene.name, "config");
    }

    #[test]
    fn a_folder_without_a_model_is_said_to_be_one() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let error = find_model(folder.path()).expect_err("empty").to_string();
        assert!(error.contains("iteration_<N>/point_cloud.ply"), "{error}");
        let error = find_model(&folder.path().join("absent")).expect_err("absent");
        assert!(error.to_string().contains("cannot read"), "{error}");
    }
}
