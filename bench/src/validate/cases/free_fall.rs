//! Free fall and a throw: what no solver may get wrong.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/free_fall");
const G: f64 = 9.81;

/// The case.
pub const CASE: Case = Case {
    number: 2,
    name: "free_fall",
    about: "a cube thrown up and forwards flies a parabola",
    run,
};

fn run(_size: Size) -> anyhow::Result<Vec<Row>> {
    let trial = Trial::new(&SCENE, 1.0);
    let outcome = trial.run()?;
    let time = outcome.last("/sim_time")?;
    let height = 3.0 * time - 0.5 * G * time * time;
    Ok(vec![
        Row {
            quantity: "height after 1 s [m]".into(),
            reference: height,
            source: "v t - g t² / 2",
            measured: outcome.last("/objects/0/com/1")?,
            gate: Gate::Relative(1e-6),
            known_failure: None,
            command: trial.command(),
        },
        Row {
            quantity: "distance after 1 s [m]".into(),
            reference: 2.0 * time,
            source: "v t",
            measured: outcome.last("/objects/0/com/0")?,
            gate: Gate::Relative(1e-6),
            known_failure: None,
            command: trial.command(),
        },
    ])
}
