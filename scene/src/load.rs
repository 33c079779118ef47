//! Reads a scene file and the assets it names from disk.

use std::{
    cell::RefCell,
    collections::BTreeMap,
    error::Error,
    io,
    path::{Path, PathBuf},
};

use cosplat_sim_core::{
    Scene,
    scene::{Solver, TriangleMesh},
};

use crate::{
    assets::{
        self, Gaussians, ReadReport,
        objects::{Objects, ObjectsError},
    },
    scene_file::{BuildReport, SceneErrors, SceneFile, build_with_files, count_of_errors},
    settings::{self, SettingError},
    sources::{HeldFile, SourceFile, SourceKind},
};
use cosplat_files::reading;

/// A scene file, built.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// The file as parsed.
    pub file: SceneFile,
    /// The file's text, with the grid of each object that was chosen because the file does not say: what it means is so the same
    /// in every version.
    pub text: String,
    /// Warnings and what became of the assets.
    pub report: BuildReport,
    /// The files that were read beside it, each once, in the order of reading.
    pub sources: Vec<SourceFile>,
}

impl LoadedScene {
    /// Where all files lie that the scene at `path` was made of, its own first.
    pub fn files(&self, path: &Path) -> Vec<PathBuf> {
        let sources = self.sources.iter().map(|source| source.path.clone());
        std::iter::once(path.to_owned()).chain(sources).collect()
    }
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
    #[error("{} has {}:\n{errors}", path.display(), count_of_errors(errors.0.len()))]
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
    let text = reading::read_text(path).map_err(|cause| LoadError::Read {
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
    let folder = path.parent().unwrap_or(Path::new(""));
    let file = parse(&text, path)?;
    build(text, file, path, &|name| {
        let path = folder.join(name);
        let content = reading::read(&path, reading::LARGEST_DATA);
        (path, content)
    })
}

/// Builds a scene from a text and from files that are held in memory, by the names in the text; `path` names it in
/// messages. No other file is opened. Such a text says which objects have grids of their own: nothing is chosen.
///
/// # Errors
/// As [`load_text`]; a file that is not among `files` counts as one that cannot be read.
pub fn load_held(
    text: String,
    path: &Path,
    files: &BTreeMap<String, HeldFile>,
) -> Result<LoadedScene, LoadError> {
    let mut file = parse(&text, path)?;
    for object in &mut file.objects {
        object.solver.get_or_insert(Solver::Spatial);
    }
    build(text, file, path, &|name| match files.get(name) {
        Some(file) => (file.path.clone(), Ok(file.content.to_vec())),
        None => (name.into(), Err(io::ErrorKind::NotFound.into())),
    })
}

fn parse(text: &str, path: &Path) -> Result<SceneFile, LoadError> {
    SceneFile::parse(text).map_err(|errors| LoadError::Scene {
        path: path.into(),
        errors,
    })
}

/// Where a file was looked for, and its content.
type Opened = (PathBuf, io::Result<Vec<u8>>);

/// Builds the scene of a text that was parsed, with what `open` finds by a name in it: a path and the content there.
fn build(
    text: String,
    file: SceneFile,
    path: &Path,
    open: &dyn Fn(&str) -> Opened,
) -> Result<LoadedScene, LoadError> {
    let wrong = |errors| LoadError::Scene {
        path: path.into(),
        errors,
    };
    let sources = RefCell::new(Vec::<SourceFile>::new());
    let read = |name: &str| {
        let (path, content) = open(name);
        let content = content.map_err(|cause| (path.clone(), cause))?;
        let mut sources = sources.borrow_mut();
        if sources.iter().all(|known| known.name != name) {
            sources.push(SourceFile::of(SourceKind::Asset, name, &path, &content));
        }
        Ok((path, content))
    };
    let (scene, report) = build_with_files(
        &file,
        &mut |name| read_asset(read(name)),
        &mut |name| read_mesh(read(name)),
        &mut |name, asset, rows| {
            let sources = sources.borrow();
            let asset = sources.iter().find(|known| known.name == asset);
            let hash = asset.map_or(0, |asset| asset.hash);
            drop(sources);
            read_objects(read(name), hash, rows)
        },
    )
    .map_err(wrong)?;
    let stated = chosen_as_settings(&file, &report);
    let text = match stated.is_empty() {
        true => text,
        false => settings::apply(&text, &stated)?,
    };
    Ok(LoadedScene {
        scene,
        file,
        text,
        report,
        sources: sources.into_inner(),
    })
}

/// What was chosen as values of the file. A text that does not say means the spatial grid, but a clone says what its source says.
fn chosen_as_settings(file: &SceneFile, report: &BuildReport) -> Vec<String> {
    let entries = file.objects.iter().zip(&report.chosen).enumerate();
    let stated = entries.filter_map(|(n, (entry, chosen))| {
        let chosen = (*chosen)?;
        let says = chosen == Solver::Lagrangian || entry.is_clone;
        says.then(|| format!("objects.{n}.solver=\"{}\"", chosen.name()))
    });
    stated.collect()
}

/// A file's path and content, or its path and why it has none.
type Found = Result<(PathBuf, Vec<u8>), (PathBuf, io::Error)>;

fn read_mesh(found: Found) -> Result<TriangleMesh, Box<dyn Error + Send + Sync>> {
    let (path, bytes) = found.map_err(|(path, cause)| MeshFile { path, cause })?;
    Ok(assets::mesh::read(&path.display().to_string(), &bytes)?)
}

fn read_asset(found: Found) -> Result<(Gaussians, ReadReport), Box<dyn Error + Send + Sync>> {
    let (path, bytes) = found.map_err(|(path, cause)| AssetFile { path, cause })?;
    Ok(assets::read(&path.display().to_string(), &bytes)?)
}

fn read_objects(
    found: Found,
    asset_hash: u64,
    rows: usize,
) -> Result<Objects, Box<dyn Error + Send + Sync>> {
    let (path, bytes) = found.map_err(|(path, cause)| ObjectsError::Read { path, cause })?;
    let file = path.display().to_string();
    Ok(Objects::parse(&file, &bytes, asset_hash, rows)?)
}

#[cfg(test)]
mod tests {
    use std::fs;

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
        let [source] = &loaded.sources[..] else {
            panic!("{:?}", loaded.sources)
        };
        assert_eq!(source.name, "assets/vase.ply");
        assert_eq!(source.path, folder.path().join("assets/vase.ply"));
        assert_eq!(source.bytes, ply::write(&vase).len() as u64);
    }

    #[test]
    fn a_scene_can_be_built_from_memory_alone() {
        let vase = generate::builtin("vase").expect("known");
        let held = HeldFile {
            path: "/nowhere/vase.ply".into(),
            content: ply::write(&vase).into(),
        };
        let files = BTreeMap::from([("assets/vase.ply".to_owned(), held)]);
        let path = Path::new("run.mcap");
        let loaded = load_held(TEXT.into(), path, &files).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.scene.gaussians.len(), vase.len());
        assert_eq!(loaded.sources[0].path, Path::new("/nowhere/vase.ply"));
        let error = load_held(TEXT.into(), path, &BTreeMap::new()).expect_err("no vase");
        let words = error.to_string();
        assert!(
            words.contains("cannot read asset assets/vase.ply"),
            "{words}"
        );
    }

    /// The objects of the next test as tables.
    const TABLES: &str = r#"version = 1 # with a remark
dx = 0.05
[[objects]]
name = "a"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
[objects.material]
preset = "jelly"
[[objects]]
name = "b"
clone = "a"
translation = [1, 0, 0]
[[objects]]
name = "c"
clone = "a"
translation = [2, 0, 0]
material = "dry_sand"
[[objects]]
name = "d"
clone = "a"
translation = [3, 0, 0]
solver = "spatial"
"#;

    #[test]
    fn the_text_of_a_scene_keeps_what_was_chosen() {
        let text = "version = 1 # with a remark\ndx = 0.05\n\
            objects = [{ name = \"a\", shape = { kind = \"box\", size = [0.2, 0.2, 0.2] }, material = \"jelly\" },\n\
            { name = \"b\", clone = \"a\", translation = [1, 0, 0] },\n\
            { name = \"c\", clone = \"a\", translation = [2, 0, 0], material = \"dry_sand\" },\n\
            { name = \"d\", clone = \"a\", translation = [3, 0, 0], solver = \"spatial\" }]\n";
        let own = [
            Solver::Lagrangian,
            Solver::Lagrangian,
            Solver::Spatial,
            Solver::Spatial,
        ];
        let solvers = |loaded: &LoadedScene| -> Vec<Solver> {
            loaded.scene.objects.iter().map(|o| o.solver).collect()
        };
        let path = Path::new("scene.toml");
        for text in [text, TABLES].map(str::to_owned) {
            let loaded = load_text(text.clone(), path).unwrap_or_else(|e| panic!("{text}{e}"));
            assert_eq!(solvers(&loaded), own);
            assert!(loaded.text.starts_with("version = 1 # with a remark\n"));
            let none = BTreeMap::new();
            let again = load_held(loaded.text.clone(), path, &none);
            let again = again.unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(solvers(&again), own, "{}", loaded.text);
            assert_eq!(again.text, loaded.text);
            // A recording of a time when nothing was chosen.
            let before = load_held(text, path, &none).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(solvers(&before), [Solver::Spatial; 4]);
        }
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
    fn what_is_no_plain_file_is_refused_by_name() {
        let folder = folder();
        let path = folder.path().join("scene.toml");
        let mesh = "[[colliders]]\nname = \"ramp\"\nshape = \"mesh\"\npath = \"/dev/zero\"\n";
        for text in [
            TEXT.replace("assets/vase.ply", "/dev/zero"),
            TEXT.replace("path = \"assets/vase.ply\"", "builtin = \"vase\"") + mesh,
        ] {
            fs::write(&path, &text).expect("written");
            let error = load_scene(&path).expect_err("a device").to_string();
            assert!(error.contains("/dev/zero: a device"), "{error}");
        }
        let error = load_scene(Path::new("/dev/zero")).expect_err("a device");
        assert!(error.to_string().contains("a plain file"), "{error}");
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
