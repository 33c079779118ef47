//! Cylinders: recognised, rolling, standing, tumbling over their rims, on each other.

use super::{super::body::Inertia, *};
use crate::rotation::{from_rotation_vector, product, rotate};

const G: f64 = 9.81;

/// Turned about x so that its axis is level, along y, and `extra` about z and y after that [rad].
fn laid(body: &mut Body, extra: Vec3) {
    let down = from_rotation_vector([0.5 * std::f64::consts::PI, 0.0, 0.0]);
    body.rotation = product(product(from_rotation_vector(extra), down), body.rotation);
}

/// World direction of what was z at first.
fn axis(stage: &Stage, id: usize) -> Vec3 {
    rotate(stage.bodies[id].rotation, [0.0, 0.0, 1.0])
}

#[test]
fn a_drum_of_particles_is_a_cylinder_whatever_its_attitude() {
    let mut dice = Dice(5);
    // Flat, long, and sqrt(3) times as long as its radius: all moments alike.
    for (radius, half, h) in [
        (0.5, 0.1, 0.05),
        (0.2, 0.5, 0.05),
        (0.46, 0.4, 0.05),
        (0.5, 0.433, 0.0241),
    ] {
        for turned in [false, true] {
            let mut grains = drum([0.0; 3], radius, half, h);
            let q = match turned {
                true => from_rotation_vector(scaled(dice.vector(), 2.0)),
                false => [0.0, 0.0, 0.0, 1.0],
            };
            for g in &mut grains {
                g.x = add(rotate(q, g.x), [1.0, 2.0, 3.0]);
            }
            let (shape, body) = formed(&grains).expect("has mass");
            let at = |x: Vec3| body.inverse_point(add(rotate(q, x), [1.0, 2.0, 3.0]));
            // As many layers as its length has spacings.
            let half = h * (half / h).round();
            for n in 0..100 {
                let (s, c) = (0.7 + 0.37 * f64::from(n)).sin_cos();
                let outward = [c, s, 0.0];
                let side = along([0.0, 0.0, 0.8 * half * dice.roll()], radius, outward);
                let found = shape.distance(at(side));
                // The volume of a lattice.
                assert!(
                    found.abs() < 0.2 * h,
                    "{found} at the side of {radius} {half}"
                );
                let normal = rotate(body.rotation, shape.normal(at(side)));
                let error = length(sub(normal, rotate(q, outward)));
                // The axis by moments is that to round-off, by fourth moments to its root: they are least there.
                assert!(error < 1e-6, "{error:e} of {radius} {half}, {turned}");
                let lid = [0.8 * radius * c, 0.8 * radius * s, half];
                let found = shape.distance(at(lid));
                assert!(found.abs() < 1e-6, "{found:e} on the lid");
            }
        }
    }
}

/// Laid down or dropped.
#[test]
fn a_rigid_disk_on_an_incline_rolls_or_slips() {
    let angle = 45.0_f64.to_radians();
    for friction in [0.1, 0.2, 0.5, 0.7] {
        for drop in [0.0, 1.1 * DX] {
            let mut stage = Stage::new([G * angle.sin(), 0.0, -G * angle.cos()]);
            stage.plane([0.0, 0.0, 1.0], friction, 0.0);
            let id = stage.add(&drum([0.0; 3], 0.5, 0.1, 0.05));
            laid(&mut stage.bodies[id], [0.0; 3]);
            let shape = &stage.shapes[id];
            let r = (shape.radius.powi(2) - 0.01).sqrt();
            let Inertia { mass, moments } = shape.inertia;
            let moment = moments.into_iter().fold(0.0, f64::max);
            let k = moment / (mass * r * r);
            // A solid disk, but for the lattice.
            assert!((k / 0.5 - 1.0).abs() < 0.01, "{k}");
            stage.bodies[id].com = [0.0, 0.0, r + drop];
            let steps = 240;
            for _ in 0..steps {
                stage.step(1.0 / 240.0);
            }
            let t = stage.time;
            let body = &stage.bodies[id];
            let (normal, down) = (G * angle.cos(), G * angle.sin());
            let fall = (2.0 * drop / normal).sqrt();
            let spin = body.spin(&stage.shapes[id].inertia);
            let what = format!("mu {friction}, dropped by {drop}: {body:?}, {spin:?}");
            if friction >= angle.tan() * k / (1.0 + k) {
                // At touch-down it keeps its angular momentum about the place of contact.
                let speed = down * t / (1.0 + k);
                let rolled = t - fall;
                let way = 0.5 * down * fall * fall
                    + down / (1.0 + k) * (fall * rolled + 0.5 * rolled * rolled);
                // Landing, friction has to stop what slips: it may take longer than the impact. Contact of the solver is soft.
                let exact = if drop == 0.0 { 1e-3 } else { 0.01 };
                assert!((body.com[0] / way - 1.0).abs() < exact, "{way}, {what}");
                assert!((body.velocity[0] / speed - 1.0).abs() < exact, "{what}");
                assert!(
                    (spin[1] * r / body.velocity[0] - 1.0).abs() < 1e-3,
                    "{what}"
                );
            } else {
                let way = 0.5 * down * t * t - friction * (0.5 * normal * t * t - drop);
                let turn = friction * normal * t / (k * r);
                assert!((body.com[0] / way - 1.0).abs() < 1e-3, "{way}, {what}");
                assert!((spin[1] / turn - 1.0).abs() < 1e-3, "{turn}, {what}");
            }
            // Level, straight on, on the plane.
            assert!((axis(&stage, id)[1].abs() - 1.0).abs() < 1e-9, "{what}");
            assert!(body.com[1].abs() < 1e-4, "{what}");
            assert!((body.com[2] - r).abs() < 2e-3 * DX + 1e-9, "{what}");
        }
    }
}

#[test]
fn drums_stand_on_their_faces_and_on_each_other() {
    let mut stage = Stage::new([0.0, 0.0, -G]);
    stage.plane([0.0, 0.0, 1.0], 0.5, 0.3);
    stage.surface = (0.3, 0.5);
    for n in 0..3 {
        let z = 0.2 + 0.4 * f64::from(n) + 1e-3 * f64::from(n + 1);
        stage.add(&drum([0.02 * f64::from(n), 0.0, z], 0.3, 0.2, 0.05));
    }
    for _ in 0..120 {
        stage.step(1.0 / 60.0);
    }
    let start = stage.bodies.clone();
    for _ in 0..300 {
        stage.step(1.0 / 60.0);
    }
    for (id, (body, start)) in stage.bodies.iter().zip(&start).enumerate() {
        let z = 0.2 + 0.4 * id as f64;
        // What bodies that touch may overlap by, on every face below.
        assert!(
            (body.com[2] - z).abs() < 3e-3 * DX * (id + 1) as f64,
            "{body:?}"
        );
        // It trembles by some micrometres.
        assert!(length(sub(body.com, start.com)) < 1e-3 * DX, "{body:?}");
        assert!(length(body.velocity) < 2e-3, "{body:?}");
    }
}

#[test]
fn a_drum_bounces_off_its_side_and_off_its_face() {
    for on_side in [true, false] {
        for e in [0.5, 0.9] {
            let mut stage = Stage::new([0.0, 0.0, -G]);
            stage.plane([0.0, 0.0, 1.0], 0.4, e);
            let id = stage.add(&drum([0.0; 3], 0.3, 0.2, 0.05));
            let mut r = 0.2;
            if on_side {
                laid(&mut stage.bodies[id], [0.0, 0.0, 0.3]);
                r = (stage.shapes[id].radius.powi(2) - 0.04).sqrt();
            }
            let drop = 0.5;
            stage.bodies[id].com = [0.0, 0.0, r + drop];
            while stage.time < (2.0 * drop / G).sqrt() {
                stage.step(1.0 / 60.0);
            }
            let body = &stage.bodies[id];
            let height = body.com[2] - r + body.velocity[2].powi(2) / (2.0 * G);
            assert!(
                (height / (e * e * drop) - 1.0).abs() < 1e-6,
                "{height}, on its side {on_side}, {e}"
            );
            // Two points share the impulse to 1e-11.
            let size = stage.shapes[id].inertia.mass * length(body.velocity) * r;
            assert!(length(body.angular_momentum) < 1e-8 * size, "{body:?}");
        }
    }
}

/// And comes to rest.
#[test]
fn a_drum_on_its_rim_falls_to_the_side_of_its_centre_of_mass() {
    let (radius, half) = (0.3_f64, 0.2);
    // Over the rim when it leans by this.
    let balance = (radius / half).atan();
    for (lean, falls) in [(0.8 * balance, false), (1.2 * balance, true)] {
        let mut stage = Stage::new([0.0, 0.0, -G]);
        stage.plane([0.0, 0.0, 1.0], 0.8, 0.0);
        let id = stage.add(&drum([0.0; 3], radius, half, 0.05));
        let body = &mut stage.bodies[id];
        body.rotation = product(from_rotation_vector([0.0, lean, 0.0]), body.rotation);
        body.com = [0.0, 0.0, radius * lean.sin() + half * lean.cos() + 1e-3];
        let mut energy = stage.energy();
        for _ in 0..600 {
            stage.step(1.0 / 60.0);
            let now = stage.energy();
            // Positions are corrected out of overlaps of up to 0.002 cells.
            let slack = 4e-3 * DX * G * stage.shapes[id].inertia.mass;
            assert!(now < energy + slack, "{energy} became {now}");
            energy = energy.min(now);
        }
        let up = axis(&stage, id)[2].abs();
        let expected = if falls { 0.0 } else { 1.0 };
        assert!((up - expected).abs() < 1e-3, "{up}, leaned by {lean}");
        let body = &stage.bodies[id];
        assert!(body.velocity[2].abs() < 1e-6, "{body:?}");
        if !falls {
            assert!(length(body.velocity) < 1e-6, "{body:?}");
        }
    }
}

#[test]
fn a_drum_lies_on_a_narrow_block_and_across_another_drum() {
    // A block a quarter as long as the drum, and a drum that lies the other way, held.
    let beam = block([0.0, 0.0, -0.1], 0.05, [8, 2, 4]);
    let mut other = drum([0.0; 3], 0.3, 0.2, 0.05);
    for g in &mut other {
        // Along x.
        g.x = [g.x[2], g.x[0], g.x[1] - 0.3];
    }
    for (below, is_level) in [(beam, true), (other, false)] {
        let mut stage = Stage::new([0.0, 0.0, -G]);
        stage.surface = (0.0, 0.5);
        let held = stage.add(&below);
        stage.drives[held] = Drive::Kinematic {
            velocity: [0.0; 3],
            spin: [0.0; 3],
        };
        let id = stage.add(&drum([0.0; 3], 0.25, 0.4, 0.05));
        laid(&mut stage.bodies[id], [0.0; 3]);
        let r = (stage.shapes[id].radius.powi(2) - 0.16).sqrt();
        stage.bodies[id].com = [0.0, 0.003, r + 1e-3];
        for _ in 0..120 {
            stage.step(1.0 / 60.0);
        }
        let body = &stage.bodies[id];
        if is_level {
            // On two points at the edges of the beam.
            assert!(length(body.velocity) < 1e-4, "{body:?}");
            assert!((body.com[2] - r).abs() < 3e-3 * DX, "{body:?}");
            assert!(axis(&stage, id)[2].abs() < 1e-3, "{body:?}");
        } else {
            // A see-saw on one point, which rolls along it, slowly as its lever is short.
            let top = (stage.shapes[held].radius.powi(2) - 0.04).sqrt() - 0.3;
            assert!((body.com[2] - r - top).abs() < 0.03, "{body:?}");
        }
    }
}
