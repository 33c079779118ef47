//! The vortex of Taylor and Green: how fast viscosity, and the method beside it, stop a flow.

use super::fit::{order, slope};
use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const ONE: SceneText = scene_text!("validate/taylor_green");
const NINE: SceneText = scene_text!("validate/taylor_green_array");
/// Edge of a vortex [m], half a wave.
const LENGTH: f64 = 0.5;
/// How much deeper the fluid is before it is pressed.
const PRESSED: f64 = 0.02;
/// How long it takes to press it [s].
const PRESSING: f64 = 0.05;
/// Rate of the kinetic energy, `4 nu k^2` with nu = 0.01 m^2/s and k = 2 pi / m [1/s].
const RATE: f64 = 0.16 * std::f64::consts::PI * std::f64::consts::PI;

/// The case.
pub const CASE: Case = Case {
    number: 21,
    name: "taylor_green",
    about: "viscosity stops vortices at the rate that is exact for them",
    run,
};

/// A scene with `cells` along a vortex, two cells deep, for three times as long as it takes to press it.
fn at(scene: &SceneText, cells: u32) -> Trial {
    let dx = LENGTH / f64::from(cells);
    let depth = 2.0 * dx * (1.0 + PRESSED);
    let mut trial = Trial::new(scene, 3.0 * PRESSING).set("dx", dx);
    let boxes: &[[f64; 4]] = match scene.path == ONE.path {
        true => &[[0.5, 0.5, 0.25, 0.25]],
        false => &[
            [0.5, 0.5, 0.25, 0.25],
            [1.5, 0.5, 0.25, -0.25],
            [1.5, 0.5, 0.25, 0.75],
            [0.5, 0.5, -0.25, 0.25],
            [0.5, 0.5, 0.75, 0.25],
        ],
    };
    for (n, [width, height, x, y]) in boxes.iter().enumerate() {
        trial = trial
            .set(
                &format!("objects.{n}.shape.size"),
                format!("[{width}, {height}, {depth}]"),
            )
            .set(
                &format!("objects.{n}.translation"),
                format!("[{x}, {y}, {}]", 0.5 * depth),
            );
    }
    let speed = 2.0 * dx * PRESSED / PRESSING;
    trial
        .set("colliders.5.point", format!("[0, 0, {depth}]"))
        .set(
            "colliders.5.motion.linear_velocity",
            format!("[0, 0, {}]", -speed),
        )
}

/// Rate at which the kinetic energy of the first object falls once the fluid is pressed, over the exact one: the
/// effective viscosity over that of the fluid.
fn effective(trial: &Trial) -> anyhow::Result<f64> {
    let mut energy = trial.run()?.series("/objects/0/kinetic_energy");
    energy.retain(|(t, _)| *t > PRESSING - 1e-6);
    let logarithm: Vec<(f64, f64)> = energy.iter().map(|(t, e)| (*t, e.ln())).collect();
    Ok(-slope(&logarithm) / RATE)
}

fn row(quantity: String, measured: f64, gate: Gate, command: String) -> Row {
    Row {
        quantity,
        reference: 1.0,
        source: "Taylor and Green: exp(-2 nu k^2 t); 10 % at 64 cells a wave, Re = 100",
        measured,
        gate,
        known_failure: None,
        command,
    }
}

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let (open, walled): (&[u32], &[u32]) = match size {
        Size::Quick => (&[8, 16], &[16]),
        Size::Full => (&[8, 16, 32], &[16, 32]),
    };
    let mut rows = Vec::new();
    let mut errors = Vec::new();
    for &cells in open {
        let trial = at(&NINE, cells);
        let measured = effective(&trial)?;
        errors.push((LENGTH / f64::from(cells), (measured - 1.0).abs()));
        let coarser = 32.0 / f64::from(cells);
        rows.push(row(
            format!(
                "viscosity in the middle of nine vortices over that of the fluid, {} cells a wave",
                2 * cells
            ),
            measured,
            // The gate at 64 cells, grown at the order of the splines.
            Gate::Relative(0.1 * coarser * coarser),
            trial.command(),
        ));
    }
    rows.push(Row {
        quantity: "order of what the method adds to viscosity, 16 to 32 cells a wave".into(),
        reference: 3.0,
        source: "(k dx)^4 per substep of APIC, dt in proportion to dx",
        measured: order(errors[0], errors[1]),
        gate: Gate::AtLeast(1.8),
        known_failure: None,
        command: "see the rows above".into(),
    });
    for &cells in walled {
        let trial = at(&ONE, cells);
        let measured = effective(&trial)?;
        rows.push(Row {
            known_failure: (cells == 16).then_some(COARSE),
            ..row(
                format!(
                    "viscosity of a single vortex between walls over that of the fluid, {} cells a wave",
                    2 * cells
                ),
                measured,
                Gate::Relative(0.1),
                trial.command(),
            )
        });
    }
    Ok(rows)
}

/// Why a vortex between walls stops too soon.
const COARSE: &str = "what transfers take at this size: the middle of nine vortices, which has no wall, loses 14 % too much as \
                      well; with half the cells 6 % between walls";
