//! Deformable objects that meet each other, a plane or a wall.

use anyhow::Context;

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{
        case::{Case, Size},
        measures::{first, passes},
        report::Gate,
    },
};

const DISKS: SceneText = scene_text!("validate/disks");
/// Closing speed [m/s].
const DISKS_SPEED: f64 = 0.282_842_712;
/// Moment of contact: `(0.6 sqrt 2 - 0.4) / 0.2 sqrt 2` [s].
const DISKS_CONTACT: f64 = 1.585_786_438;

/// 5: two elastic disks: when they meet, and how much of their speed they keep.
pub fn disks(size: Size) -> Vec<Case> {
    let all: &[(u32, f64)] = size.pick(
        &[(20, 0.65), (40, 0.78)],
        &[(20, 0.65), (40, 0.78), (80, 0.85)],
    );
    let parting = |run: &Outcome| {
        let mut parting = 0.0;
        for axis in 0..2 {
            let speed = |object| run.last(&format!("/objects/{object}/linear_velocity/{axis}"));
            parting += (speed(1)? - speed(0)?) / std::f64::consts::SQRT_2;
        }
        Ok(parting / DISKS_SPEED)
    };
    let onset = |run: &Outcome| {
        let start = first(&run.series("/kinetic_energy"));
        let energy = run.series("/elastic_energy");
        let onset = energy.iter().find(|(_, e)| *e >= 0.01 * start);
        Ok(onset.map_or(f64::NAN, |(t, _)| *t))
    };
    let momentum = |run: &Outcome| {
        let momentum = (0..2).map(|axis| run.last(&format!("/linear_momentum/{axis}")));
        let momentum = momentum.collect::<anyhow::Result<Vec<_>>>()?;
        let momentum: f64 = momentum.iter().map(|p| p.abs()).sum();
        Ok(momentum / (run.last("/objects/0/mass")? * DISKS_SPEED))
    };
    let mut cases = Vec::new();
    for &(cells, least) in all {
        let dx = 1.0 / f64::from(cells);
        for method in ["two_scale", "multi_field", "single_field"] {
            let trial = Trial::new(&DISKS, 3.6)
                .set("dx", dx)
                .set("contact", format!("{method:?}"))
                .set("objects.0.shape.height", 2.0 * dx)
                .set("objects.0.translation", format!("[0.2, 0.2, {dx}]"))
                .set("objects.1.translation", format!("[0.8, 0.8, {dx}]"))
                .set("colliders.1.point", format!("[0, 0, {}]", 2.0 * dx));
            let name = |quantity: &str| format!("{quantity}, {method}, {cells} cells");
            if method != "single_field" {
                let quantity = name("restitution of the centres of mass");
                cases.push(
                    Case::new(
                        "restitution of the centres of mass",
                        quantity,
                        &trial,
                        parting,
                    )
                    .against(1.0, "an elastic collision")
                    .within(Gate::AtLeast(least)),
                );
            }
            cases.extend([
                Case::new(
                    "moment at which 1 % of the energy is elastic [s]",
                    name("moment at which 1 % of the energy is elastic [s]"),
                    &trial,
                    onset,
                )
                .against(
                    DISKS_CONTACT,
                    "distance over speed of approach; the gate is 2 dx / v",
                )
                .within(Gate::Absolute(2.0 * dx / DISKS_SPEED)),
                Case::new(
                    "momentum at the end over that of one disk",
                    name("momentum at the end over that of one disk"),
                    &trial,
                    momentum,
                )
                .against(0.0, "conservation")
                .within(Gate::AtMost(1e-5)),
            ]);
        }
    }
    cases
}

const STICKINESS: SceneText = scene_text!("validate/stickiness");

const GLUED: &str = "one velocity field for both blocks: they are one body to the grid as long as a node has mass of both, \
     at up to 2.5 cells of distance. Take two_scale, the default.";

/// 13: two blocks with a gap between them part, or pass each other: nothing may hold them.
pub fn stickiness(size: Size) -> Vec<Case> {
    let gaps: &[f64] = size.pick(&[0.0, 0.5, 1.5], &[0.0, 0.5, 1.0, 1.5, 2.0, 2.5]);
    let mut cases = Vec::new();
    for &gap in gaps {
        cases.push(kept(
            "two_scale: speed kept by blocks that part",
            "two_scale",
            gap,
            true,
        ));
        if gap >= 0.5 {
            let claim = "two_scale: speed kept by blocks that slide past";
            cases.push(kept(claim, "two_scale", gap, false));
        }
    }
    let rest: &[(&str, f64, bool)] = &[
        ("single_field", 0.0, true),
        ("single_field", 1.0, true),
        ("single_field", 1.0, false),
        ("multi_field", 0.0, true),
        ("multi_field", 1.0, true),
        ("multi_field", 0.5, false),
        ("multi_field", 1.0, false),
    ];
    for &(method, gap, part) in size.pick(&rest[..1], rest) {
        cases.push(match method {
            "single_field" => {
                kept("single_field: speed kept", "single_field", gap, part).fails(GLUED)
            }
            _ => kept("multi_field: speed kept", "multi_field", gap, part),
        });
    }
    cases
}

/// Which part of their relative speed the blocks keep for a second.
fn kept(claim: &'static str, method: &str, gap: f64, part: bool) -> Case {
    let axis = usize::from(!part);
    let velocity = |v: f64| {
        if part {
            format!("[{v}, 0, 0]")
        } else {
            format!("[0, {v}, 0]")
        }
    };
    let trial = Trial::new(&STICKINESS, 1.0)
        .set("contact", method)
        .set("objects.0.linear_velocity", velocity(-0.05))
        .set("objects.1.linear_velocity", velocity(0.05))
        .set(
            "objects.1.translation",
            format!("[{}, 0, 0]", 0.25 + gap * 0.05),
        );
    let motion = if part { "parting" } else { "sliding past" };
    Case::new(
        claim,
        format!("{method}, gap {gap} dx, {motion}: part of the speed kept"),
        &trial,
        move |run| {
            let speed =
                |object: usize| run.last(&format!("/objects/{object}/linear_velocity/{axis}"));
            Ok((speed(1)? - speed(0)?) / 0.1)
        },
    )
    .against(1.0, "nothing acts")
    .within(Gate::AtLeast(if part { 0.99 } else { 0.9 }))
}

const TAYLOR_BAR: SceneText = scene_text!("validate/taylor_bar");
const TAYLOR_RADIUS: f64 = 3.2e-3;

/// 17: a copper bar hits a wall: length and radius of what is left.
pub fn taylor_bar(size: Size) -> Vec<Case> {
    let cells: f64 = size.pick(4.0, 6.0);
    let dx = TAYLOR_RADIUS / cells;
    let trial = Trial::new(&TAYLOR_BAR, 8e-5).set("dx", dx);
    let half_spacing = 0.25 * dx;
    // The outermost particles stand for what is around them: at the cold end half their spacing, around the foot
    // as much more as the foot has widened there.
    let length = move |run: &Outcome| Ok(1e3 * (run.last("/probes/bar/max/1")? + half_spacing));
    let foot = move |run: &Outcome| {
        let at = |side: &str, axis: usize| run.last(&format!("/probes/bar/{side}/{axis}"));
        let widest = [at("max", 0)?, -at("min", 0)?, at("max", 2)?, -at("min", 2)?];
        let mean = widest.iter().sum::<f64>() / 4.0;
        Ok(1e3 * (mean * TAYLOR_RADIUS / (TAYLOR_RADIUS - half_spacing)))
    };
    let published = "middle of published results, 21.3 to 21.5 and 6.9 to 7.25";
    vec![
        Case::new(
            "length [mm]",
            format!("R/dx = {cells}: length [mm]"),
            &trial,
            length,
        )
        .against(21.4, published)
        .within(Gate::Relative(0.03)),
        Case::new(
            "radius of the foot [mm]",
            format!("R/dx = {cells}: radius of the foot [mm]"),
            &trial,
            foot,
        )
        .against(7.075, published)
        .within(Gate::Relative(0.06)),
        Case::new(
            "kinetic energy left after 80 us",
            "kinetic energy left after 80 us",
            &trial,
            |run| {
                let energy = run.series("/kinetic_energy");
                Ok(energy.last().map_or(f64::NAN, |e| e.1 / 239.6))
            },
        )
        .against(0.0, "at rest: at most 1 % of the 239.6 J it had")
        .within(Gate::AtMost(0.01)),
    ]
}

const PLANE: SceneText = scene_text!("validate/hertz");
const PAIR: SceneText = scene_text!("validate/hertz_pair");
const HERTZ_RADIUS: f64 = 0.1;
/// Closing speed [m/s], as in the scene.
const HERTZ_SPEED: f64 = 0.1251;
/// Largest approach of the centre to the plane [m]: half m v^2 is the integral of 4/3 sqrt(R) E* d^(3/2).
const HERTZ_APPROACH: f64 = 0.05 * HERTZ_RADIUS;
/// Contact time over `HERTZ_APPROACH / HERTZ_SPEED`: twice the integral of `1 / sqrt(1 - s^(5/2))` from 0 to 1.
const HERTZ_DURATION: f64 = 2.9432;
/// The part of it between the moments at which the speed is 1 % off that of flight: the approach then is
/// `(1 - 0.99^2)^(2/5)` of the largest one.
const HERTZ_BETWEEN: f64 = 2.5248;
/// Contact time and largest approach over Hertz's at this speed, by finite elements (`docs/derivations/ball_impact.py`): his
/// theory leaves out waves and that strains are finite.
const ELEMENTS: [f64; 2] = [0.9480, 0.9449];

/// Why a coarse ball comes too near, and its approach is of less than first order.
const SOFT_PENALTY: &str = "the penalty is soft where pressure is greatest: it gives way by a part of a cell there, which has to be small beside what the ball does";

/// Contact time and largest approach of the first object, over Hertz's.
fn hertz_contact(outcome: &Outcome) -> anyhow::Result<[f64; 2]> {
    let speeds = outcome.series("/objects/0/linear_velocity/1");
    let heights = outcome.series("/objects/0/com/1");
    let away = speeds.last().context("no frame")?.1;
    let begin = passes(&speeds, -0.99 * HERTZ_SPEED).context("the ball never slows")?;
    let end = passes(&speeds, 0.99 * away).context("the ball never parts")?;
    let lowest = heights
        .iter()
        .fold(f64::INFINITY, |low, (_, y)| low.min(*y));
    let time = (end - begin) * HERTZ_DURATION / HERTZ_BETWEEN;
    Ok([
        time / (HERTZ_DURATION * HERTZ_APPROACH / HERTZ_SPEED),
        (HERTZ_RADIUS - lowest) / HERTZ_APPROACH,
    ])
}

/// 22: Hertz's impact: an elastic ball on a rigid plane, and two of them.
pub fn hertz(size: Size) -> Vec<Case> {
    // A run with so many cells along the radius, a cell and a half away from contact.
    let at = |scene: &SceneText, cells: u32| {
        let dx = HERTZ_RADIUS / f64::from(cells);
        let time = HERTZ_DURATION * HERTZ_APPROACH / HERTZ_SPEED;
        let away = HERTZ_RADIUS + 1.5 * dx;
        let trial = Trial::new(scene, 1.5 * dx / HERTZ_SPEED + 1.5 * time)
            .set("dx", dx)
            .set("objects.0.translation", format!("[0, {away}, 0]"));
        match scene.path == PAIR.path {
            true => trial.set("objects.1.translation", format!("[0, {}, 0]", -away)),
            false => trial,
        }
    };
    let all: &[u32] = size.pick(&[8, 12], &[8, 12, 20]);
    let runs = all.iter().map(|&cells| ("plane", &PLANE, cells));
    let pair = size.pick(None, Some(("two balls", &PAIR, 12)));
    let quantities = [
        ("contact time over Hertz's", 0.1),
        ("largest approach over Hertz's", 0.05),
    ];
    let mut cases = Vec::new();
    for (what, scene, cells) in runs.chain(pair) {
        let dx = HERTZ_RADIUS / f64::from(cells);
        // Cells along the radius of the largest contact.
        let across = (HERTZ_RADIUS * HERTZ_APPROACH).sqrt() / dx;
        for (n, (quantity, gate)) in quantities.into_iter().enumerate() {
            cases.push(
                Case::new(
                    quantity,
                    format!("{what}, a/dx = {across:.1}: {quantity}"),
                    &at(scene, cells),
                    move |run| Ok(hertz_contact(run)?[n]),
                )
                .against(ELEMENTS[n], "finite elements")
                .within(Gate::Relative(gate))
                .fails((n == 1 && cells < 12).then_some(SOFT_PENALTY)),
            );
        }
    }
    for (n, quantity) in ["contact time", "largest approach"].into_iter().enumerate() {
        let ends = [all[0], all[all.len() - 1]];
        cases.push(
            Case::order(
                "order of the errors of time and approach",
                format!("order of the error of the {quantity}, first to last"),
                ends.map(|cells| (HERTZ_RADIUS / f64::from(cells), at(&PLANE, cells))),
                move |run| Ok((hertz_contact(run)?[n] - ELEMENTS[n]).abs()),
            )
            .against(1.0, "at least as contact at the nearest particle")
            .within(Gate::AtLeast(0.9))
            .fails((n == 1).then_some(SOFT_PENALTY)),
        );
    }
    cases
}

const OBLIQUE: SceneText = scene_text!("validate/oblique");
const OBLIQUE_RADIUS: f64 = 0.1;
/// Speed along and across the line between the balls as they touch, of each [m/s].
const OBLIQUE_SPEED: [f64; 2] = [0.2, 0.3];
/// Distance between the balls at the start, half of it [m].
const AWAY: f64 = 0.005;
/// How long it takes them to meet and part [s].
const OBLIQUE_TIME: f64 = 0.08;
/// Turn about z [degrees].
const TURNED: f64 = 23.0;
/// What the spin may be off by, over what presses: normals that lean by half a degree.
const LEAN_GATE: f64 = 0.01;

const LEANS: &str = "normals between deformable objects lean towards the nearest axis by up to a degree; with twice the cells by less than half of that";

/// A run with a coefficient of friction, turned by some degrees.
fn oblique_trial(cells: f64, friction: f64, turned: f64) -> Trial {
    let (sin, cos) = turned.to_radians().sin_cos();
    let turn = |x: f64, y: f64, sign: f64| {
        let [x, y] = [cos * x - sin * y, sin * x + cos * y].map(|c| sign * c);
        format!("[{x}, {y}, 0]")
    };
    let across = AWAY * OBLIQUE_SPEED[1] / OBLIQUE_SPEED[0];
    let mut trial = Trial::new(&OBLIQUE, OBLIQUE_TIME).set("dx", 2.0 * OBLIQUE_RADIUS / cells);
    for (n, sign) in [1.0, -1.0].into_iter().enumerate() {
        let place = turn(-OBLIQUE_RADIUS - AWAY, -across, sign);
        trial = trial
            .set(&format!("objects.{n}.translation"), place)
            .set(
                &format!("objects.{n}.linear_velocity"),
                turn(OBLIQUE_SPEED[0], OBLIQUE_SPEED[1], sign),
            )
            .set(&format!("objects.{n}.friction"), friction);
    }
    trial
}

/// Angular momentum of the first ball about its middle over its radius and what it gave to the other, without its sign.
fn spin_over_impulse(outcome: &Outcome) -> anyhow::Result<f64> {
    let last = |what: &str| outcome.last(&format!("/objects/0/{what}"));
    let mut given = 0.0;
    for a in 0..2 {
        let start = first(&outcome.series(&format!("/objects/0/linear_velocity/{a}")));
        given += (last(&format!("linear_velocity/{a}"))? - start).powi(2);
    }
    Ok(0.4 * OBLIQUE_RADIUS * last("angular_velocity/2")?.abs() / given.sqrt())
}

/// 24: oblique impact of two balls that slip on each other, along the axes of the grid and turned against them.
pub fn oblique(size: Size) -> Vec<Case> {
    let all: &[f64] = size.pick(&[12.0], &[12.0, 24.0]);
    let mut cases = Vec::new();
    for &cells in all {
        for (turn, place, claim) in [
            (
                0.0,
                "along the axes",
                "friction over normal impulse, along the axes",
            ),
            (
                TURNED,
                "turned by 23 degrees",
                "friction over normal impulse, turned by 23 degrees",
            ),
        ] {
            for friction in [0.0_f64, 0.1] {
                cases.push(
                    Case::new(
                        claim,
                        format!("{cells} cells across, {place}, mu {friction}: friction over pressure"),
                        &oblique_trial(cells, friction, turn),
                        spin_over_impulse,
                    )
                    // What was given has a part along the surface as well.
                    .against(friction / friction.hypot(1.0), "Coulomb")
                    .within(Gate::Absolute(LEAN_GATE))
                    .fails((cells < 24.0 && (turn > 0.0 || friction > 0.0)).then_some(LEANS)),
                );
            }
        }
    }
    cases
}
