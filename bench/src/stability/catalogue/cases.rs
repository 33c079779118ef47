//! What a scene with a right value is, and what is read off its runs.

use anyhow::Context;
use serde_json::Value;

use crate::{
    trial::{Outcome, SceneText},
    validate::report::Gate,
};

/// One run of the scene as it is.
pub(super) const ONCE: &[&[(&str, &str)]] = &[&[]];

/// A scene with right values.
pub struct Case {
    /// The scene.
    pub scene: SceneText,
    /// What is in it.
    pub about: &'static str,
    /// Simulated seconds.
    pub(super) duration: f64,
    /// Files that the scene names, with their texts.
    pub(super) files: &'static [(&'static str, &'static str)],
    /// What each run sets in the scene.
    pub(super) runs: &'static [&'static [(&'static str, &'static str)]],
    /// What is read off all runs.
    pub(super) readings: &'static [Reading],
}

/// A figure of a case.
pub struct Reading {
    /// What it is, with unit.
    pub quantity: &'static str,
    /// What it should be.
    pub right: f64,
    /// How far it may be off.
    pub gate: Gate,
    /// Reads it off the runs.
    pub(super) read: fn(&[Outcome]) -> anyhow::Result<f64>,
}

impl Reading {
    /// Whether a value passes.
    pub fn admits(&self, value: f64) -> bool {
        self.gate.admits(value, self.right)
    }

    /// The gate in words.
    pub fn allowed(&self) -> String {
        match self.gate {
            Gate::Relative(share) => {
                format!("{} within {} %", self.right, (1e4 * share).round() / 100.0)
            }
            Gate::Absolute(off) => format!("{} within {off}", self.right),
            Gate::AtLeast(least) => format!("at least {least}"),
            Gate::AtMost(most) => format!("at most {most}"),
            Gate::Between(low, high) => format!("{low} to {high}"),
        }
    }
}

/// All energy of a frame [J].
fn energy(frame: &Value) -> f64 {
    let number = |key: &str| frame[key].as_f64().unwrap_or(f64::NAN);
    number("kinetic_energy") + number("elastic_energy") + number("potential_energy")
}

/// Largest energy over that at first.
pub(super) fn energy_over_first(runs: &[Outcome]) -> anyhow::Result<f64> {
    let energies = runs[0].frames.iter().map(energy);
    let first = runs[0].frames.first().map(energy).context("no frame")?;
    Ok(energies.fold(0.0, |most: f64, e| if e.is_nan() { e } else { most.max(e) }) / first)
}

/// Largest rise of the energy over what it had come down to after `from` [s], and the motion and strain that there were then [J].
pub(super) fn energy_rise(run: &Outcome, from: f64) -> anyhow::Result<[f64; 2]> {
    let late = run
        .frames
        .iter()
        .filter(|frame| frame["sim_time"].as_f64().is_some_and(|t| t > from));
    let (mut least, mut rise, mut at_first) = (f64::INFINITY, 0.0_f64, None);
    for frame in late {
        let now = energy(frame);
        at_first.get_or_insert(now - frame["potential_energy"].as_f64().unwrap_or(f64::NAN));
        least = least.min(now);
        rise = rise.max(now - least);
    }
    Ok([rise, at_first.context("no frame so late")?])
}

/// Mean rate of a series in a span [1/s].
pub(super) fn rate(run: &Outcome, pointer: &str, [from, to]: [f64; 2]) -> anyhow::Result<f64> {
    let series = run.series(pointer);
    let mut within = series.iter().filter(|(t, _)| (from..=to).contains(t));
    let first = within.next().context("no frame in the span")?;
    let last = within.next_back().context("one frame in the span")?;
    Ok((last.1 - first.1) / (last.0 - first.0))
}

/// A series less a value.
pub(super) fn less(run: &Outcome, pointer: &str, value: f64) -> Vec<(f64, f64)> {
    run.series(pointer)
        .into_iter()
        .map(|(t, x)| (t, x - value))
        .collect()
}

/// Largest value of a series in a span.
pub(super) fn largest(run: &Outcome, pointer: &str, [from, to]: [f64; 2]) -> f64 {
    let series = run.series(pointer);
    let within = series.iter().filter(|(t, _)| (from..=to).contains(t));
    within.fold(f64::NEG_INFINITY, |most, (_, x)| most.max(*x))
}

/// Largest distance of objects in two runs at the same time [m].
pub(super) fn apart(runs: &[Outcome]) -> anyhow::Result<f64> {
    let [one, other] = runs else {
        anyhow::bail!("two runs are compared");
    };
    let mut most = 0.0_f64;
    for (a, b) in one.frames.iter().zip(&other.frames) {
        let objects = a["objects"].as_array().context("no objects")?;
        for n in 0..objects.len() {
            let squares = (0..3).map(|axis| {
                let at = |frame: &Value| {
                    frame["objects"][n]["com"][axis]
                        .as_f64()
                        .unwrap_or(f64::NAN)
                };
                (at(a) - at(b)).powi(2)
            });
            most = most.max(squares.sum::<f64>().sqrt());
        }
    }
    Ok(most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_rise_counts_from_the_least_before_it() -> anyhow::Result<()> {
        let frame = |t: u32, e: f64| json!({"sim_time": t, "kinetic_energy": e, "elastic_energy": 1.0, "potential_energy": -2.0});
        let energies = [9.0, 4.0, 1.0, 3.0, 0.5, 1.5];
        let run = Outcome {
            frames: energies
                .iter()
                .zip(0..)
                .map(|(e, t)| frame(t, *e))
                .collect(),
            summary: Value::Null,
        };
        assert_eq!(energy_rise(&run, 0.5)?, [2.0, 5.0]);
        Ok(())
    }
}
