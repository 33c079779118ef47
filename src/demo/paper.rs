//! The scenes of the paper, and some that show where its contact method fails: texts, cameras, moments to look at.

use std::path::{Path, PathBuf};

use anyhow::Context;
use cosplat_renderer::camera::Orbit;

/// One scene that `cosplat demo --scene` knows.
pub struct PaperScene {
    /// Name on the command line.
    pub name: &'static str,
    /// The scene file.
    text: &'static str,
    /// The captured splat that it needs, as the scene file names it.
    splat: Option<&'static str>,
    /// Simulated seconds that show what happens.
    pub duration: f64,
    /// Fractions of the duration at which the sheet of `--compare` has pictures.
    pub moments: [f64; COLUMNS],
    /// Camera angles around and above [degrees].
    angles: [f32; 2],
    /// Point looked at [m].
    target: [f32; 3],
    /// From there to the camera [m].
    distance: f32,
}

/// Pictures in a row of a sheet.
pub const COLUMNS: usize = 4;

/// All of them.
pub const SCENES: &[PaperScene] = &[
    PaperScene {
        name: "fig2",
        text: include_str!("../../scenes/paper/fig2.toml"),
        splat: None,
        duration: 0.6,
        moments: [0.17, 0.44, 0.67, 1.0],
        angles: [12.0, 14.0],
        target: [0.06, 0.09, 0.0],
        distance: 0.75,
    },
    PaperScene {
        name: "fig3",
        text: include_str!("../../scenes/paper/fig3.toml"),
        splat: None,
        duration: 1.2,
        moments: [0.0, 0.25, 0.4, 1.0],
        angles: [12.0, 14.0],
        target: [0.0, 0.17, 0.0],
        distance: 1.0,
    },
    PaperScene {
        name: "fig4",
        text: include_str!("../../scenes/paper/fig4.toml"),
        splat: None,
        duration: 1.0,
        moments: [0.0, 0.06, 0.15, 1.0],
        angles: [0.0, 14.0],
        target: [0.0, 0.12, 0.0],
        distance: 0.9,
    },
    PaperScene {
        name: "fig5",
        text: include_str!("../../scenes/paper/fig5.toml"),
        splat: None,
        duration: 0.2,
        moments: [0.0, 0.25, 0.5, 1.0],
        angles: [0.0, 0.0],
        target: [0.0, 0.0, 0.0],
        distance: 0.75,
    },
    PaperScene {
        name: "plant_push",
        text: include_str!("../../scenes/paper/plant_push.toml"),
        splat: Some("plant.splat"),
        duration: 1.2,
        moments: [0.08, 0.3, 0.5, 1.0],
        angles: [20.0, 12.0],
        target: [0.0, 0.5, 0.0],
        distance: 2.3,
    },
    PaperScene {
        name: "plants_collide",
        text: include_str!("../../scenes/paper/plants_collide.toml"),
        splat: Some("plant.splat"),
        duration: 0.8,
        moments: [0.0, 0.15, 0.35, 1.0],
        angles: [0.0, 12.0],
        target: [0.0, 0.45, 0.0],
        distance: 2.6,
    },
    PaperScene {
        name: "playbot",
        text: include_str!("../../scenes/paper/playbot.toml"),
        splat: Some("playbot_lod3.ply"),
        duration: 0.6,
        moments: [0.0, 0.15, 0.4, 1.0],
        angles: [0.0, 10.0],
        target: [0.0, 0.55, 0.0],
        distance: 2.4,
    },
    PaperScene {
        name: "rods",
        text: include_str!("../../scenes/paper/rods.toml"),
        splat: None,
        duration: 0.6,
        moments: [0.0, 0.3, 0.6, 1.0],
        angles: [0.0, 10.0],
        target: [0.0, 0.0, 0.0],
        distance: 2.2,
    },
    PaperScene {
        name: "corners",
        text: include_str!("../../scenes/paper/corners.toml"),
        splat: None,
        duration: 0.4,
        moments: [0.0, 0.27, 0.46, 1.0],
        angles: [0.0, 0.0],
        target: [0.0, 0.0, 0.0],
        distance: 2.2,
    },
    PaperScene {
        name: "off_centre",
        text: include_str!("../../scenes/paper/off_centre.toml"),
        splat: None,
        duration: 0.5,
        moments: [0.0, 0.2, 0.5, 1.0],
        angles: [0.0, 0.0],
        target: [0.0, 0.0, 0.0],
        distance: 2.2,
    },
];

/// Names of all of them.
pub fn names() -> Vec<&'static str> {
    SCENES.iter().map(|scene| scene.name).collect()
}

/// The scene of that name.
pub fn find(name: &str) -> anyhow::Result<&'static PaperScene> {
    let found = SCENES.iter().find(|scene| scene.name == name);
    found.with_context(|| {
        format!(
            "scene \"{name}\" does not exist, expected one of {}",
            names().join(", ")
        )
    })
}

impl PaperScene {
    /// The scene file, with the path of its splat filled in; `splat` replaces the file that is looked for.
    ///
    /// # Errors
    /// When the splat is not found.
    pub fn text(&self, splat: Option<&Path>) -> anyhow::Result<String> {
        let Some(file) = self.splat else {
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

    /// Where it is looked at from.
    pub fn orbit(&self) -> Orbit {
        Orbit {
            azimuth: self.angles[0].to_radians(),
            elevation: self.angles[1].to_radians(),
            distance: Some(self.distance),
            target: Some(self.target.into()),
        }
    }

    /// The camera as arguments of `cosplat view`.
    pub fn view_arguments(&self) -> Vec<String> {
        let mut arguments = vec![
            format!("--azimuth={}", self.angles[0]),
            format!("--elevation={}", self.angles[1]),
            format!("--distance={}", self.distance),
            "--target".to_owned(),
        ];
        arguments.extend(self.target.map(|x| x.to_string()));
        arguments
    }
}

/// The file where it may lie: here, in the folder of test data, or beside the checkout.
fn nearby(file: &str) -> Option<PathBuf> {
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

/// The same scene under another contact method.
pub fn with_contact(text: &str, method: &str) -> String {
    let mut top = true;
    let mut lines = Vec::new();
    for line in text.lines() {
        top &= !line.starts_with('[');
        if top && line.starts_with("contact ") {
            continue;
        }
        lines.push(line.to_owned());
        if top && line.starts_with("version") {
            lines.push(format!("contact = \"{method}\""));
        }
    }
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Replaced where there is one, added where there is none.
    #[test]
    fn the_contact_method_is_replaced_or_added() {
        let bare = "version = 1\ndx = 1\n[[objects]]\ncontact = 3\n";
        let once = with_contact(bare, "single_field");
        assert_eq!(
            once,
            "version = 1\ncontact = \"single_field\"\ndx = 1\n[[objects]]\ncontact = 3\n"
        );
        assert_eq!(
            with_contact(&once, "com_sphere"),
            once.replace("single_field", "com_sphere")
        );
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
