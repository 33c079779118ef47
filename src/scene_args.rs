//! Which scene a command is for.

use std::path::PathBuf;

use cosplat_scene::load::{LoadError, LoadedScene, load_scene_with};

/// A scene file, with values of it replaced.
#[derive(clap::Args)]
pub struct SceneArgs {
    /// Scene file.
    #[arg(value_name = "SCENE")]
    pub path: PathBuf,
    /// Replace or add a value of the file, like dx=0.01, objects.0.friction=0.2 or 'colliders.0={name="floor", normal=[0, 1, 0]}';
    /// may be given several times.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
}

impl SceneArgs {
    /// Reads it.
    ///
    /// # Errors
    /// When a file cannot be read, a setting fits nothing, or what comes of them is no scene.
    pub fn load(&self) -> Result<LoadedScene, LoadError> {
        load_scene_with(&self.path, &self.settings)
    }
}
