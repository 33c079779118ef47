//! Water and sand.

use super::elastic::fall;
use crate::{
    precision::case::{Case, Family},
    trial::{SceneText, scene_text},
};

/// A column of water.
pub const DAM_BREAK: Case = collapse(
    "dam_break",
    "Column of water, collapsing along a channel",
    scene_text!("precision/dam_break"),
    0.2,
);

/// A column of sand.
pub const SAND: Case = collapse(
    "sand",
    "Column of dry sand, collapsing",
    scene_text!("precision/sand"),
    0.3,
);

const fn collapse(
    name: &'static str,
    title: &'static str,
    scene: SceneText,
    duration: f64,
) -> Case {
    Case {
        name,
        title,
        error: "centre of mass, way forward and down, relative L2 error",
        against: "a run at two and a half times the default's cells and a quarter of its step",
        scene,
        duration,
        reference: Some(&[("cells_per_object", "40"), ("cfl", "0.5")]),
        families: || Family::usual(&["6", "8", "12", "16", "24"], &["6", "8"]),
        measure: |run, reference| {
            let both = ["/objects/0/com/0", "/objects/0/com/1"];
            fall(run, reference, &both, 0.1)
        },
    }
}
