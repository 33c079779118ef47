//! What a case is: a scene, the settings to try, and how far a result is off.

use crate::trial::{Outcome, SceneText, Trial};

/// A scene with a known or finely computed answer.
pub struct Case {
    /// Name on the command line and of its files.
    pub name: &'static str,
    /// What happens in it.
    pub title: &'static str,
    /// What the error is: name of the vertical axis.
    pub error: &'static str,
    /// What the error is against, in words.
    pub against: &'static str,
    /// The scene; it leaves everything that `quality` sets to the default.
    pub scene: SceneText,
    /// Simulated seconds.
    pub duration: f64,
    /// Changes that make the reference run; none where the answer is known.
    pub reference: Option<&'static [(&'static str, &'static str)]>,
    /// What is tried.
    pub families: fn() -> Vec<Family>,
    /// How far a run is off, given the reference run.
    pub measure: fn(&Outcome, Option<&Outcome>) -> anyhow::Result<f64>,
}

/// Settings that differ in one thing: one curve.
pub struct Family {
    /// For the legend.
    pub name: &'static str,
    /// In the order of the curve.
    pub settings: Vec<Setting>,
}

/// Changes to the scene file.
#[derive(Clone, Default)]
pub struct Setting {
    /// What stands beside the point.
    pub label: String,
    /// Keys and values for `--set`.
    pub changes: Vec<(&'static str, String)>,
    /// Whether the reference solver runs it.
    pub f64: bool,
}

/// Name of the family that holds the presets.
pub const PRESETS: &str = "quality preset";
/// Name of the family over the cell size.
pub const CELLS: &str = "cells per object";

impl Setting {
    fn new(key: &'static str, label: &str, is_default: bool) -> Self {
        // The default is left to the scene, so that it is one run in all families.
        let change = (!is_default).then(|| (key, label.to_owned()));
        Self {
            label: label.into(),
            changes: change.into_iter().collect(),
            f64: false,
        }
    }

    /// Whether nothing is changed.
    pub fn is_default(&self) -> bool {
        self.changes.is_empty() && !self.f64
    }

    /// Whether it costs at most about what the default does.
    pub fn is_coarse(&self) -> bool {
        let fine = |(key, value): &(&str, String)| match *key {
            "cells_per_object" => value.parse().is_ok_and(|cells: f64| cells > 16.0),
            "particles_per_cell" => value.parse().is_ok_and(|count: f64| count > 8.0),
            "cfl" => value.parse().is_ok_and(|cfl: f64| cfl < 0.25),
            "quality" => value == "accurate",
            _ => false,
        };
        !self.f64 && !self.changes.iter().any(fine)
    }

    /// The run.
    pub fn trial(&self, scene: &SceneText, duration: f64) -> Trial {
        let start = Trial::new(scene, duration);
        let changed = self
            .changes
            .iter()
            .fold(start, |trial, (key, value)| trial.set(key, value));
        changed.option(if self.f64 { "--f64" } else { "--threads=1" })
    }
}

impl Family {
    /// One key over several values, one of them what the scene has anyway.
    pub fn sweep(name: &'static str, key: &'static str, values: &[&str], default: &str) -> Self {
        let settings = values.iter().map(|v| Setting::new(key, v, *v == default));
        Self {
            name,
            settings: settings.collect(),
        }
    }

    /// What scenes of one or two solids are charted over: the usual, and the other solver.
    pub fn of_solids(objects: usize, cells: &[&str], double: &[&str]) -> Vec<Self> {
        let mut families = Self::usual(cells, double);
        families.push(Self::spatial(objects, cells));
        families
    }

    /// What every scene of matter is charted over; double precision over cells of its own, as it is slow.
    pub fn usual(cells: &[&str], double: &[&str]) -> Vec<Self> {
        vec![
            Self::cells(cells),
            Self::density(&["1", "2", "4", "8", "27"]),
            Self::step(),
            Self::double(double),
            Self::presets(),
        ]
    }

    /// Cells along the longest side of the smallest object.
    pub fn cells(values: &[&str]) -> Self {
        Self::sweep(CELLS, "cells_per_object", values, "16")
    }

    /// The same with the first objects on the grid that all matter may share: the other solver.
    pub fn spatial(objects: usize, values: &[&str]) -> Self {
        const SOLVERS: [&str; 2] = ["objects.0.solver", "objects.1.solver"];
        let mut family = Self::sweep(
            "cells on the spatial grid",
            "cells_per_object",
            values,
            "16",
        );
        for setting in &mut family.settings {
            let solvers = SOLVERS[..objects].iter();
            setting
                .changes
                .extend(solvers.map(|key| (*key, "spatial".into())));
        }
        family
    }

    /// Particles per cell.
    pub fn density(values: &[&str]) -> Self {
        Self::sweep("particles per cell", "particles_per_cell", values, "8")
    }

    /// Fractions of the stability limit.
    pub fn step() -> Self {
        Self::sweep("cfl", "cfl", &["0.1", "0.25", "0.5", "0.8", "0.95"], "0.8")
    }

    /// How objects meet.
    pub fn contact() -> Self {
        let methods = ["two_scale", "multi_field", "single_field", "com_sphere"];
        Self::sweep("contact", "contact", &methods, "two_scale")
    }

    /// The double-precision reference solver over the cell size.
    pub fn double(values: &[&str]) -> Self {
        let mut family = Self::sweep("cells in f64", "cells_per_object", values, "16");
        family.settings.iter_mut().for_each(|s| s.f64 = true);
        family
    }

    /// The presets.
    pub fn presets() -> Self {
        let names = ["draft", "balanced", "accurate"];
        Self::sweep(PRESETS, "quality", &names, "balanced")
    }
}

/// Root of the mean square of what a curve is off an expected one, relative to the latter's.
pub fn relative_l2(pairs: impl Iterator<Item = (f64, f64)>) -> anyhow::Result<f64> {
    let (mut off, mut scale, mut count) = (0.0, 0.0, 0);
    for (measured, expected) in pairs {
        off += (measured - expected).powi(2);
        scale += expected * expected;
        count += 1;
    }
    let error = (off / scale).sqrt();
    anyhow::ensure!(count > 0 && error.is_finite(), "the result is not a number");
    Ok(error)
}
