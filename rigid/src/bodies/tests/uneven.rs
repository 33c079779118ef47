//! Balls that are not even: heavy on one side, hollow, or not quite round.

use super::{
    super::{body::Inertia, shape::Form},
    *,
};

const RADIUS: f64 = 0.3;
const G: f64 = 9.81;

/// A ball of sand and lead. With its middle `d` above the centre of mass it swings like a pendulum of inertia
/// `I + m (R - d)^2` and stiffness `m g d`.
#[test]
fn a_ball_that_is_heavy_below_swings_like_a_pendulum() {
    let mut heavy = ball([0.0; 3], RADIUS, 0.03);
    for g in heavy.iter_mut().filter(|g| g.x[2] < 0.0) {
        g.mass *= 4.0;
    }
    let mut stage = Stage::new([0.0, 0.0, -G]);
    stage.plane([0.0, 0.0, 1.0], 0.5, 0.0);
    let id = stage.add(&heavy);
    let (shape, d) = (&stage.shapes[id], -stage.bodies[id].com[2]);
    let Inertia { mass, moments } = shape.inertia;
    let radius = shape.radius - d;
    stage.bodies[id].com[2] = radius - d;
    let about = moments[0] + mass * (radius - d).powi(2);
    let period = 2.0 * std::f64::consts::PI * (about / (mass * G * d)).sqrt();
    // A hundredth of a radian: a sine within 1e-5.
    let spin = 0.01 * 2.0 * std::f64::consts::PI / period;
    stage.bodies[id].set_spin(&shape.inertia, [0.0, spin, 0.0]);
    stage.bodies[id].velocity[0] = spin * (radius - d);
    let swing = |stage: &Stage| stage.bodies[id].spin(&stage.shapes[id].inertia)[1];
    let mut crossings = vec![];
    while stage.time < 3.0 * period {
        let before = (stage.time, swing(&stage));
        stage.step(1.0 / 240.0);
        let after = (stage.time, swing(&stage));
        if before.1 * after.1 < 0.0 {
            let part = before.1 / (before.1 - after.1);
            crossings.push(before.0 + part * (after.0 - before.0));
        }
    }
    let measured = (crossings[4] - crossings[0]) / 2.0;
    // First order in the step, 1/240 s of a period of about a second.
    assert!(
        (measured / period - 1.0).abs() < 0.005,
        "{measured} s in place of {period} s"
    );
}

#[test]
fn what_is_oval_flat_or_open_is_no_ball() {
    let h = 0.03;
    let kept: [(&str, &dyn Fn(Vec3) -> bool); 4] = [
        ("an egg", &|r| {
            (r[0] / 1.06).hypot(r[1]).hypot(r[2]) < RADIUS
        }),
        ("a ball cut flat", &|r| {
            length(r) < RADIUS && r[2] < 0.8 * RADIUS
        }),
        ("a bowl", &|r| {
            length(r) < RADIUS && length(r) > 0.7 * RADIUS && r[2] < 0.0
        }),
        ("a ball with a nose", &|r| {
            length(r) < RADIUS || r[0].hypot(r[1]) < 0.1 && r[2] > 0.0 && r[2] < 1.2 * RADIUS
        }),
    ];
    for (name, keep) in kept {
        let (shape, _) = formed(&carved([0.0; 3], h, [26; 3], keep)).expect("has mass");
        assert!(matches!(shape.form, Form::Field(_)), "{name}");
    }
}

/// A small ball, a block and a drum in a hollow ball fall to its bottom and stay there.
#[test]
fn what_is_in_a_hollow_ball_stays_in_it() {
    let h = 0.03;
    let hollow = carved([0.0; 3], h, [22; 3], |r| {
        (0.24..RADIUS).contains(&length(r))
    });
    let inside = [
        ("ball", ball([0.0; 3], 0.09, h)),
        ("block", block([0.0; 3], h, [4, 4, 4])),
        ("drum", drum([0.0; 3], 0.09, 0.06, h)),
    ];
    for (name, grains) in inside {
        let mut stage = Stage::new([0.0, 0.0, -G]);
        stage.surface = (0.0, 0.5);
        stage.plane([0.0, 0.0, 1.0], 0.5, 0.0);
        let shell = stage.add(&hollow);
        let Form::Ball(ball) = stage.shapes[shell].form else {
            panic!("a hollow ball");
        };
        let cavity = ball.cavity.expect("it is hollow").radius;
        assert!((cavity / 0.24 - 1.0).abs() < 0.03, "{cavity}");
        stage.bodies[shell].com[2] = ball.outer.radius;
        let id = stage.add(&grains);
        stage.bodies[id].com[2] = ball.outer.radius;
        for _ in 0..180 {
            stage.step(1.0 / 60.0);
        }
        let (around, body) = (stage.bodies[shell], stage.bodies[id]);
        let off = length(sub(body.com, around.com));
        assert!(
            off < cavity && body.com[2] < around.com[2] - 0.4 * cavity,
            "{name}: {:?} in {:?}",
            body.com,
            around.com
        );
        // What it fell with is gone; a ball may roll to and fro.
        let rest = 0.01 * G * cavity;
        let motion = dot(body.velocity, body.velocity);
        assert!(motion < rest, "{name}: {:?}", body.velocity);
    }
}
