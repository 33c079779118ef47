//! Oblique impact of two balls that slip on each other, along the axes of the grid and turned against them.

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/oblique");
const RADIUS: f64 = 0.1;
/// Speed along and across the line between the balls as they touch, of each [m/s].
const SPEED: [f64; 2] = [0.2, 0.3];
/// Distance between the balls at the start, half of it [m].
const AWAY: f64 = 0.005;
/// How long it takes them to meet and part [s].
const TIME: f64 = 0.08;
/// Turn about z [degrees].
const TURNED: f64 = 23.0;

/// The case.
pub const CASE: Case = Case {
    number: 24,
    name: "oblique",
    about: "friction turns balls that meet obliquely as Coulomb says, wherever the grid lies",
    run,
};

/// A run with a coefficient of friction, turned by some degrees.
fn at(cells: f64, friction: f64, turned: f64) -> Trial {
    let (sin, cos) = turned.to_radians().sin_cos();
    let turn = |x: f64, y: f64, sign: f64| {
        let [x, y] = [cos * x - sin * y, sin * x + cos * y].map(|c| sign * c);
        format!("[{x}, {y}, 0]")
    };
    let across = AWAY * SPEED[1] / SPEED[0];
    let mut trial = Trial::new(&SCENE, TIME).set("dx", 2.0 * RADIUS / cells);
    for (n, sign) in [1.0, -1.0].into_iter().enumerate() {
        let place = turn(-RADIUS - AWAY, -across, sign);
        trial = trial
            .set(&format!("objects.{n}.translation"), place)
            .set(
                &format!("objects.{n}.linear_velocity"),
                turn(SPEED[0], SPEED[1], sign),
            )
            .set(&format!("objects.{n}.friction"), friction);
    }
    trial
}

/// Angular momentum of the first ball about its middle over its radius and what it gave to the other, without its sign.
fn turned(outcome: &Outcome) -> anyhow::Result<f64> {
    let last = |what: &str| outcome.last(&format!("/objects/0/{what}"));
    let mut given = 0.0;
    for a in 0..2 {
        let series = outcome.series(&format!("/objects/0/linear_velocity/{a}"));
        let first = series.first().map_or(f64::NAN, |(_, v)| *v);
        given += (last(&format!("linear_velocity/{a}"))? - first).powi(2);
    }
    Ok(0.4 * RADIUS * last("angular_velocity/2")?.abs() / given.sqrt())
}

/// What the spin may be off by, over what presses: normals that lean by half a degree.
const GATE: f64 = 0.01;

const LEANS: &str = "normals between deformable objects lean towards the nearest axis by up to a degree, with any number of cells";
const COARSE: &str = "contact lags behind where balls move past each other; with twice the cells less than half of it is left";

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let all: &[f64] = match size {
        Size::Quick => &[12.0],
        Size::Full => &[12.0, 24.0],
    };
    let mut rows = Vec::new();
    for &cells in all {
        for (turn, where_) in [(0.0, "along the axes"), (TURNED, "turned by 23 degrees")] {
            for friction in [0.0_f64, 0.1] {
                let trial = at(cells, friction, turn);
                // What was given has a part along the surface as well.
                let reference = friction / friction.hypot(1.0);
                rows.push(Row {
                    quantity: format!(
                        "{cells} cells across, {where_}, mu {friction}: friction over pressure"
                    ),
                    reference,
                    source: "Coulomb",
                    measured: turned(&trial.run()?)?,
                    gate: Gate::Absolute(GATE),
                    known_failure: match (turn > 0.0, cells < 24.0) {
                        (true, _) => Some(LEANS),
                        (false, coarse) => coarse.then_some(COARSE),
                    },
                    command: trial.command(),
                });
            }
        }
    }
    Ok(rows)
}
