//! Objects that change what models them on their way keep momentum, spin and path.

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/fidelity");
/// Half an edge of the cubes [m]; the tolerance is relative to their effective radius, which is no less.
const RADIUS: f64 = 0.2;
/// `tolerance` of the scene, the default.
const TOLERANCE: f64 = 0.01;

/// The case.
pub const CASE: Case = Case {
    number: 18,
    name: "fidelity",
    about: "two spinning cubes become bodies, matter again where they meet, and bodies once more",
    run,
};

fn run(_size: Size) -> anyhow::Result<Vec<Row>> {
    let trial = |fidelity: &str| {
        let quoted = format!("\"{fidelity}\"");
        Trial::new(&SCENE, 1.0)
            .set("objects.0.fidelity", &quoted)
            .set("objects.1.fidelity", &quoted)
    };
    let (auto, mpm) = (trial("auto"), trial("mpm"));
    let (switched, full) = (auto.run()?, mpm.run()?);
    let levels: Vec<bool> = switched
        .frames
        .iter()
        .map(|frame| {
            frame
                .pointer("/objects/0/level")
                .is_some_and(|l| l == "rigid")
        })
        .collect();
    let switches = levels.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let row = |quantity: &str, reference: f64, source, measured: f64, gate: Gate| Row {
        quantity: quantity.into(),
        reference,
        source,
        measured,
        gate,
        known_failure: None,
        command: auto.command(),
    };
    Ok(vec![
        row(
            "changes of model of the first cube",
            3.0,
            "flies, meets, flies",
            switches as f64,
            Gate::AtLeast(2.0),
        ),
        row(
            "change of momentum, relative to that of one cube",
            0.0,
            "nothing acts from outside",
            change(&switched, "linear_momentum", "linear_velocity")?,
            Gate::AtMost(1e-6),
        ),
        row(
            "change of angular momentum, relative",
            0.0,
            "nothing acts from outside",
            change(&switched, "angular_momentum", "")?,
            Gate::AtMost(1e-6),
        ),
        row(
            "distance of the paths before they meet [radii]",
            0.0,
            "the same with fidelity = \"mpm\"",
            apart(&switched, &full, 0.3),
            Gate::AtMost(TOLERANCE),
        ),
        row(
            "distance of the paths, the collision included [radii]",
            0.0,
            "the same with fidelity = \"mpm\"",
            apart(&switched, &full, 1.0),
            Gate::AtMost(TOLERANCE),
        ),
    ])
}

/// Largest change of a conserved vector of the whole scene, over the momentum of an object or its own length.
fn change(outcome: &Outcome, vector: &str, speed: &str) -> anyhow::Result<f64> {
    let scale = if speed.is_empty() {
        let first = |axis| {
            outcome
                .series(&format!("/{vector}/{axis}"))
                .first()
                .map_or(0.0, |v| v.1)
        };
        (0..3).map(|axis| first(axis).powi(2)).sum::<f64>().sqrt()
    } else {
        outcome
            .series(&format!("/objects/0/{speed}/0"))
            .first()
            .map_or(0.0, |v| v.1.abs())
            * outcome.last("/objects/0/mass")?
    };
    let mut worst = 0.0_f64;
    for axis in 0..3 {
        let values = outcome.series(&format!("/{vector}/{axis}"));
        let first = values.first().map_or(f64::NAN, |v| v.1);
        worst = values
            .iter()
            .fold(worst, |worst, v| worst.max((v.1 - first).abs()));
    }
    Ok(worst / scale)
}

/// Largest distance between the centres of mass of two runs until a time, in radii.
fn apart(a: &Outcome, b: &Outcome, until: f64) -> f64 {
    let mut worst = 0.0_f64;
    for object in 0..2 {
        for axis in 0..3 {
            let pointer = format!("/objects/{object}/com/{axis}");
            let (a, b) = (a.series(&pointer), b.series(&pointer));
            let frames = a.iter().zip(&b).filter(|(a, _)| a.0 <= until);
            worst = frames.fold(worst, |worst, (a, b)| worst.max((a.1 - b.1).abs()));
        }
    }
    worst / RADIUS
}
