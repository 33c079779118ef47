//! A block on a slope: Coulomb's closed form, as one body and as matter.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/incline");
const SLOPE: f64 = 24.0;
const G: f64 = 9.81;

/// The case.
pub const CASE: Case = Case {
    number: 10,
    name: "incline",
    about: "a block slides down a slope, or stays, as Coulomb says",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let duration = match size {
        Size::Quick => 3.0,
        Size::Full => 5.0,
    };
    let (sin, cos) = SLOPE.to_radians().sin_cos();
    let mut rows = Vec::new();
    for (fidelity, gate) in [("rigid", 1e-3), ("mpm", 1e-2)] {
        for friction in [
            0.0,
            15.0_f64.to_radians().tan(),
            1.1 * SLOPE.to_radians().tan(),
        ] {
            let trial = Trial::new(&SCENE, duration)
                .set("objects.0.fidelity", format!("{fidelity:?}"))
                .set("colliders.0.friction", format!("{friction:?}"));
            let outcome = trial.run()?;
            let com = |axis: usize| outcome.last(&format!("/objects/0/com/{axis}"));
            let moved = com(0)? * cos - com(1)? * sin;
            let slides = friction < SLOPE.to_radians().tan();
            let scale = 0.5 * G * duration * duration;
            rows.push(Row {
                quantity: format!(
                    "{fidelity}, friction {friction:.3}: distance after {duration} s [m]"
                ),
                reference: if slides {
                    scale * (sin - friction * cos)
                } else {
                    0.0
                },
                source: "g t^2 / 2 (sin th - mu cos th), or rest",
                measured: moved,
                gate: if slides {
                    Gate::Relative(gate)
                } else {
                    Gate::Absolute(gate * scale * sin)
                },
                known_failure: None,
                command: trial.command(),
            });
        }
    }
    Ok(rows)
}
