//! The largest stable time step: `dx sqrt(rho0 / (3 lambda + 2 mu))`, that of a particle alone.

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/cluster");
const FORM: &str = "omega dt < 2, omega^2 = 4 (3 lambda + 2 mu) / (rho0 dx^2)";
/// Probes, the lone particle first.
const PROBES: [&str; 8] = [
    "lone", "pair_a", "pair_b", "five_a", "five_b", "five_c", "five_d", "five_e",
];

/// The case.
pub const CASE: Case = Case {
    number: 1,
    name: "cluster",
    about: "particles alone and in clusters are stable just below the closed-form limit, and not above",
    run,
};

/// `dx sqrt(rho0 / (3 lambda + 2 mu))` of the scene's matter [s].
fn critical_dt(nu: f64) -> f64 {
    let lambda = 1e5 * nu / ((1.0 + nu) * (1.0 - 2.0 * nu));
    let mu = 1e5 / (2.0 * (1.0 + nu));
    0.1 * (1000.0 / (3.0 * lambda + 2.0 * mu)).sqrt()
}

/// Largest strain that a particle shows at the end of a frame, or infinity once it is no number.
fn strain(outcome: &Outcome, probe: &str) -> f64 {
    let mut largest = 0.0_f64;
    for i in 0..3 {
        for j in 0..3 {
            let rest = if i == j { 1.0 } else { 0.0 };
            let series = outcome.series(&format!("/probes/{probe}/deformation/{i}/{j}"));
            // JSON has no NaN: a frame without the number is one with a bad number.
            if series.len() < outcome.frames.len() {
                return f64::INFINITY;
            }
            for (_, f) in series {
                largest = largest.max((f - rest).abs());
            }
        }
    }
    largest
}

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let seconds = match size {
        Size::Quick => 5.0,
        Size::Full => 100.0,
    };
    let trial = |nu: f64, cfl: f64, seconds: f64| {
        Trial::new(&SCENE, seconds)
            .set("objects.0.material.poisson_ratio", nu)
            .set("cfl", cfl)
            .option("--f64")
    };
    // Strain rates of a thousandth over omega: amplitudes below 2e-5 when stable. At 0.95 of the limit the orbit of a
    // lone particle overshoots by 1 / sqrt(1 - 0.95^2) = 3.2; at 1.05 it grows by 1.86 per substep, 6000 times in 14.
    let mut rows = Vec::new();
    for nu in [0.0, 0.2, 0.3, 0.45, 0.49] {
        // Some hundred substeps a frame: equal shares of it are the asked fraction to half a per cent.
        let below = trial(nu, 0.95, seconds);
        let outcome = below.run()?;
        rows.push(Row {
            quantity: format!("strain of a lone particle at 0.95 of the limit, nu = {nu}"),
            reference: 0.0,
            source: FORM,
            measured: strain(&outcome, PROBES[0]).min(f64::MAX),
            gate: Gate::AtMost(1e-4),
            known_failure: None,
            command: below.command(),
        });
        // Clusters also shear freely, by less than half of the rates that they start with.
        let clusters = PROBES[1..].iter().map(|probe| strain(&outcome, probe));
        rows.push(Row {
            quantity: format!("largest strain in clusters at 0.95 of the limit, nu = {nu}"),
            reference: 0.0,
            source: FORM,
            measured: clusters.fold(0.0, f64::max).min(f64::MAX),
            gate: Gate::AtMost(5e-4 * seconds),
            known_failure: None,
            command: below.command(),
        });
        // One frame of 14 substeps: the solver without guard takes ever smaller ones for what has blown up, and would not
        // come back. They are equal shares of it as long as the tangent leaves room up to 1.08.
        let frame = 14.0 * 1.05 * critical_dt(nu);
        let above = trial(nu, 1.08, 0.999 * frame).set("frame_rate", 1.0 / frame);
        rows.push(Row {
            quantity: format!(
                "strain of a lone particle after 14 substeps of 1.05 of the limit, nu = {nu}"
            ),
            reference: 0.0,
            source: FORM,
            measured: strain(&above.run()?, "lone").min(f64::MAX),
            gate: Gate::AtLeast(1e-3),
            known_failure: None,
            command: above.command(),
        });
    }
    Ok(rows)
}
