//! A stack, and a heavy block on a light one: what lies stays, and falls asleep.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const STACK: SceneText = scene_text!("validate/stack");
const HEAVY: SceneText = scene_text!("validate/heavy_on_light");
const DX: f64 = 0.04;
/// Of what deforms [1/s]: elastic matter that is loaded at once rings.
const DAMPING: f64 = 5.0;

/// The case.
pub const CASE: Case = Case {
    number: 16,
    name: "rest",
    about: "five blocks in a stack and a block on one a hundred times lighter stay where they are",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let duration = match size {
        Size::Quick => 5.0,
        Size::Full => 60.0,
    };
    let mut rows = Vec::new();
    for (what, scene, objects) in [("stack of five", &STACK, 5), ("1:100", &HEAVY, 2)] {
        rows.extend(rest(what, scene, objects, "rigid", 0.0, duration)?);
        rows.extend(rest(what, scene, objects, "auto", DAMPING, duration)?);
    }
    // Of what rings, only how long.
    let mut undamped = rest("undamped stack of five", &STACK, 5, "auto", 0.0, 3.0)?;
    rows.extend(undamped.pop());
    Ok(rows)
}

fn rest(
    what: &str,
    scene: &SceneText,
    objects: usize,
    fidelity: &str,
    damping: f64,
    duration: f64,
) -> anyhow::Result<Vec<Row>> {
    let mut trial = Trial::new(scene, duration).set("damping", damping);
    for object in 0..objects {
        trial = trial.set(
            &format!("objects.{object}.fidelity"),
            format!("\"{fidelity}\""),
        );
    }
    let outcome = trial.run()?;
    // What deforms first settles under its weight; from then on nothing may move.
    let since = if fidelity == "rigid" { 0.0 } else { 2.0 };
    let mut drift = 0.0_f64;
    for object in 0..objects {
        for axis in 0..3 {
            let way = outcome.series(&format!("/objects/{object}/com/{axis}"));
            let rest = way
                .iter()
                .find(|(t, _)| *t >= since)
                .map_or(f64::NAN, |p| p.1);
            drift = way
                .iter()
                .filter(|(t, _)| *t >= since)
                .fold(drift, |worst, (_, x)| worst.max((x - rest).abs()));
        }
    }
    let awake = |frame: &&serde_json::Value| {
        let levels = frame["objects"].as_array().into_iter().flatten();
        levels.into_iter().any(|object| object["level"] != "asleep")
    };
    let last = outcome.frames.iter().rfind(awake);
    let asleep_after = last.map_or(0.0, |frame| frame["sim_time"].as_f64().unwrap_or(f64::NAN));
    let row = |quantity: String, measured: f64, gate: Gate| Row {
        quantity,
        reference: 0.0,
        source: "at rest",
        measured,
        gate,
        known_failure: None,
        command: trial.command(),
    };
    let mut rows = vec![row(
        format!("{what}, {fidelity}: drift from {since} s to {duration} s [dx]"),
        drift / DX,
        Gate::AtMost(0.1),
    )];
    // What is said to be a body stays one; asleep or not, it costs nothing per particle.
    if fidelity == "auto" {
        rows.push(row(
            format!("{what}, {fidelity}: asleep after [s]"),
            asleep_after,
            Gate::AtMost(2.0),
        ));
    }
    Ok(rows)
}
