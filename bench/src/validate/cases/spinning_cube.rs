//! A spinning cube: angular momentum to round-off, and next to no loss of energy.

use serde_json::Value;

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/spinning_cube");

/// The case.
pub const CASE: Case = Case {
    number: 3,
    name: "spinning_cube",
    about: "a cube that turns once keeps its angular momentum and its energy",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let (dx, duration) = match size {
        Size::Quick => (0.25, 3.2),
        Size::Full => (0.125, 6.3),
    };
    let mut rows = Vec::new();
    for (precision, gate) in [("f32", 2e-5), ("f64", 1e-12)] {
        let mut trial = Trial::new(&SCENE, duration).set("dx", dx);
        if precision == "f64" {
            trial = trial.option("--f64");
        }
        let outcome = trial.run()?;
        let spin = outcome.series("/angular_momentum/2");
        let first = spin.first().map_or(f64::NAN, |s| s.1);
        let drift = spin.iter().map(|s| (s.1 / first - 1.0).abs());
        let steps: f64 = number(&outcome.summary["substeps"]);
        rows.push(Row {
            quantity: format!(
                "{precision}: largest drift of angular momentum, relative, per 1e4 substeps"
            ),
            reference: 0.0,
            source: "conservation",
            measured: drift.fold(0.0, f64::max) * (1e4 / steps).max(1.0),
            gate: Gate::AtMost(gate),
            known_failure: None,
            command: trial.command(),
        });
        let energy =
            |frame: &Value| number(&frame["kinetic_energy"]) + number(&frame["elastic_energy"]);
        let ends =
            [outcome.frames.first(), outcome.frames.last()].map(|f| f.map_or(f64::NAN, energy));
        rows.push(Row {
            quantity: format!("{precision}: loss of energy, relative"),
            reference: 0.0,
            source: "conservation; the tests of Matter (larsblatny) admit as much",
            measured: 1.0 - ends[1] / ends[0],
            gate: Gate::Between(0.0, 1e-3),
            known_failure: None,
            command: trial.command(),
        });
    }
    Ok(rows)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}
