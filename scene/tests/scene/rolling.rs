//! Balls and disks of deformable matter roll and slip on planes.

use cosplat_sim_core::{
    StepReport,
    mat3::{cross, dot},
};

use crate::world;

const DX: f64 = 0.1;
/// Five cells.
const RADIUS: f64 = 0.5;
const SPEED: f64 = 0.5;
const G: f64 = 9.81;

/// What is said of a scene, given as a file, after a second.
fn after_a_second(text: &str) -> StepReport {
    let mut world = world(text);
    let mut report = world.report().clone();
    for _ in 0..60 {
        report = world.step(1.0 / 60.0, &[]);
    }
    report
}

/// Speed [m/s] along a plane after a second, of a ball that begins to roll on it with `speed`. The plane is turned about z by
/// `across` degrees against the grid and lies `offset` cells away from a node; it falls by `slope` degrees.
fn rolled(across: f64, offset: f64, slope: f64, speed: f64) -> f64 {
    let turned = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        ([sin, cos, 0.0], [cos, -sin, 0.0])
    };
    let (normal, along) = turned(across);
    let (up, _) = turned(across - slope);
    let times = |v: [f64; 3], s: f64| v.map(|v| v * s);
    let text = format!(
        "version = 1
dx = {DX}
gravity = {:?}
[[objects]]
name = \"ball\"
shape = {{ kind = \"sphere\", radius = {RADIUS} }}
translation = {:?}
linear_velocity = {:?}
angular_velocity = {:?}
material = {{ youngs_modulus_pa = 1e6, poisson_ratio = 0.3, density_kg_m3 = 1000 }}
[[colliders]]
name = \"plane\"
point = {:?}
normal = {normal:?}
friction = 0.5
",
        times(up, -G),
        times(normal, offset * DX),
        times(along, speed),
        times(cross(normal, along), speed / RADIUS),
        times(normal, offset * DX - RADIUS),
    );
    let report = after_a_second(&text);
    dot(report.objects[0].linear_velocity, along)
}

/// Measured: 0.63 to 0.97 on a plane along the axes, 0.79 to 0.81 at 10 degrees, 0.47 to 0.68 at 24. Of particles of one size on the
/// sites of their lattice that are inside, it was stopped by its facets, or rolled back: 0.26 to -0.56.
#[test]
fn a_ball_rolls_on_as_it_was_pushed() {
    for across in [0.0, 10.0, 24.0] {
        for offset in [0.0, 0.3, 0.5] {
            let kept = rolled(across, offset, 0.0, SPEED) / SPEED;
            assert!(
                kept > 0.4 && kept < 1.0,
                "{across} degrees, {offset} cells: {kept} of its speed"
            );
        }
    }
}

/// `5/7 g sin t`, however it is turned against the grid. Measured: 1.07, 0.95 and 0.83 of it on the gentle slope, 0.94, 0.89 and 0.86
/// on the steep one; on facets -0.12 to 0.05, and 0.75 to 0.85.
#[test]
fn a_ball_rolls_down_gentle_and_steep_slopes() {
    for slope in [2.0_f64, 24.0] {
        let expected = 5.0 / 7.0 * G * slope.to_radians().sin();
        for across in [0.0, 10.0, 24.0] {
            let speed = rolled(across, 0.3, slope, 0.0) / expected;
            assert!(
                (speed - 1.0).abs() < 0.2,
                "{slope} degrees, {across} degrees across: {speed} of its speed"
            );
        }
    }
}

/// A soft disk that lies on a rough floor, ten cells in radius and two wide, is thrown along it so fast that it slips for a
/// second. Returns what it has lost of its speed and what it has gained of spin, both over what Coulomb's law says of all that has
/// pressed it. Without jitter it does not fall on its side.
fn slipped(friction: f64) -> (f64, f64) {
    const R: f64 = 10.0 * DX;
    let text = format!(
        "version = 1
dx = {DX}
jitter = 0
gravity = [0, -{G}, 0]
[[objects]]
name = \"disk\"
shape = {{ kind = \"cylinder\", radius = {R}, height = {} }}
rotation_deg = [90, 0, 0]
translation = [0, {R}, 0]
linear_velocity = [8, 0, 0]
material = {{ youngs_modulus_pa = 1e7, poisson_ratio = 0.3, density_kg_m3 = 1000 }}
[[colliders]]
name = \"plane\"
normal = [0, 1, 0]
friction = {friction}
",
        2.0 * DX
    );
    let report = after_a_second(&text);
    let object = &report.objects[0];
    // It rings: what has pressed it is not just its weight.
    let taken = friction * (G + object.linear_velocity[1]);
    let lost = (8.0 - object.linear_velocity[0]) / taken;
    let gained = -object.angular_velocity[2] / (2.0 * taken / R);
    (lost, gained)
}

/// Measured: 0.9975 of the speed, as friction follows what presses with delay, and 0.96 of the spin, as that lies in front of the middle of a
/// disk that turns.
/// It loses speed and gains spin.
#[test]
fn a_slipping_soft_disk_turns_as_coulomb_says() {
    for friction in [0.1, 0.2] {
        let (lost, gained) = slipped(friction);
        assert!((lost - 1.0).abs() < 0.004, "{friction}: lost {lost}");
        assert!((gained - 1.0).abs() < 0.06, "{friction}: gained {gained}");
    }
}
