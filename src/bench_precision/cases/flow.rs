//! Water and sand.

use super::{elastic::fall, scene};
use crate::bench_precision::case::{Case, Family};

/// A column of water.
pub const DAM_BREAK: Case = Case {
    name: "dam_break",
    title: "Column of water, collapsing along a channel",
    error: "centre of mass, forward way, relative L2 error",
    against: "a run at two and a half times the default's cells and two fifths of its step",
    scene: scene!("dam_break"),
    duration: 0.2,
    reference: Some(&[("cells_per_object", "40")]),
    families: || {
        vec![
            Family::cells(&["6", "8", "12", "16", "24"]),
            Family::density(&["1", "2", "4", "8", "27"]),
            Family::step(),
            Family::double(&["6", "8"]),
            Family::presets(),
        ]
    },
    measure: |run, reference| fall(run, reference, "/objects/0/com/0", 0.1),
};

/// A column of sand.
pub const SAND: Case = Case {
    name: "sand",
    title: "Column of dry sand, collapsing",
    error: "centre of mass, forward way, relative L2 error",
    against: "a run at two and a half times the default's cells and two fifths of its step",
    scene: scene!("sand"),
    duration: 0.3,
    reference: Some(&[("cells_per_object", "40")]),
    families: || {
        vec![
            Family::cells(&["6", "8", "12", "16", "24"]),
            Family::density(&["1", "2", "4", "8", "27"]),
            Family::step(),
            Family::double(&["6", "8"]),
            Family::presets(),
        ]
    },
    measure: |run, reference| fall(run, reference, "/objects/0/com/0", 0.1),
};
