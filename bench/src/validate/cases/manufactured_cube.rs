//! A manufactured solution along the axes: order of convergence of displacements.

use super::fit::order;
use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/manufactured_cube");
/// Amplitude of the displacement [m].
const AMPLITUDE: f64 = 0.05;

/// The case.
pub const CASE: Case = Case {
    number: 6,
    name: "manufactured_cube",
    about: "a cube follows a motion that was chosen before its forces were",
    run,
};

/// The same motion in a body of twice the size whose faces are free, for 3 ms: waves from there have not reached the
/// middle yet.
fn without_walls(cells: f64, cfl: f64) -> Trial {
    let trial = Trial::new(&SCENE, 0.003)
        .set("dx", 1.0 / cells)
        .set("cfl", cfl)
        .set("objects.0.shape.size", "[2, 2, 2]");
    (0..6).fold(trial, |trial, wall| {
        let far = if wall % 2 == 0 { -50 } else { 50 };
        trial.set(
            &format!("colliders.{wall}.point"),
            format!("[{far}, {far}, {far}]"),
        )
    })
}

fn row(quantity: String, measured: f64, command: String) -> Row {
    Row {
        quantity,
        reference: 0.0,
        source: "exact; stored, gated only by the amplitude",
        measured,
        gate: Gate::AtMost(1.0),
        known_failure: None,
        command,
    }
}

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let walled: &[f64] = match size {
        Size::Quick => &[8.0, 16.0],
        Size::Full => &[8.0, 16.0, 32.0],
    };
    let mut rows = Vec::new();
    let mut errors = Vec::new();
    for &cells in walled {
        let trial = Trial::new(&SCENE, 0.02).set("dx", 1.0 / cells);
        let series = trial.run()?.series("/probes/interior/rms");
        let worst = series.iter().fold(0.0, |a: f64, (_, e)| a.max(*e)) / AMPLITUDE;
        errors.push((1.0 / cells, worst));
        let quantity =
            format!("largest interior rms error within a period over the amplitude, {cells} cells");
        rows.push(row(quantity, worst, trial.command()));
    }
    let last = &errors[errors.len() - 2..];
    rows.push(Row {
        quantity: "order of the interior error, between walls".into(),
        reference: 2.0,
        source: "quadratic splines",
        measured: order(last[0], last[1]),
        gate: Gate::AtLeast(1.8),
        known_failure: (size == Size::Full).then_some(
            "2.04 from 8 to 16 cells and 1.77 from 16 to 32: part of what is left at 0.8 % of the amplitude is of first \
             order; with substeps of a quarter it is 1.83",
        ),
        command: "see the rows above".into(),
    });
    let open: &[f64] = match size {
        Size::Quick => &[6.0, 12.0],
        Size::Full => &[8.0, 16.0],
    };
    let mut errors = Vec::new();
    for &cells in open {
        let trial = without_walls(cells, 0.125);
        let outcome = trial.run()?;
        let series = outcome.series("/probes/interior/rms");
        let worst = series.iter().fold(0.0, |a: f64, (_, e)| a.max(*e)) / AMPLITUDE;
        errors.push((1.0 / cells, worst));
        let quantity = format!("the same without walls within 3 ms, {cells} cells");
        rows.push(row(quantity, worst, trial.command()));
    }
    rows.push(Row {
        quantity: "order of the interior error, without walls".into(),
        reference: 2.0,
        source: "quadratic splines",
        measured: order(errors[0], errors[1]),
        gate: Gate::AtLeast(1.8),
        known_failure: None,
        command: "see the rows above".into(),
    });
    Ok(rows)
}
