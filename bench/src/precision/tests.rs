//! The cases say what the charts need, and every setting is valid.

use super::{
    case::{Case, PRESETS, Setting},
    cases,
};

/// A default that a scene fixes by itself could not be moved by a preset.
#[test]
fn scenes_leave_to_quality_what_it_sets() {
    for case in cases::ALL {
        for key in [
            "dx",
            "cells_per_object",
            "particles_per_cell",
            "cfl",
            "tolerance",
            "quality",
        ] {
            let given = case
                .scene
                .text
                .lines()
                .any(|l| l.starts_with(&format!("{key} =")));
            assert!(!given, "{} sets {key}", case.scene.path);
        }
    }
}

fn has_solver(setting: &Setting) -> bool {
    let mut keys = setting.changes.iter().map(|change| change.0);
    keys.any(|key| key.ends_with(".solver"))
}

/// Every family shows the default, so that all curves of a chart meet there; other solvers apart.
#[test]
fn every_curve_passes_through_the_default() {
    for case in cases::ALL {
        for family in (case.families)() {
            let settings = &family.settings;
            assert!(
                settings
                    .iter()
                    .any(|s| s.f64 || s.is_default() || has_solver(s)),
                "{}: {}",
                case.name,
                family.name
            );
        }
    }
}

#[test]
fn names_of_cases_are_different() {
    let mut names: Vec<&str> = cases::ALL.iter().map(|case: &&Case| case.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), cases::ALL.len());
    let presets = cases::ALL
        .iter()
        .filter(|case| (case.families)().iter().any(|f| f.name == PRESETS));
    assert!(presets.count() >= 8, "presets are on at least eight charts");
}
