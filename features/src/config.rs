//! The TOML file beside a network: what it is, what it is shown and what comes out of it.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::FeaturesError;

/// Largest side of an input [pixel].
const MOST_PIXELS: usize = 4096;
/// Most tokens of a text.
const MOST_TOKENS: usize = 4096;

/// How a picture of another shape fills the input.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// Stretched, each axis by itself.
    #[default]
    Stretch,
    /// As large as it fits in its own shape, with zeros to the right and below, as SAM has it.
    Pad,
}

/// How a picture becomes an input `[1][3][rows][columns]`: brought to a size, and each channel `(level - mean) / std`.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Shown {
    /// Columns and rows [pixel].
    pub size: [usize; 2],
    /// Mean of red, green and blue, levels 0..=1.
    pub mean: [f32; 3],
    /// Their standard deviation, above 0.
    pub std: [f32; 3],
    /// What becomes of a picture of another shape.
    #[serde(default)]
    pub fit: Fit,
}

/// An image encoder.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct ImageConfig {
    /// The ONNX file, beside the TOML file.
    pub network: PathBuf,
    /// What it is shown.
    pub picture: Shown,
    /// Side of a patch [pixel]; not needed where the output has rows and columns.
    pub patch: Option<usize>,
    /// Name of the input; the first one where it is not given.
    pub input: Option<String>,
    /// Name of the output: `[1][tokens][values]`, those of the patches last, or `[1][values][rows][columns]`.
    pub output: String,
}

/// A network that proposes masks.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct MasksConfig {
    /// The ONNX file, beside the TOML file.
    pub network: PathBuf,
    /// What it is shown.
    pub picture: Shown,
    /// Name of the input; the first one where it is not given.
    pub input: Option<String>,
    /// Name of the output: `[1][masks][rows][columns]`.
    pub output: String,
    /// Value above which a pixel lies in a mask.
    #[serde(default)]
    pub threshold: f32,
    /// Name of the output that says how good each mask is: `[1][masks]`.
    pub scores: Option<String>,
    /// Masks with a lower score are left out.
    #[serde(default)]
    pub least_score: f32,
    /// Of two masks with a larger intersection over union, the one with the lower score is left out; 0 to 1.
    #[serde(default = "overlap")]
    pub overlap: f32,
}

fn overlap() -> f32 {
    0.7
}

/// A text encoder with the tokens of CLIP.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct TextConfig {
    /// The ONNX file, beside the TOML file.
    pub network: PathBuf,
    /// Tokens of the input `[1][tokens]`; what is left after the text is 0.
    pub tokens: usize,
    /// Name of the input; the first one where it is not given.
    pub input: Option<String>,
    /// Name of the output: `[1][values]`.
    pub output: String,
}

/// What a TOML file describes.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Config {
    /// Pictures to maps of features.
    Image(ImageConfig),
    /// Pictures to masks.
    Masks(MasksConfig),
    /// Words to vectors.
    Text(TextConfig),
}

impl Config {
    /// Reads the file beside a network.
    ///
    /// # Errors
    /// When it cannot be read, or a value is missing, unknown or out of range.
    pub fn read(path: &Path) -> Result<Self, FeaturesError> {
        let text = std::fs::read_to_string(path).map_err(FeaturesError::read(path))?;
        let wrong = |why: String| FeaturesError::config(path, why);
        let found: Config =
            toml::from_str(&text).map_err(|error| wrong(error.message().to_owned()))?;
        found.check().map_err(wrong)?;
        Ok(found)
    }

    /// What it is, as the file says it.
    pub fn kind(&self) -> &'static str {
        match self {
            Config::Image(_) => "image",
            Config::Masks(_) => "masks",
            Config::Text(_) => "text",
        }
    }

    fn check(&self) -> Result<(), String> {
        match self {
            Config::Image(image) => {
                image.picture.check()?;
                let [width, height] = image.picture.size;
                match image.patch {
                    Some(patch) if patch == 0 || width % patch != 0 || height % patch != 0 => {
                        Err(format!(
                            "patch is {patch}, expected a divisor of the size {width} x {height}"
                        ))
                    }
                    _ => Ok(()),
                }
            }
            Config::Masks(masks) => {
                masks.picture.check()?;
                let numbers = [masks.threshold, masks.least_score];
                if !numbers.iter().all(|n| n.is_finite()) {
                    return Err("threshold and least_score are expected to be finite".to_owned());
                }
                match (0.0..=1.0).contains(&masks.overlap) {
                    true => Ok(()),
                    false => Err(format!("overlap is {}, expected 0 to 1", masks.overlap)),
                }
            }
            Config::Text(text) if !(2..=MOST_TOKENS).contains(&text.tokens) => Err(format!(
                "tokens is {}, expected 2 to {MOST_TOKENS}",
                text.tokens
            )),
            Config::Text(_) => Ok(()),
        }
    }
}

impl Shown {
    /// Columns and rows of the input that a picture of so many covers.
    pub fn covered(&self, picture: [usize; 2]) -> [usize; 2] {
        match self.fit {
            Fit::Stretch => self.size,
            Fit::Pad => {
                let scale = |axis: usize| self.size[axis] as f64 / picture[axis] as f64;
                let scale = scale(0).min(scale(1));
                let of = |axis: usize| (picture[axis] as f64 * scale).round() as usize;
                [0, 1].map(|axis| of(axis).clamp(1, self.size[axis]))
            }
        }
    }

    /// Columns and rows that a picture covers of an output with so many, which stands for the whole input. One of which it
    /// covers half belongs to it.
    pub fn covered_of(&self, picture: [usize; 2], output: [usize; 2]) -> [usize; 2] {
        let covered = self.covered(picture);
        let part = |axis: usize| {
            let whole = output[axis] * covered[axis];
            (2 * whole + self.size[axis]) / (2 * self.size[axis])
        };
        [0, 1].map(|axis| part(axis).clamp(1, output[axis].max(1)))
    }

    fn check(&self) -> Result<(), String> {
        let [width, height] = self.size;
        if !self
            .size
            .iter()
            .all(|side| (1..=MOST_PIXELS).contains(side))
        {
            return Err(format!(
                "size is {width} x {height}, expected 1 to {MOST_PIXELS} pixels"
            ));
        }
        if !self.mean.iter().all(|m| m.is_finite()) {
            return Err(format!("mean is {:?}, expected finite numbers", self.mean));
        }
        match self.std.iter().all(|s| s.is_finite() && *s > 0.0) {
            true => Ok(()),
            false => Err(format!("std is {:?}, expected numbers above 0", self.std)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMAGE: &str = "kind = 'image'\nnetwork = 'a.onnx'\npatch = 8\noutput = 'tokens'\n\
        [picture]\nsize = [64, 48]\nmean = [0.5, 0.5, 0.5]\nstd = [0.5, 0.5, 0.5]\n";

    #[test]
    fn what_is_wrong_is_said_with_what_was_expected() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("written");
            Config::read(&path)
        };
        let fit = |text: &str| match read(text).expect("an encoder") {
            Config::Image(image) => image.picture.fit,
            other => panic!("{other:?}"),
        };
        assert_eq!(fit(IMAGE), Fit::Stretch);
        assert_eq!(fit(&IMAGE.replace("std", "fit = 'pad'\nstd")), Fit::Pad);
        for (from, to, expected) in [
            ("patch = 8", "patch = 7", "a divisor of the size 64 x 48"),
            ("patch = 8", "patch = 0", "a divisor"),
            ("64, 48", "64, 0", "64 x 0, expected 1 to 4096 pixels"),
            ("64, 48", "64, 9999", "expected 1 to 4096 pixels"),
            ("std = [0.5, ", "std = [0.0, ", "above 0"),
            ("std", "fit = 'crop'\nstd", "unknown variant `crop`"),
            ("mean = [0.5, ", "mean = [nan, ", "finite"),
            ("'image'", "'sound'", "unknown variant `sound`"),
            ("patch", "patsch", "unknown field `patsch`"),
            ("output = 'tokens'\n", "", "missing field `output`"),
        ] {
            let error = read(&IMAGE.replace(from, to)).expect_err(to).to_string();
            assert!(error.contains(expected), "{error}");
        }
        let masks = IMAGE
            .replace("'image'", "'masks'")
            .replace("patch", "overlap");
        let error = read(&masks).expect_err("overlap of 8").to_string();
        assert!(error.contains("overlap is 8, expected 0 to 1"), "{error}");
        let text = "kind = 'text'\nnetwork = 'a.onnx'\noutput = 'x'\ntokens = 1";
        let error = read(text).expect_err("a token").to_string();
        assert!(error.contains("tokens is 1, expected 2"), "{error}");
    }

    /// Sizes are those of SAM's `get_preprocess_shape`, by hand.
    #[test]
    fn a_padded_picture_covers_a_part_in_its_own_shape() {
        let shown = |fit| Shown {
            size: [1024, 1024],
            mean: [0.0; 3],
            std: [1.0; 3],
            fit,
        };
        let padded = shown(Fit::Pad);
        assert_eq!(padded.covered([640, 480]), [1024, 768]);
        assert_eq!(padded.covered([480, 641]), [767, 1024]);
        assert_eq!(padded.covered([4000, 1]), [1024, 1]);
        assert_eq!(padded.covered_of([640, 480], [256, 256]), [256, 192]);
        assert_eq!(padded.covered_of([480, 641], [256, 256]), [192, 256]);
        assert_eq!(padded.covered_of([4000, 1], [256, 256]), [256, 1]);
        let stretched = shown(Fit::Stretch);
        assert_eq!(stretched.covered([640, 480]), [1024, 1024]);
        assert_eq!(stretched.covered_of([640, 480], [256, 100]), [256, 100]);
    }
}
