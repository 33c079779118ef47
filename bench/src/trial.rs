//! One run of `cosplat simulate` in a child process, so that whoever doubts a figure can have it again by hand.

use std::{
    fmt::Display,
    fs,
    io::{BufRead, BufReader},
    process::{Command, Stdio},
};

use anyhow::{Context, anyhow, bail, ensure};
use serde_json::Value;

/// A scene file of the repository, compiled in.
#[derive(Clone, Copy, Debug)]
pub struct SceneText {
    /// Where it lies in the repository.
    pub path: &'static str,
    /// What it says.
    pub text: &'static str,
}

/// `scene_text!("validate/bar")` is `scenes/validate/bar.toml` of the repository.
macro_rules! scene_text {
    ($name:literal) => {
        crate::trial::SceneText {
            path: concat!("scenes/", $name, ".toml"),
            text: include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../scenes/",
                $name,
                ".toml"
            )),
        }
    };
}
pub(crate) use scene_text;

/// A run to be made.
#[derive(Clone, Debug)]
pub struct Trial {
    scene: SceneText,
    duration: f64,
    settings: Vec<String>,
    options: Vec<String>,
    /// Files beside the scene, with their texts.
    beside: Vec<(&'static str, &'static str)>,
}

impl Trial {
    /// A run of `duration` simulated seconds.
    pub fn new(scene: &SceneText, duration: f64) -> Self {
        Self {
            scene: *scene,
            duration,
            settings: Vec::new(),
            options: Vec::new(),
            beside: Vec::new(),
        }
    }

    /// Replaces a value of the scene file, see `cosplat simulate --set`.
    pub fn set(mut self, key: &str, value: impl Display) -> Self {
        self.settings.push(format!("{key}={value}"));
        self
    }

    /// Adds an option of `cosplat simulate`, like `--f64` or `--threads=1`.
    pub fn option(mut self, text: &str) -> Self {
        self.options.push(text.to_owned());
        self
    }

    /// Puts a file of a name beside the scene, which lies there in the repository as well.
    pub fn beside(mut self, name: &'static str, text: &'static str) -> Self {
        self.beside.push((name, text));
        self
    }

    /// The command that repeats it, as a user types it in the repository.
    pub fn command(&self) -> String {
        let mut words = vec!["cosplat".to_owned()];
        words.extend(self.arguments(self.scene.path));
        words
            .iter()
            .map(|word| quoted(word))
            .collect::<Vec<_>>()
            .join(" ")
    }

    fn arguments(&self, scene: &str) -> Vec<String> {
        let mut words = vec!["simulate".to_owned(), scene.to_owned()];
        words.extend(["--duration".to_owned(), self.duration.to_string()]);
        for setting in &self.settings {
            words.extend(["--set".to_owned(), setting.clone()]);
        }
        words.extend(self.options.iter().cloned());
        words
    }

    /// Makes the run.
    ///
    /// # Errors
    /// When the run fails; with what it printed.
    pub fn run(&self) -> anyhow::Result<Outcome> {
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let name = self.scene.path.rsplit('/').next().unwrap_or("scene.toml");
        let scene = folder.path().join(name);
        let report = folder.path().join("report.jsonl");
        fs::write(&scene, self.scene.text)
            .with_context(|| format!("cannot write {}", scene.display()))?;
        for (name, text) in &self.beside {
            let path = folder.path().join(name);
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
        }
        let run = Command::new(std::env::current_exe().context("cannot find this program")?)
            .args(self.arguments(&scene.display().to_string()))
            .arg("--report")
            .arg(&report)
            .arg("--json")
            .stdin(Stdio::null())
            .output()
            .context("cannot start cosplat simulate")?;
        ensure!(
            run.status.success(),
            "{} failed: {}",
            self.command(),
            String::from_utf8_lossy(&run.stderr).trim()
        );
        let file =
            fs::File::open(&report).with_context(|| format!("cannot read {}", report.display()))?;
        let frames = BufReader::new(file)
            .lines()
            .map(|line| Ok(serde_json::from_str(&line?)?))
            .collect::<anyhow::Result<Vec<Value>>>()?;
        if frames.is_empty() {
            bail!("{} reported no frame", self.command());
        }
        let summary = serde_json::from_slice(&run.stdout).context("the summary is not JSON")?;
        Ok(Outcome { frames, summary })
    }
}

/// Quoted for a shell where that is needed.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,+:".contains(c);
    if word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// What a run reported.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The lines of the report, one per frame.
    pub frames: Vec<Value>,
    /// The summary.
    pub summary: Value,
}

impl Outcome {
    /// Time [s] and value at a JSON pointer like `/objects/0/com/1`, for all frames that have the value.
    pub fn series(&self, pointer: &str) -> Vec<(f64, f64)> {
        let at = |frame: &Value| {
            Some((
                frame["sim_time"].as_f64()?,
                frame.pointer(pointer)?.as_f64()?,
            ))
        };
        self.frames.iter().filter_map(at).collect()
    }

    /// The value at a JSON pointer in the last frame.
    ///
    /// # Errors
    /// When it has none.
    pub fn last(&self, pointer: &str) -> anyhow::Result<f64> {
        let frame = self.frames.last();
        frame
            .and_then(|frame| frame.pointer(pointer)?.as_f64())
            .ok_or_else(|| anyhow!("the last frame has no number at {pointer}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_can_be_pasted_into_a_shell() {
        let scene = SceneText {
            path: "scenes/validate/bar.toml",
            text: "",
        };
        let trial = Trial::new(&scene, 0.5)
            .set("dx", 0.01)
            .set("objects.0.material", "{ preset = \"rubber\" }")
            .option("--f64");
        assert_eq!(
            trial.command(),
            "cosplat simulate scenes/validate/bar.toml --duration 0.5 --set dx=0.01 \
             --set 'objects.0.material={ preset = \"rubber\" }' --f64"
        );
    }
}
