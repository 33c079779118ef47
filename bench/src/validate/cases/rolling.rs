//! Disk and ball on a slope: rolling and slipping.

use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const DISK: SceneText = scene_text!("validate/rolling_disk");
const BALL: SceneText = scene_text!("validate/rolling_ball");
/// Gravity along and across the slope of 45 degrees [m/s^2].
const G: f64 = 6.93672;
const RADIUS: f64 = 0.5;
/// Height of the fall before the slope is met: 1.1 cells [m].
const DROP: f64 = 0.055;

/// The case.
pub const CASE: Case = Case {
    number: 11,
    name: "rolling",
    about: "a disk and a ball roll or slip down a slope of 45 degrees",
    run,
};

/// One body on the slope.
struct Setup {
    what: &'static str,
    scene: &'static SceneText,
    fidelity: &'static str,
    /// Inertia over `m R^2`.
    inertia: f64,
    friction: f64,
    drop: f64,
}

const FOOT: &str = "friction acts in the plane, with the sum that it should have, but the foot is half a cell to either side, and what presses the \
     disk lies up to 0.2 cells in front of its middle where it turns and 0.1 cells behind where it slides";

/// Why a spin is wrong, where it is.
fn why(setup: &Setup, rolls: bool) -> Option<&'static str> {
    (setup.what == "disk" && !rolls).then_some(FOOT)
}

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (what, scene, fidelity, inertia) in [
        ("disk", &DISK, "mpm", 0.5),
        ("ball", &BALL, "mpm", 0.4),
        ("rigid disk", &DISK, "rigid", 0.5),
        ("rigid ball", &BALL, "rigid", 0.4),
    ] {
        for friction in [0.1, 0.2, 0.5, 0.7] {
            for drop in [DROP, 0.0] {
                let few = (friction == 0.1 || friction == 0.5) && drop > 0.0;
                let chosen = match size {
                    Size::Quick => few && what != "ball",
                    // 33 thousand particles.
                    Size::Full => few || what != "ball",
                };
                if chosen {
                    rows.extend(roll(&Setup {
                        what,
                        scene,
                        fidelity,
                        inertia,
                        friction,
                        drop,
                    })?);
                }
            }
        }
    }
    Ok(rows)
}

fn roll(setup: &Setup) -> anyhow::Result<Vec<Row>> {
    let Setup {
        inertia,
        friction,
        drop,
        ..
    } = *setup;
    let trial = Trial::new(setup.scene, 0.8)
        .set("objects.0.fidelity", format!("\"{}\"", setup.fidelity))
        .set("colliders.0.friction", friction)
        .set(
            "objects.0.translation",
            format!("[0, {}, 0]", RADIUS + drop),
        );
    let outcome = trial.run()?;
    let t = outcome.last("/sim_time")?;
    let fall = (2.0 * drop / G).sqrt();
    // Of what pulls down the slope, rolling leaves 1 / (1 + I / m R^2); that needs friction of the rest.
    let part = 1.0 / (1.0 + inertia);
    let rolls = friction >= 1.0 - part;
    let distance = if rolls {
        // In the air nothing holds it; at touch-down it keeps its angular momentum about the place of contact.
        let rolled = t - fall;
        0.5 * G * fall * fall + part * G * (fall * rolled + 0.5 * rolled * rolled)
    } else {
        // Friction is mu times the pressing force, whose double integral over time is m (g t^2 / 2 - drop).
        0.5 * G * t * t - friction * (0.5 * G * t * t - drop)
    };
    let spin = if rolls {
        part * G * t / RADIUS
    } else {
        // Friction has given mu times what has pressed, which is m (g t + v): a dropped disk may be on its way up again.
        let rise = outcome.last("/objects/0/linear_velocity/1")?;
        friction * (G * t + rise) / (inertia * RADIUS)
    };
    let gate = Gate::Relative(if rolls { 0.1 } else { 0.01 });
    let how = if drop > 0.0 { "dropped" } else { "laid down" };
    let name = |quantity: &str| format!("{}, mu {friction}, {how}: {quantity}", setup.what);
    let source = if rolls {
        "rolls: closed form"
    } else {
        "slips: closed form"
    };
    let mut rows = vec![Row {
        quantity: name("distance after 0.8 s [m]"),
        reference: distance,
        source,
        measured: outcome.last("/objects/0/com/0")?,
        gate,
        known_failure: None,
        command: trial.command(),
    }];
    if setup.what != "ball" {
        rows.push(Row {
            quantity: name("spin [rad/s]"),
            reference: spin,
            source,
            measured: -outcome.last("/objects/0/angular_velocity/2")?,
            gate,
            known_failure: why(setup, rolls),
            command: trial.command(),
        });
    }
    Ok(rows)
}
