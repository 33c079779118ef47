//! Reads a scene file and the assets it names from disk.

use std::{
    error::Error,
    fs, io,
    path::{Path, PathBuf},
};

use cosplat_sim_core::{Scene, scene::TriangleMesh};

use crate::{
    assets::{self, Gaussians, ReadReport},
    scene_file::{BuildReport, SceneErrors, SceneFile, build_with_meshes},
    settings::{self, SettingError},
};

/// A scene file, built.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// The file as parsed.
    pub file: SceneFile,
    /// The file's text.
    pub text: String,
    /// Warnings and what became of the assets.
    pub report: BuildReport,
}

/// Why a scene file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error("cannot read scene file {}: {cause}", path.display())]
    Read {
        /// The scene file.
        path: PathBuf,
        /// What the operating system says.
        cause: io::Error,
    },
    /// The file is read and wrong.
    #[error("{} has {} error(s):\n{errors}", path.display(), errors.0.len())]
    Scene {
        /// The scene file.
        path: PathBuf,
        /// All of them.
        errors: SceneErrors,
    },
    /// A value cannot be replaced.
    #[error(transparent)]
    Setting(#[from] SettingError),
}

/// An asset file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read asset {}: {cause}", path.display())]
struct AssetFile {
    path: PathBuf,
    cause: io::Error,
}

/// A mesh file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read mesh {}: {cause}", path.display())]
struct MeshFile {
    path: PathBuf,
    cause: io::Error,
}

/// Reads and builds a scene file; asset paths are relative to its folder.
///
/// # Errors
/// When the file cannot be read, or with everything that is wrong with it or its assets.
pub fn load_scene(path: &Path) -> Result<LoadedScene, LoadError> {
    load_scene_with(path, &[])
}

/// As [`load_scene`], with single values of the file replaced, see [`settings::apply`].
///
/// # Errors
/// As [`load_scene`], or when a setting cannot be made.
pub fn load_scene_with(path: &Path, settings: &[String]) -> Result<LoadedScene, LoadError> {
    let text = fs::read_to_string(path).map_err(|cause| LoadError::Read {
        path: path.into(),
        cause,
    })?;
    if settings.is_empty() {
        return load_text(text, path);
    }
    load_text(settings::apply(&text, settings)?, path)
}

/// Builds a scene from a text; `path` names it in messages, and asset paths are relative to its folder.
///
/// # Errors
/// Everything that is wrong with the text or its assets.
pub fn load_text(text: String, path: &Path) -> Result<LoadedScene, LoadError> {
    let wrong = |errors| LoadError::Scene {
        path: path.into(),
        errors,
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let file = SceneFile::parse(&text).map_err(wrong)?;
    let (scene, report) = build_with_meshes(
        &file,
        &mut |name| read_asset(&folder.join(name)),
        &mut |name| read_mesh(&folder.join(name)),
    )
    .map_err(wrong)?;
    Ok(LoadedScene {
        scene,
        file,
        text,
        report,
    })
}

fn read_mesh(path: &Path) -> Result<TriangleMesh, Box<dyn Error + Send + Sync>> {
    let bytes = fs::read(path).map_err(|cause| MeshFile {
        path: path.into(),
        cause,
    })?;
    Ok(assets::mesh::read(&path.display().to_string(), &bytes)?)
}

fn read_asset(path: &Path) -> Result<(Gaussians, ReadReport), Box<dyn Error + Send + Sync>> {
    let bytes = fs::read(path).map_err(|cause| AssetFile {
        path: path.into(),
        cause,
    })?;
    Ok(assets::read(&path.display().to_string(), &bytes)?)
}

#[cfg(test)]
mod tests {
    use cosplat_sim_core::scene::ColliderShape;

    use super::*;
    use crate::assets::{generate, ply};

    const TEXT: &str = r#"version = 1
[[objects]]
name = "vase"
path = "assets/vase.ply"
fidelity = "static"
"#;

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().expect("a temporary folder")
    }

    #[test]
    fn assets_are_found_beside_the_scene_file() {
        let folder = folder();
        let vase = generate::builtin("vase").expect("known");
        fs::create_dir(folder.path().join("assets")).expect("made");
        fs::write(folder.path().join("assets/vase.ply"), ply::write(&vase)).expect("written");
        let path = folder.path().join("scene.toml");
        fs::write(&path, TEXT).expect("written");
        let loaded = load_scene(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.scene.gaussians.len(), vase.len());
        assert_eq!(loaded.text, TEXT);
        assert_eq!(loaded.report.assets[0].gaussians, vase.len());
    }

    #[test]
    fn meshes_of_colliders_are_found_beside_the_scene_file() {
        let folder = folder();
        let path = folder.path().join("scene.toml");
        let text = r#"version = 1
[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.1 }
material = "jelly"
[[colliders]]
name = "ramp"
shape = "mesh"
path = "ramp.obj"
scale = 2
"#;
        fs::write(&path, text).expect("written");
        let error = load_scene(&path).expect_err("no mesh").to_string();
        for words in ["line 6", "cannot read mesh", "ramp.obj: No such"] {
            assert!(error.contains(words), "{words:?} not in {error}");
        }
        let ramp = "v 0 -1 0\nv 1 -1 0\nv 0 -1 -1\nf 1 2 3\n";
        fs::write(folder.path().join("ramp.obj"), ramp).expect("written");
        let loaded = load_scene(&path).unwrap_or_else(|e| panic!("{e}"));
        let ColliderShape::Mesh(mesh) = &loaded.scene.colliders[0].shape else {
            panic!("{:?}", loaded.scene.colliders)
        };
        assert_eq!(mesh.points[1], [2.0, -2.0, 0.0]);
        fs::write(folder.path().join("ramp.obj"), "nonsense").expect("written");
        let error = load_scene(&path).expect_err("no OBJ").to_string();
        assert!(error.contains("ramp.obj: 0 triangles"), "{error}");
    }

    #[test]
    fn messages_name_the_files() {
        let folder = folder();
        let path = folder.path().join("scene.toml");
        let missing = load_scene(&path).expect_err("no such file").to_string();
        assert!(missing.contains("scene.toml: No such file"), "{missing}");
        fs::write(&path, TEXT).expect("written");
        let error = load_scene(&path).expect_err("no asset").to_string();
        for words in [
            "scene.toml has 1 error",
            "line 4, column 8",
            "assets/vase.ply: No such",
        ] {
            assert!(error.contains(words), "{words:?} not in {error}");
        }
        fs::create_dir(folder.path().join("assets")).expect("made");
        fs::write(folder.path().join("assets/vase.ply"), "ply\nnonsense\n").expect("written");
        let error = load_scene(&path).expect_err("no PLY").to_string();
        assert!(error.contains("assets/vase.ply: header line 2"), "{error}");
    }
}
