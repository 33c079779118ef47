//! Hertz's impact: an elastic ball on a rigid plane.

use anyhow::Context;

use super::fit::{order, passes};
use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const PLANE: SceneText = scene_text!("validate/hertz");
const PAIR: SceneText = scene_text!("validate/hertz_pair");
const RADIUS: f64 = 0.1;
/// Speed of approach [m/s], as in the scene.
const SPEED: f64 = 0.1251;
/// Largest approach of the centre to the plane [m]: half m v^2 is the integral of 4/3 sqrt(R) E* d^(3/2).
const APPROACH: f64 = 0.05 * RADIUS;
/// Contact time over `APPROACH / SPEED`: twice the integral of `1 / sqrt(1 - s^(5/2))` from 0 to 1.
const DURATION: f64 = 2.9432;
/// The part of it between the moments at which the speed is 1 % off that of flight: the approach then is
/// `(1 - 0.99^2)^(2/5)` of the largest one.
const BETWEEN: f64 = 2.5248;
/// Contact time and largest approach over Hertz's at this speed, by finite elements (`docs/derivations/ball_impact.py`): his
/// theory leaves out waves and that strains are finite.
const ELEMENTS: [f64; 2] = [0.9480, 0.9449];

/// The case.
pub const CASE: Case = Case {
    number: 22,
    name: "hertz",
    about: "an elastic ball stays on a plane for as long as Hertz and finite elements say",
    run,
};

/// A run with so many cells along the radius, a cell and a half away from contact.
fn at(scene: &SceneText, cells: u32) -> Trial {
    let dx = RADIUS / f64::from(cells);
    let time = DURATION * APPROACH / SPEED;
    let away = RADIUS + 1.5 * dx;
    let trial = Trial::new(scene, 1.5 * dx / SPEED + 1.5 * time)
        .set("dx", dx)
        .set("objects.0.translation", format!("[0, {away}, 0]"));
    match scene.path == PAIR.path {
        true => trial.set("objects.1.translation", format!("[0, {}, 0]", -away)),
        false => trial,
    }
}

/// Contact time and largest approach of the first object, over Hertz's.
fn contact(outcome: &Outcome) -> anyhow::Result<[f64; 2]> {
    let speeds = outcome.series("/objects/0/linear_velocity/1");
    let heights = outcome.series("/objects/0/com/1");
    let away = speeds.last().context("no frame")?.1;
    let begin = passes(&speeds, -0.99 * SPEED).context("the ball never slows")?;
    let end = passes(&speeds, 0.99 * away).context("the ball never parts")?;
    let lowest = heights
        .iter()
        .fold(f64::INFINITY, |low, (_, y)| low.min(*y));
    let time = (end - begin) * DURATION / BETWEEN;
    Ok([
        time / (DURATION * APPROACH / SPEED),
        (RADIUS - lowest) / APPROACH,
    ])
}

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let all: &[u32] = match size {
        Size::Quick => &[8, 12],
        Size::Full => &[8, 12, 20],
    };
    let mut rows = Vec::new();
    let mut add = |trial: &Trial, what: &str, dx: f64, why: Option<&'static str>| {
        let found = contact(&trial.run()?)?;
        // Cells along the radius of the largest contact.
        let across = (RADIUS * APPROACH).sqrt() / dx;
        for (n, quantity, gate, why) in [
            (0, "contact time over Hertz's", 0.1, None),
            (1, "largest approach over Hertz's", 0.05, why),
        ] {
            rows.push(Row {
                quantity: format!("{what}, a/dx = {across:.1}: {quantity}"),
                reference: ELEMENTS[n],
                source: "finite elements",
                measured: found[n],
                gate: Gate::Relative(gate),
                known_failure: why,
                command: trial.command(),
            });
        }
        anyhow::Ok(found)
    };
    let mut errors = Vec::new();
    for &cells in all {
        let dx = RADIUS / f64::from(cells);
        let found = add(
            &at(&PLANE, cells),
            "plane",
            dx,
            (cells < 20).then_some(COARSE),
        )?;
        errors.push((dx, [0, 1].map(|n| (found[n] - ELEMENTS[n]).abs())));
    }
    if size == Size::Full {
        add(&at(&PAIR, 12), "two balls", RADIUS / 12.0, Some(COARSE))?;
    }
    let (first, last) = (errors[0], errors[errors.len() - 1]);
    for (n, quantity) in ["contact time", "largest approach"].iter().enumerate() {
        rows.push(Row {
            quantity: format!("order of the error of the {quantity}, first to last"),
            reference: 1.0,
            source: "at least as contact at the nearest particle",
            measured: order((first.0, first.1[n]), (last.0, last.1[n])),
            gate: Gate::AtLeast(0.9),
            known_failure: None,
            command: "see the rows above".into(),
        });
    }
    Ok(rows)
}

/// Why a coarse ball gives way too far.
const COARSE: &str =
    "the radius of the contact is less than three cells; the gate is meant for four and more";
