//! Columns under their own weight: pressure of a fluid, stress of a solid, and rest.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/column");
const HEIGHT: f64 = 1.0;
const WEIGHT: f64 = 1000.0 * 9.81;
/// Probes, one per cell from 0.1125 m on, where particles are at rest.
const PROBES: u32 = 16;

/// The case.
pub const CASE: Case = Case {
    number: 9,
    name: "column",
    about: "in a column at rest pressure grows with depth",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let (settled, end) = match size {
        Size::Quick => (1.0, 1.5),
        Size::Full => (2.0, 7.0),
    };
    let solid = "{ law = \"neo_hookean\", youngs_modulus_pa = 1e6, poisson_ratio = 0.3, density_kg_m3 = 1000 }";
    let mut rows = Vec::new();
    for (matter, material) in [("fluid", None), ("solid", Some(solid))] {
        let mut trial = Trial::new(&SCENE, end);
        if let Some(material) = material {
            trial = trial.set("objects.0.material", material);
        }
        let outcome = trial.run()?;
        let (mut off, mut all) = (0.0, 0.0);
        for n in 0..PROBES {
            let exact = WEIGHT * (HEIGHT - 0.1125 - 0.05 * f64::from(n));
            let pressure = -outcome.last(&format!("/probes/p{n:02}/stress/1/1"))?;
            off += (pressure - exact) * (pressure - exact);
            all += exact * exact;
        }
        let row = |quantity: &str, measured: f64, gate: f64, source| Row {
            quantity: format!("{matter}: {quantity}"),
            reference: 0.0,
            source,
            measured,
            gate: Gate::AtMost(gate),
            known_failure: None,
            command: trial.command(),
        };
        rows.push(row(
            "L2 error of the pressure, relative",
            (off / all).sqrt(),
            0.03,
            "rho0 g (H0 - Y)",
        ));
        let energy = outcome.last("/kinetic_energy")?;
        let speed = (2.0 * energy / outcome.last("/objects/0/mass")?).sqrt();
        let reference = (9.81 * HEIGHT).sqrt();
        rows.push(row(
            "rms speed over sqrt(g H)",
            speed / reference,
            1e-3,
            "rest",
        ));
        let heights = outcome.series("/objects/0/com/1");
        let at = |time: f64| {
            heights
                .iter()
                .find(|(t, _)| *t >= time - 1e-6)
                .map_or(f64::NAN, |h| h.1)
        };
        let drift = (at(end) - at(settled)).abs() / HEIGHT;
        rows.push(row(
            "sinking of the centre of mass after settling, over H",
            drift,
            1e-3,
            "rest",
        ));
    }
    Ok(rows)
}
