//! A light block in a tank of water: how deep it floats, and whether it stays there.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/floating");
/// Edges of the tank and of the block, depth of the water without it [m].
const TANK: f64 = 0.8;
const EDGE: f64 = 0.3;
const DEPTH: f64 = 0.4;
/// Density over that of water.
const DENSITY: f64 = 0.6;
/// How long it may take to come to rest, and how long it is looked at then [s].
const SETTLED: f64 = 3.0;
const LOOKED_AT: f64 = 2.0;

const SINKS: &str = "water loses volume to the block";

/// The case.
pub const CASE: Case = Case {
    number: 23,
    name: "floating",
    about: "a block floats as deep as its weight in water",
    run,
};

/// Height of the block's centre of mass where it displaces its weight [m].
fn afloat() -> f64 {
    let draught = DENSITY * EDGE;
    DEPTH + draught * (EDGE / TANK).powi(2) - draught + 0.5 * EDGE
}

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let cells: &[f64] = match size {
        Size::Quick => &[0.05],
        Size::Full => &[0.05, 0.025],
    };
    let mut rows = Vec::new();
    for fidelity in ["rigid", "mpm"] {
        for &dx in cells {
            let trial = Trial::new(&SCENE, SETTLED + LOOKED_AT)
                .set("dx", dx)
                .set("objects.1.fidelity", format!("{fidelity:?}"));
            let outcome = trial.run()?;
            let heights = outcome.series("/objects/1/com/1");
            let settled: Vec<f64> = heights
                .iter()
                .filter(|(time, _)| *time > SETTLED)
                .map(|(_, height)| *height)
                .collect();
            let (first, last) = settled.split_at(settled.len() / 2);
            let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
            let row = |quantity: &str, measured: f64, gate: f64, known_failure| Row {
                quantity: format!("{fidelity}, {:.0} cells wide: {quantity}", EDGE / dx),
                reference: 0.0,
                source: "Archimedes",
                measured,
                gate: Gate::AtMost(gate),
                known_failure,
                command: trial.command(),
            };
            rows.push(row(
                "off in height [cells]",
                (mean(&settled) - afloat()).abs() / dx,
                1.0,
                None,
            ));
            let sinking = (mean(first) - mean(last)) / (0.5 * LOOKED_AT * dx);
            rows.push(row("sinking [cells/s]", sinking.abs(), 0.01, Some(SINKS)));
        }
    }
    Ok(rows)
}
