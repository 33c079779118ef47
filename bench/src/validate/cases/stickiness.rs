//! Two blocks with a gap between them part, or pass each other: nothing may hold them.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/stickiness");
const DX: f64 = 0.05;

/// The case.
pub const CASE: Case = Case {
    number: 13,
    name: "stickiness",
    about: "blocks that part, or pass each other without friction, keep their speed",
    run,
};

const GLUED: &str = "one velocity field for both blocks: they are one body to the grid as long as a node has mass of both, \
     at up to 2.5 cells of distance. Take two_scale, the default.";

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let gaps: &[f64] = match size {
        Size::Quick => &[0.0, 0.5, 1.5],
        Size::Full => &[0.0, 0.5, 1.0, 1.5, 2.0, 2.5],
    };
    let mut rows = Vec::new();
    for &gap in gaps {
        rows.push(kept("two_scale", gap, true, None)?);
        if gap >= 0.5 {
            rows.push(kept("two_scale", gap, false, None)?);
        }
    }
    rows.push(kept("single_field", 0.0, true, Some(GLUED))?);
    if size == Size::Full {
        rows.push(kept("single_field", 1.0, true, Some(GLUED))?);
        rows.push(kept("single_field", 1.0, false, Some(GLUED))?);
        rows.push(kept("multi_field", 0.0, true, None)?);
        rows.push(kept("multi_field", 1.0, true, None)?);
        rows.push(kept("multi_field", 0.5, false, None)?);
        rows.push(kept("multi_field", 1.0, false, None)?);
    }
    Ok(rows)
}

/// Which part of their relative speed the blocks keep for a second.
fn kept(
    method: &str,
    gap: f64,
    part: bool,
    known_failure: Option<&'static str>,
) -> anyhow::Result<Row> {
    let axis = usize::from(!part);
    let velocity = |v: f64| {
        if part {
            format!("[{v}, 0, 0]")
        } else {
            format!("[0, {v}, 0]")
        }
    };
    let trial = Trial::new(&SCENE, 1.0)
        .set("contact", method)
        .set("objects.0.linear_velocity", velocity(-0.05))
        .set("objects.1.linear_velocity", velocity(0.05))
        .set(
            "objects.1.translation",
            format!("[{}, 0, 0]", 0.25 + gap * DX),
        );
    let outcome = trial.run()?;
    let speed = |object: usize| outcome.last(&format!("/objects/{object}/linear_velocity/{axis}"));
    let motion = if part { "parting" } else { "sliding past" };
    Ok(Row {
        quantity: format!("{method}, gap {gap} dx, {motion}: part of the speed kept"),
        reference: 1.0,
        source: "nothing acts",
        measured: (speed(1)? - speed(0)?) / 0.1,
        gate: Gate::AtLeast(if part { 0.99 } else { 0.9 }),
        known_failure,
        command: trial.command(),
    })
}
