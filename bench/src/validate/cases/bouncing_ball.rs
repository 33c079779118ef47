//! A rigid ball bounces on a plane: heights and times for every restitution.

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/bouncing_ball");
const G: f64 = 9.81;
const RADIUS: f64 = 0.25;

/// The case.
pub const CASE: Case = Case {
    number: 12,
    name: "bouncing_ball",
    about: "after n bounces a ball rises to e^(2 n) of where it fell from",
    run,
};

fn run(_size: Size) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for e in [0.0, 0.5, 0.8, 1.0_f64] {
        let first = (2.0 / G).sqrt();
        // Into the third rise, or as long as three bounces of a ball that loses nothing.
        let trial = Trial::new(&SCENE, first * 6.5).set("colliders.0.restitution", e);
        let outcome = trial.run()?;
        let bounces = if e == 0.0 { 1 } else { 3 };
        let mut ground = first;
        for n in 1..=bounces {
            let flight = 2.0 * first * e.powi(n);
            // What does not fly is looked at later.
            let wait = if flight > 0.0 { 0.5 * flight } else { 1.0 };
            let measured = top(&outcome, ground + wait)?;
            let reference = e.powi(2 * n);
            rows.push(Row {
                quantity: format!("e = {e}: height after bounce {n} [m]"),
                reference,
                source: "h e^(2 n)",
                measured,
                gate: if e == 0.0 {
                    Gate::Absolute(1e-6)
                } else {
                    Gate::Relative(1e-6)
                },
                known_failure: None,
                command: trial.command(),
            });
            ground += flight;
        }
    }
    Ok(rows)
}

/// Height that the ball reaches in the flight it is in at a time: where it is, and where its speed takes it.
fn top(outcome: &Outcome, time: f64) -> anyhow::Result<f64> {
    let heights = outcome.series("/objects/0/com/1");
    let speeds = outcome.series("/objects/0/linear_velocity/1");
    let near = heights
        .iter()
        .zip(&speeds)
        .min_by(|a, b| (a.0.0 - time).abs().total_cmp(&(b.0.0 - time).abs()));
    let ((_, y), (_, v)) = near.ok_or_else(|| anyhow::anyhow!("no frames"))?;
    Ok(y - RADIUS + 0.5 * v * v / G)
}
