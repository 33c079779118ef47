//! The runs of a recording: what opens one, and what it lacks to be simulated again.

use std::collections::BTreeMap;
use std::str::FromStr;

use cosplat_ipc::schema::SceneHeader;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::files::{ASSET, CHECKPOINT};
use crate::messages::JournalEntry;

/// What a run's metadata say.
#[derive(Clone, Debug, PartialEq)]
pub struct RunHeader {
    /// Name of the session.
    pub session: String,
    /// The scene as it was published; its `epoch` identifies the run.
    pub scene: SceneHeader,
    /// Release of the recorder.
    pub program_version: String,
    /// Unix time at which recording of the run began [ns].
    pub wall_time_ns: u64,
    /// Names of the objects, by id.
    pub objects: Vec<String>,
    /// The files that the server read; `None` in recordings of older recorders.
    pub files: Option<Vec<RunFile>>,
}

/// A file that the server of a run read beside the scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFile {
    /// What it was read for.
    pub kind: FileKind,
    /// As the scene names it.
    pub name: String,
    /// Its length [byte].
    pub bytes: u64,
    /// XXH3 of its content, 64 bits, seed 0.
    pub hash: u64,
    /// Name of its attachment, or why there is none.
    pub attachment: Result<String, String>,
}

/// What a file was read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A splat or mesh that the scene names.
    Asset,
    /// The checkpoint that the run began with.
    Checkpoint,
    /// Something that this program does not know.
    Unknown,
}

/// Why a run cannot be simulated again.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lack {
    /// There is no metadata record for it.
    #[error("epoch {epoch:016x} has no metadata: the server published no scene")]
    Metadata {
        /// Its epoch.
        epoch: u64,
    },
    /// The recorder did not keep files.
    #[error(
        "an older recorder made it, which kept neither the files of the scene nor the place of commands"
    )]
    Format,
    /// There is no scene text.
    #[error("the recording has no scene.toml for it")]
    Scene,
    /// A file is not there.
    #[error("the file {name:?} is not in the recording: {reason}")]
    File {
        /// As the scene names it.
        name: String,
        /// Why not.
        reason: String,
    },
    /// There is nothing to compare.
    #[error("no frame of it is in the recording")]
    Frames,
    /// Nothing tells where its objects were.
    #[error("none of its {count} objects is in the recording")]
    Objects {
        /// How many the scene has.
        count: u32,
    },
    /// Commands are not there.
    #[error(
        "{count} commands before step {step} are not in the recording, the first is number {first}"
    )]
    Commands {
        /// How many the run applied before the first missing one.
        first: u64,
        /// How many are missing.
        count: u64,
        /// Step of the next one that is there.
        step: u64,
    },
}

impl RunHeader {
    /// Reads the values of a metadata record.
    ///
    /// # Errors
    /// A sentence that names the value that is missing or cannot be read.
    pub fn parse(values: &BTreeMap<String, String>) -> Result<Self, String> {
        let values = Values(values);
        let scene = SceneHeader {
            epoch: values.hex("epoch")?,
            scene_hash: values.hex("scene_hash")?,
            frame_rate: values.number("frame_rate")?,
            dx: values.number("dx")?,
            gravity: values.list("gravity")?,
            bounds_min: values.list("bounds_min")?,
            bounds_max: values.list("bounds_max")?,
            gaussian_count: values.number("gaussian_count")?,
            particle_count: values.number("particle_count")?,
            object_count: values.number("object_count")?,
            sh_degree: values.number("sh_degree")?,
            feature_dim: values.number("feature_dim")?,
            reserved: 0,
        };
        let names = (0..).map_while(|id| values.0.get(&format!("object.{id}.name")).cloned());
        let files = match values.0.contains_key("file_count") {
            false => None,
            true => {
                let count = values.number("file_count")?;
                Some(
                    (0..count)
                        .map(|n| values.file(n))
                        .collect::<Result<_, _>>()?,
                )
            }
        };
        Ok(Self {
            session: values.text("session")?.to_owned(),
            scene,
            program_version: values.text("program_version")?.to_owned(),
            wall_time_ns: values.number("wall_time_ns")?,
            objects: names.collect(),
            files,
        })
    }

    /// The name of an object, or its id where it has none.
    pub fn object(&self, id: u32) -> String {
        match self.objects.get(id as usize) {
            Some(name) => name.clone(),
            None => format!("number {id}"),
        }
    }

    /// What is missing at the run's start, given the attachments so far: whether there is a scene text, and which files.
    pub fn lacks(&self, has_text: bool, has: impl Fn(&str) -> bool) -> Vec<Lack> {
        let Some(files) = &self.files else {
            return vec![Lack::Format];
        };
        let mut lacks = Vec::new();
        if !has_text {
            lacks.push(Lack::Scene);
        }
        for file in files {
            let reason = match &file.attachment {
                Ok(name) if has(name) => continue,
                Ok(name) => format!("its attachment {name} was lost"),
                Err(reason) => reason.clone(),
            };
            lacks.push(Lack::File {
                name: file.name.clone(),
                reason,
            });
        }
        lacks
    }
}

/// Texts of a metadata record.
struct Values<'a>(&'a BTreeMap<String, String>);

impl Values<'_> {
    fn text(&self, key: &str) -> Result<&str, String> {
        let value = self.0.get(key).map(String::as_str);
        value.ok_or_else(|| format!("the metadata have no {key:?}"))
    }

    fn number<T: FromStr>(&self, key: &str) -> Result<T, String> {
        let text = self.text(key)?;
        let number = text.parse().ok();
        number.ok_or_else(|| format!("{key:?} of the metadata is {text:?}, expected a number"))
    }

    fn hex(&self, key: &str) -> Result<u64, String> {
        let text = self.text(key)?;
        u64::from_str_radix(text, 16).map_err(|_| {
            format!("{key:?} of the metadata is {text:?}, expected 16 hexadecimal digits")
        })
    }

    fn list<T: DeserializeOwned>(&self, key: &str) -> Result<T, String> {
        let text = self.text(key)?;
        serde_json::from_str(text)
            .map_err(|_| format!("{key:?} of the metadata is {text:?}, expected three numbers"))
    }

    fn file(&self, n: u64) -> Result<RunFile, String> {
        let key = |field: &str| format!("file.{n}.{field}");
        Ok(RunFile {
            kind: match self.text(&key("kind"))? {
                ASSET => FileKind::Asset,
                CHECKPOINT => FileKind::Checkpoint,
                _ => FileKind::Unknown,
            },
            name: self.text(&key("name"))?.to_owned(),
            bytes: self.number(&key("bytes"))?,
            hash: self.hex(&key("hash"))?,
            attachment: match self.0.get(&key("attachment")) {
                Some(name) => Ok(name.clone()),
                None => Err(self.text(&key("missing"))?.to_owned()),
            },
        })
    }
}

/// Counts the commands of a run: none may be missing.
#[derive(Clone, Copy, Debug)]
pub struct CommandCount {
    /// Number of the next command; `None` where the run is joined and the first one tells.
    next: Option<u64>,
}

impl Default for CommandCount {
    fn default() -> Self {
        Self { next: Some(0) }
    }
}

impl CommandCount {
    /// For a run that is followed from its middle on.
    pub fn joined() -> Self {
        Self { next: None }
    }

    /// Takes the next command of the file.
    ///
    /// # Errors
    /// When commands before it are missing, or it has no number. The count goes on behind it.
    pub fn take(&mut self, entry: &JournalEntry) -> Result<(), Lack> {
        let index = entry.index.ok_or(Lack::Format)?;
        let expected = self.next.replace(index.saturating_add(1));
        if let Some(expected) = expected.filter(|expected| index > *expected) {
            return Err(Lack::Commands {
                first: expected,
                count: index - expected,
                step: entry.applied.step,
            });
        }
        Ok(())
    }
}

/// Follows the steps of a run: every one that is missing must be told by `/gaps`.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepCount {
    /// Next step, once there was one.
    next: Option<u64>,
    /// Last step that is known to be missing.
    told: Option<u64>,
}

/// Steps that are missing without a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Untold {
    /// First missing step.
    pub from_step: u64,
    /// Last missing step.
    pub to_step: u64,
}

impl StepCount {
    /// Takes note of what `/gaps` tells to be missing, up to `last`.
    pub fn gap(&mut self, last: u64) {
        self.told = Some(last);
    }

    /// Takes the next frame; says which steps before it are missing without a word.
    pub fn frame(&mut self, step: u64) -> Option<Untold> {
        let next = self.next.replace(step.saturating_add(1));
        let next = match (next?, self.told.take()) {
            (next, Some(told)) => next.max(told.saturating_add(1)),
            (next, None) => next,
        };
        (step > next).then(|| Untold {
            from_step: next,
            to_step: step - 1,
        })
    }
}

impl Serialize for Lack {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_step_is_told_or_found() {
        let mut steps = StepCount::default();
        assert_eq!(steps.frame(7), None, "those before the recorder are no gap");
        assert_eq!(steps.frame(8), None);
        assert_eq!(steps.frame(8), None, "the last frame may come twice");
        steps.gap(10);
        assert_eq!(steps.frame(11), None);
        let untold = Untold {
            from_step: 12,
            to_step: 12,
        };
        assert_eq!(steps.frame(13), Some(untold));
        steps.gap(14);
        let untold = Untold {
            from_step: 15,
            to_step: 19,
        };
        assert_eq!(steps.frame(20), Some(untold));
    }

    #[test]
    fn a_missing_command_is_found() {
        let entry = |index, step| JournalEntry {
            applied: cosplat_ipc::schema::AppliedCommand {
                step,
                ..Default::default()
            },
            epoch: Some(1),
            index,
        };
        let mut commands = CommandCount::default();
        assert_eq!(commands.take(&entry(Some(0), 3)), Ok(()));
        let lack = Lack::Commands {
            first: 1,
            count: 2,
            step: 9,
        };
        assert_eq!(commands.take(&entry(Some(3), 9)), Err(lack));
        assert_eq!(commands.take(&entry(Some(4), 9)), Ok(()));
        assert_eq!(commands.take(&entry(None, 9)), Err(Lack::Format));
        let mut joined = CommandCount::joined();
        assert_eq!(joined.take(&entry(Some(7), 9)), Ok(()));
        assert!(joined.take(&entry(Some(9), 9)).is_err());
    }
}
