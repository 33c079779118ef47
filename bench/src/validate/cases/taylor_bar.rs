//! A copper bar hits a wall: length and radius of what is left.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/taylor_bar");
const RADIUS: f64 = 3.2e-3;

/// The case.
pub const CASE: Case = Case {
    number: 17,
    name: "taylor_bar",
    about: "a copper bar that hits a wall at 227 m/s is as short and as wide as codes agree",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let cells = match size {
        Size::Quick => 4.0,
        Size::Full => 6.0,
    };
    let dx = RADIUS / cells;
    let trial = Trial::new(&SCENE, 8e-5).set("dx", dx);
    let outcome = trial.run()?;
    let half_spacing = 0.25 * dx;
    let at = |side: &str, axis: usize| outcome.last(&format!("/probes/bar/{side}/{axis}"));
    // The outermost particles stand for what is around them: at the cold end half their spacing, around the foot
    // as much more as the foot has widened there.
    let length = at("max", 1)? + half_spacing;
    let widest = [at("max", 0)?, -at("min", 0)?, at("max", 2)?, -at("min", 2)?];
    let foot = widest.iter().sum::<f64>() / 4.0 * RADIUS / (RADIUS - half_spacing);
    let row = |quantity: &str, reference: f64, measured: f64, gate: f64| Row {
        quantity: format!("R/dx = {cells}: {quantity} [mm]"),
        reference,
        source: "middle of published results, 21.3 to 21.5 and 6.9 to 7.25",
        measured: 1e3 * measured,
        gate: Gate::Relative(gate),
        known_failure: None,
        command: trial.command(),
    };
    let energy = outcome.series("/kinetic_energy");
    Ok(vec![
        row("length", 21.4, length, 0.03),
        row("radius of the foot", 7.075, foot, 0.06),
        Row {
            quantity: "kinetic energy left after 80 us".into(),
            reference: 0.0,
            source: "at rest: at most 1 % of the 239.6 J it had",
            measured: energy.last().map_or(f64::NAN, |e| e.1 / 239.6),
            gate: Gate::AtMost(0.01),
            known_failure: None,
            command: trial.command(),
        },
    ])
}
