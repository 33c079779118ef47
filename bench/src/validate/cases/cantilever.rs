//! A beam clamped at one end: how far it swings under a small load, and how fast.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/cantilever");
/// Free length [m].
const LENGTH: f64 = 8.0;
/// Static deflection of the tip after Euler and Bernoulli, and Timoshenko's share of shear [m].
const STATIC: f64 = 0.1174 + 0.0021;
/// First period after Euler and Bernoulli [s].
const PERIOD: f64 = 12.25;

/// The case.
pub const CASE: Case = Case {
    number: 8,
    name: "cantilever",
    about: "a clamped beam swings under its own weight",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let all: &[f64] = match size {
        Size::Quick => &[0.25],
        Size::Full => &[0.25, 0.125],
    };
    let mut rows = Vec::new();
    for &dx in all {
        let clamped = 3.0 * dx;
        let trial = Trial::new(&SCENE, 14.0)
            .set("dx", dx)
            .set(
                "objects.0.shape.size",
                format!("[{}, 1, {}]", LENGTH + clamped, 2.0 * dx),
            )
            .set(
                "objects.0.translation",
                format!("[{}, 0.5, {dx}]", 0.5 * (LENGTH - clamped)),
            )
            .set("colliders.1.point", format!("[0, 0, {}]", 2.0 * dx));
        let height = trial.run()?.series("/probes/tip/position/1");
        let start = height.first().map_or(f64::NAN, |h| h.1);
        let lowest = height.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let (half, low) = lowest.copied().unwrap_or((f64::NAN, f64::NAN));
        let back = height
            .iter()
            .filter(|(t, _)| *t > half)
            .max_by(|a, b| a.1.total_cmp(&b.1));
        rows.push(Row {
            quantity: format!("largest over static deflection, {} cells across", 1.0 / dx),
            reference: 2.0,
            source: "a load that acts at once; Euler and Bernoulli with shear",
            measured: (start - low) / STATIC,
            gate: Gate::Relative(0.05),
            known_failure: None,
            command: trial.command(),
        });
        rows.push(Row {
            quantity: format!("first period [s], {} cells across", 1.0 / dx),
            reference: PERIOD,
            source: "2 pi L^2 / 1.8751^2 sqrt(12 rho (1 - nu^2) / (E h^2))",
            measured: back.map_or(f64::NAN, |(t, _)| *t),
            gate: Gate::Relative(0.04),
            known_failure: None,
            command: trial.command(),
        });
    }
    Ok(rows)
}
