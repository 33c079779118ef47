//! Masks with vectors in LangSplat's layout, and vectors of words: damaged and made up, as no network runs here.

use std::{collections::BTreeMap, path::Path};

use anyhow::Context;
use cosplat_renderer::Image;
use cosplat_semantics::{
    MaskMap, Splat, View, masks,
    objects::Vectors,
    query::{NEGATIVES, Words},
    show,
    stand_in::{aside, damaged, mask, vector},
};

use super::{ABSENT, composed::Composed};

/// Length of a vector: that of CLIP's in LangSplat.
const DIM: usize = 512;
/// Cosine between the vector of a mask and that of the word for what it says to show.
const COSINE: f32 = 0.5;
/// View whose masks are shown.
const SHOWN: usize = 7;

/// Masks with the numbers 0, 1, ... in place of those that are there, and these.
fn numbered(map: &MaskMap) -> (MaskMap, Vec<i32>) {
    let mut number = BTreeMap::new();
    for mask in map.mask.iter().filter(|m| **m >= 0) {
        number.insert(*mask, 0);
    }
    let there: Vec<i32> = number.keys().copied().collect();
    for (n, entry) in (0..).zip(number.values_mut()) {
        *entry = n;
    }
    let of = |mask: &i32| number.get(mask).copied().unwrap_or(-1);
    let numbered = MaskMap {
        mask: map.mask.iter().map(of).collect(),
        ..map.clone()
    };
    (numbered, there)
}

/// Writes `masks/` and `words.safetensors`; name and masks of the view that is shown. `tell` hears how many are done.
///
/// # Errors
/// When a file cannot be written.
pub(super) fn write(
    composed: &Composed,
    views: &[View],
    folder: &Path,
    tell: impl Fn(usize),
) -> anyhow::Result<(String, Image)> {
    let things = composed.words.len();
    let mut words = Words {
        dim: DIM,
        ..Words::default()
    };
    let all = composed.words.iter().chain(&NEGATIVES).chain([&ABSENT]);
    for (n, word) in (0..).zip(all) {
        words.vector.insert((*word).to_owned(), vector(n, DIM));
    }
    let path = folder.join("words.safetensors");
    words.write(&path)?;
    let place = folder.join("masks");
    std::fs::create_dir_all(&place).with_context(|| format!("cannot make {}", place.display()))?;
    let splat = Splat::from(&composed.gaussians);
    let mut shown = None;
    for (n, view) in views.iter().enumerate() {
        let right = mask(&splat, &composed.truth, things, &view.camera);
        let (map, there) = numbered(&damaged(&right, things, n));
        // Of a thing the masks 2 n and 2 n + 1 are left.
        let said = there
            .iter()
            .map(|m| &words.vector[composed.words[*m as usize / 2]]);
        let noisy = said
            .zip(0..)
            .flat_map(|(word, k)| aside(word, COSINE, 1_000 + 100 * n as u64 + k));
        let vectors = Vectors {
            dim: DIM,
            value: noisy.collect(),
        };
        masks::write_proposals(&place, &view.name, &map, &vectors)?;
        if n == SHOWN.min(views.len() - 1) {
            shown = Some((view.name.clone(), drawn(&map)));
        }
        tell(n + 1);
    }
    shown.context("no view was made")
}

/// Masks in colours, whose order means nothing beyond the view.
fn drawn(map: &MaskMap) -> Image {
    let color = |mask: &i32| match mask {
        -1 => [245; 3],
        mask => (show::color(*mask) * 255.0).to_array().map(|c| c as u8),
    };
    Image {
        width: map.width as u32,
        height: map.height as u32,
        rgb: map.mask.iter().flat_map(color).collect(),
    }
}
