//! How material-point methods fail: a minimal scene for each way, what contact methods and transfers do there.

mod cases;
mod entries;
pub mod judge;
mod known;

use anyhow::Context;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::trial::{Outcome, SceneText, Trial};
use entries::ALL;

/// A way to fail.
pub struct Failure {
    /// What it is called.
    pub name: &'static str,
    /// The scene.
    pub scene: SceneText,
    /// What is measured, with unit.
    pub measured: &'static str,
    /// What it would be without the failure.
    pub ideal: &'static str,
    /// Simulated seconds.
    duration: f64,
    /// Names of the runs and what each sets in the scene.
    variants: &'static [(&'static str, &'static [(&'static str, &'static str)])],
    /// Reads it off a run.
    read: fn(&Outcome) -> anyhow::Result<f64>,
    /// What helps.
    pub remedy: &'static str,
}

/// One run of a failure's scene.
pub struct Found {
    /// Name of the run.
    pub variant: &'static str,
    /// What was measured.
    pub value: f64,
    /// Particles taken out.
    pub quarantined: u64,
    /// Substeps taken back.
    pub rollbacks: u64,
    /// How to repeat it.
    pub command: String,
}

/// A failure and all its runs.
pub struct Measured {
    /// Which.
    pub failure: &'static Failure,
    /// In the order of its variants.
    pub runs: Vec<Found>,
}

impl Measured {
    /// As one line.
    pub fn json(&self) -> Value {
        let run = |run: &Found| {
            json!({
                "variant": run.variant, "value": run.value, "quarantined": run.quarantined,
                "rollbacks": run.rollbacks, "command": run.command,
            })
        };
        json!({
            "failure": self.failure.name, "scene": self.failure.scene.path, "measured": self.failure.measured,
            "ideal": self.failure.ideal, "runs": self.runs.iter().map(run).collect::<Vec<_>>(),
        })
    }
}

/// Runs all scenes; the first two when it must be `quick`.
///
/// # Errors
/// When one cannot be run.
pub fn measure(quick: bool) -> anyhow::Result<Vec<Measured>> {
    let failures = if quick { &ALL[..2] } else { &ALL[..] };
    let run = |failure: &'static Failure, n: usize| -> anyhow::Result<Found> {
        let (variant, settings) = failure.variants[n];
        // One thread each: several run at the same time.
        let mut trial = Trial::new(&failure.scene, failure.duration).option("--threads=1");
        for (key, value) in settings {
            trial = trial.set(key, value);
        }
        let outcome = trial.run()?;
        let count = |key: &str| outcome.summary[key].as_u64().unwrap_or(0);
        Ok(Found {
            variant,
            value: (failure.read)(&outcome).with_context(|| trial.command())?,
            quarantined: count("quarantined"),
            rollbacks: count("rollbacks"),
            command: trial.command(),
        })
    };
    failures
        .par_iter()
        .map(|failure| {
            let runs = 0..failure.variants.len();
            let runs = runs.into_par_iter().map(|n| run(failure, n));
            Ok(Measured {
                failure,
                runs: runs.collect::<anyhow::Result<_>>()?,
            })
        })
        .collect()
}
