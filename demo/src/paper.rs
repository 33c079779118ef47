//! The scenes of the paper, and some that show where its contact method fails.

use std::path::{Path, PathBuf};

use anyhow::Context;
use cosplat_renderer::camera::Orbit;
use cosplat_scene::scene_file::{AssetSource, SceneFile, View};

/// Their names on the command line, and their files.
const SCENES: [(&str, &str); 10] = [
    ("fig2", include_str!("../../scenes/paper/fig2.toml")),
    ("fig3", include_str!("../../scenes/paper/fig3.toml")),
    ("fig4", include_str!("../../scenes/paper/fig4.toml")),
    ("fig5", include_str!("../../scenes/paper/fig5.toml")),
    (
        "plant_push",
        include_str!("../../scenes/paper/plant_push.toml"),
    ),
    (
        "plants_collide",
        include_str!("../../scenes/paper/plants_collide.toml"),
    ),
    ("playbot", include_str!("../../scenes/paper/playbot.toml")),
    ("rods", include_str!("../../scenes/paper/rods.toml")),
    ("corners", include_str!("../../scenes/paper/corners.toml")),
    (
        "off_centre",
        include_str!("../../scenes/paper/off_centre.toml"),
    ),
];

/// One scene that `cosplat demo --scene` knows.
pub struct PaperScene {
    /// Name on the command line.
    pub name: &'static str,
    /// How it is shown.
    pub view: View,
    /// The scene file.
    text: &'static str,
    /// The captured splat that it needs, as the scene file names it.
    splat: Option<String>,
}

/// Names of all of them.
pub fn names() -> Vec<&'static str> {
    SCENES.iter().map(|(name, _)| *name).collect()
}

/// The scene of that name.
pub fn find(name: &str) -> anyhow::Result<PaperScene> {
    let found = SCENES.iter().find(|(known, _)| *known == name);
    let &(name, text) = found.with_context(|| {
        format!(
            "scene \"{name}\" does not exist, expected one of {}",
            names().join(", ")
        )
    })?;
    let file = SceneFile::parse(text).with_context(|| format!("scene \"{name}\" is wrong"))?;
    let splat = file.assets.iter().find_map(|asset| match &asset.source {
        AssetSource::Path(path) => Some(path.clone()),
        AssetSource::Builtin(_) => None,
    });
    Ok(PaperScene {
        name,
        view: file
            .view
            .with_context(|| format!("scene \"{name}\" has no [view]"))?,
        text,
        splat,
    })
}

impl PaperScene {
    /// The scene file, with the path of its splat filled in; `splat` replaces the file that is looked for.
    ///
    /// # Errors
    /// When the splat is not found.
    pub fn text(&self, splat: Option<&Path>) -> anyhow::Result<String> {
        let Some(file) = &self.splat else {
            anyhow::ensure!(
                splat.is_none(),
                "scene \"{}\" is generated and takes no --splat",
                self.name
            );
            return Ok(self.text.to_owned());
        };
        let path = match splat {
            Some(path) => path.to_owned(),
            None => nearby(file).with_context(|| {
                format!(
                    "scene \"{}\" shows the capture {file}: give its place with --splat FILE",
                    self.name
                )
            })?,
        };
        let path = path
            .canonicalize()
            .with_context(|| format!("cannot find {}", path.display()))?;
        let path = path
            .to_str()
            .with_context(|| format!("{} is not UTF-8, rename it", path.display()))?;
        Ok(self
            .text
            .replace(&format!("\"{file}\""), &format!("{path:?}")))
    }
}

/// Where a scene is looked at from.
pub fn orbit(view: &View) -> Orbit {
    Orbit {
        azimuth: view.azimuth.to_radians() as f32,
        elevation: view.elevation.to_radians() as f32,
        distance: Some(view.distance as f32),
        target: Some(view.target.map(|x| x as f32).into()),
    }
}

/// The camera as arguments of `cosplat view`.
pub fn view_arguments(view: &View) -> Vec<String> {
    let mut arguments = vec![
        format!("--azimuth={}", view.azimuth),
        format!("--elevation={}", view.elevation),
        format!("--distance={}", view.distance),
        "--target".to_owned(),
    ];
    arguments.extend(view.target.map(|x| x.to_string()));
    arguments
}

/// The file where it may lie: here, in the folder of test data, or beside the checkout.
pub(crate) fn nearby(file: &str) -> Option<PathBuf> {
    let data = std::env::var_os("COSPLAT_TEST_DATA").map(PathBuf::from);
    let folders = [
        Some(PathBuf::from(".")),
        data,
        Some(PathBuf::from("../shared/data")),
    ];
    let paths = folders
        .into_iter()
        .flatten()
        .map(|folder| folder.join(file));
    paths.into_iter().find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_shown_and_names_its_capture() {
        for name in names() {
            let scene = find(name).unwrap_or_else(|e| panic!("{e:#}"));
            let captured = ["plant_push", "plants_collide", "playbot"].contains(&name);
            assert_eq!(scene.splat.is_some(), captured, "{name}");
        }
    }

    #[test]
    fn a_splat_is_asked_for_only_where_one_is_needed() {
        let generated = find("fig5").expect("listed");
        assert!(generated.text(None).is_ok());
        let error = generated
            .text(Some(Path::new("x.ply")))
            .expect_err("no use");
        assert!(error.to_string().contains("fig5"), "{error}");
        assert!(find("fig1").is_err());
    }
}
