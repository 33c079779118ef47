//! Scenes with a right value that once came out wrong: what they do now, and whether that is near enough.

use anyhow::Context;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::{
    cases::{Case, Reading},
    known,
};
use crate::trial::Trial;

/// What a case came to.
pub struct Judged {
    /// Which.
    pub case: &'static Case,
    /// Value of each of its readings.
    pub values: Vec<f64>,
    /// How to repeat its runs.
    pub commands: Vec<String>,
}

impl Judged {
    /// Figures with their readings.
    pub fn figures(&self) -> impl Iterator<Item = (&'static Reading, f64)> + '_ {
        self.case.readings.iter().zip(self.values.iter().copied())
    }

    /// As one line.
    pub fn json(&self) -> Value {
        let figure = |(reading, value): (&'static Reading, f64)| {
            json!({
                "quantity": reading.quantity, "value": value, "right": reading.right, "allowed": reading.allowed(),
                "met": reading.admits(value),
            })
        };
        json!({
            "case": self.case.scene.path, "about": self.case.about, "commands": self.commands,
            "figures": self.figures().map(figure).collect::<Vec<_>>(),
        })
    }
}

/// Runs the first cases among those that are `wanted`.
///
/// # Errors
/// When one cannot be run.
pub fn judge(wanted: impl Fn(&Case) -> bool, first: usize) -> anyhow::Result<Vec<Judged>> {
    let cases: Vec<&'static Case> = known::all()
        .filter(|case| wanted(case))
        .take(first)
        .collect();
    let run = |case: &'static Case| -> anyhow::Result<Judged> {
        let trials: Vec<Trial> = (case.runs.iter())
            .map(|settings| {
                // One thread each: several run at the same time.
                let trial = Trial::new(&case.scene, case.duration).option("--threads=1");
                let trial = case
                    .files
                    .iter()
                    .fold(trial, |trial, (name, text)| trial.beside(name, text));
                settings
                    .iter()
                    .fold(trial, |trial, (key, value)| trial.set(key, value))
            })
            .collect();
        let outcomes = trials
            .par_iter()
            .map(Trial::run)
            .collect::<anyhow::Result<Vec<_>>>()?;
        let values = case.readings.iter().map(|reading| {
            (reading.read)(&outcomes)
                .with_context(|| format!("{}: {}", case.scene.path, reading.quantity))
        });
        Ok(Judged {
            case,
            values: values.collect::<anyhow::Result<_>>()?,
            commands: trials.iter().map(Trial::command).collect(),
        })
    };
    cases.into_par_iter().map(run).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_says_what_it_allows() {
        for reading in known::all().flat_map(|case| case.readings) {
            assert!(!reading.admits(f64::NAN), "{}", reading.quantity);
            assert!(!reading.allowed().is_empty());
        }
    }
}
