//! Axial vibration of a bar: period, its convergence, and no loss of amplitude.

use super::fit::{order, period};
use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/bar");
/// Length [m].
const LENGTH: f64 = 25.0;
/// Period `4 L / c` [s].
const PERIOD: f64 = 10.0;
/// Largest speed of the centre of mass, `0.1 * 2 / pi` [m/s].
const SPEED: f64 = 0.2 / std::f64::consts::PI;

/// The case.
pub const CASE: Case = Case {
    number: 4,
    name: "bar",
    about: "a bar held at one end vibrates along itself at its own frequency",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let all: &[u32] = match size {
        Size::Quick => &[13, 25],
        Size::Full => &[13, 25, 50, 100],
    };
    let mut rows = Vec::new();
    let mut errors = Vec::new();
    for &cells in all {
        let dx = LENGTH / f64::from(cells);
        let trial = Trial::new(&SCENE, 10.0 * PERIOD)
            .set("dx", dx)
            .set("objects.0.shape.size", format!("[{LENGTH}, {dx}, {dx}]"))
            .set(
                "objects.0.translation",
                format!("[{}, {}, {}]", 0.5 * LENGTH, 0.5 * dx, 0.5 * dx),
            )
            .set("colliders.1.point", format!("[0, {dx}, 0]"))
            .set("colliders.3.point", format!("[0, 0, {dx}]"));
        let speed = trial.run()?.series("/objects/0/linear_velocity/0");
        let found = period(&speed);
        errors.push((dx, (found / PERIOD - 1.0).abs()));
        let last = speed.iter().filter(|(t, _)| *t > 9.0 * PERIOD);
        let amplitude = last.fold(0.0, |a: f64, (_, v)| a.max(v.abs())) / SPEED;
        rows.push(Row {
            quantity: format!("period with {cells} cells [s]"),
            reference: PERIOD,
            source: "4 L / sqrt(E / rho)",
            measured: found,
            gate: Gate::Relative(0.005),
            known_failure: None,
            command: trial.command(),
        });
        rows.push(Row {
            quantity: format!("amplitude after 10 periods with {cells} cells, relative"),
            reference: 1.0,
            source: "conservation",
            measured: amplitude,
            gate: Gate::Relative(0.01),
            known_failure: None,
            command: trial.command(),
        });
    }
    let (first, last) = (errors[0], errors[errors.len() - 1]);
    rows.push(Row {
        quantity: format!(
            "order of the period from {} to {} cells",
            all[0],
            all[all.len() - 1]
        ),
        reference: 2.0,
        source: "quadratic splines, and kicks from middle to middle of the substeps",
        measured: order(first, last),
        gate: Gate::AtLeast(0.9),
        known_failure: None,
        command: "see the rows above".into(),
    });
    Ok(rows)
}
