//! Two elastic disks: when they meet, and how much of their speed they keep.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/disks");
/// Speed of approach [m/s].
const APPROACH: f64 = 0.282_842_712;
/// Moment of contact: `(0.6 sqrt 2 - 0.4) / 0.2 sqrt 2` [s].
const CONTACT: f64 = 1.585_786_438;

/// The case.
pub const CASE: Case = Case {
    number: 5,
    name: "disks",
    about: "two elastic disks meet and part",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let all: &[(u32, f64)] = match size {
        Size::Quick => &[(20, 0.65), (40, 0.78)],
        Size::Full => &[(20, 0.65), (40, 0.78), (80, 0.85)],
    };
    let mut rows = Vec::new();
    for &(cells, least) in all {
        let dx = 1.0 / f64::from(cells);
        for method in ["two_scale", "multi_field", "single_field"] {
            let trial = Trial::new(&SCENE, 3.6)
                .set("dx", dx)
                .set("contact", format!("{method:?}"))
                .set("objects.0.shape.height", 2.0 * dx)
                .set("objects.0.translation", format!("[0.2, 0.2, {dx}]"))
                .set("objects.1.translation", format!("[0.8, 0.8, {dx}]"))
                .set("colliders.1.point", format!("[0, 0, {}]", 2.0 * dx));
            let outcome = trial.run()?;
            let mut parting = 0.0;
            for axis in 0..2 {
                let speed =
                    |object| outcome.last(&format!("/objects/{object}/linear_velocity/{axis}"));
                parting += (speed(1)? - speed(0)?) / std::f64::consts::SQRT_2;
            }
            let row = |quantity: String| Row {
                quantity: format!("{quantity}, {method}, {cells} cells"),
                reference: 1.0,
                source: "an elastic collision",
                measured: parting / APPROACH,
                gate: Gate::AtLeast(least),
                known_failure: None,
                command: trial.command(),
            };
            if method != "single_field" {
                rows.push(row("restitution of the centres of mass".into()));
            }
            let energy = outcome.series("/elastic_energy");
            let first = outcome
                .series("/kinetic_energy")
                .first()
                .map_or(f64::NAN, |e| e.1);
            let onset = energy.iter().find(|(_, e)| *e >= 0.01 * first);
            rows.push(Row {
                reference: CONTACT,
                source: "distance over speed of approach; the gate is 2 dx / v",
                measured: onset.map_or(f64::NAN, |(t, _)| *t),
                gate: Gate::Absolute(2.0 * dx / APPROACH),
                ..row("moment at which 1 % of the energy is elastic [s]".into())
            });
            let momentum = (0..2).map(|axis| outcome.last(&format!("/linear_momentum/{axis}")));
            let momentum: f64 = momentum
                .collect::<anyhow::Result<Vec<_>>>()?
                .iter()
                .map(|p| p.abs())
                .sum();
            let mass = outcome.last("/objects/0/mass")?;
            rows.push(Row {
                reference: 0.0,
                source: "conservation",
                measured: momentum / (mass * APPROACH),
                gate: Gate::AtMost(1e-5),
                ..row("momentum at the end over that of one disk".into())
            });
        }
    }
    Ok(rows)
}
