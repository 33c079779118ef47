//! Surfaces and moments of what particles stand for.

use super::{super::body::Inertia, *};
use crate::rotation::{from_rotation_vector, rotate};

#[test]
fn a_block_has_flat_faces_where_its_particles_cubes_end() {
    let h = 0.05;
    let turn = from_rotation_vector([0.3, -0.5, 0.2]);
    for turned in [false, true] {
        let mut grains = block([1.0, 2.0, 3.0], h, [8, 6, 4]);
        if turned {
            for g in &mut grains {
                g.x = rotate(turn, g.x);
            }
        }
        let (shape, body) = formed(&grains).expect("has mass");
        let size = [8.0 * h, 6.0 * h, 4.0 * h];
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut x = [0.013, 0.021, -0.017];
                x[axis] = sign * 0.5 * size[axis];
                let mut outward = [0.0; 3];
                outward[axis] = sign;
                let (x, outward) = match turned {
                    true => (rotate(turn, add([1.0, 2.0, 3.0], x)), rotate(turn, outward)),
                    false => (add([1.0, 2.0, 3.0], x), outward),
                };
                // The frame follows the axes of inertia: the faces are flat to round-off, turned or not.
                let found = shape.distance(body.inverse_point(x));
                assert!(found.abs() < 1e-9, "{found:e}");
                let normal = rotate(body.rotation, shape.normal(body.inverse_point(x)));
                assert!(length(sub(normal, outward)) < 1e-9, "{normal:?}");
            }
        }
        // A solid cuboid.
        let mass = 1000.0 * size[0] * size[1] * size[2];
        let mut found = shape.inertia.moments;
        found.sort_by(f64::total_cmp);
        let moment = |a: usize, b: usize| mass * (size[a].powi(2) + size[b].powi(2)) / 12.0;
        for (found, expected) in found.iter().zip([moment(1, 2), moment(0, 2), moment(0, 1)]) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }
}

/// Within a tenth of their spacing.
#[test]
fn a_ball_of_particles_is_a_ball() {
    for (radius, h) in [(0.3, 0.05), (0.5, 0.05), (1.0, 0.05), (0.47, 0.033)] {
        let (shape, body) = formed(&ball([0.3, 0.1, 0.2], radius, h)).expect("has mass");
        let mut dice = Dice(1);
        for _ in 0..200 {
            let n = dice.vector();
            let n = scaled(n, 1.0 / length(n));
            let found = shape.distance(body.inverse_point(along([0.3, 0.1, 0.2], radius, n)));
            assert!(found.abs() < 0.1 * h, "{found} with spacing {h}");
            let normal = rotate(body.rotation, shape.normal(scaled(n, radius)));
            assert!(length(sub(normal, rotate(body.rotation, n))) < 1e-12);
        }
    }
}

/// Within half a spacing.
#[test]
fn other_shapes_are_no_balls_and_keep_their_surface() {
    let h = 0.05;
    // A tube.
    let (radius, hole, half) = (0.3, 0.15, 0.3);
    let grains = carved([0.0; 3], h, [14; 3], |r| {
        let out = r[0].hypot(r[1]);
        hole < out && out < radius && r[2].abs() < half
    });
    let (shape, body) = formed(&grains).expect("has mass");
    for n in 0..50 {
        let (s, c) = (0.7 + 0.37 * f64::from(n)).sin_cos();
        for (out, what) in [(radius, "side"), (hole, "hole")] {
            let x = [out * c, out * s, 0.02 * f64::from(n % 7) - 0.06];
            let found = shape.distance(body.inverse_point(x));
            assert!(found.abs() < 0.5 * h, "{found} at the {what}");
        }
        let middle = 0.5 * (radius + hole);
        let found = shape.distance(body.inverse_point([middle * c, middle * s, half]));
        assert!(found.abs() < 0.1 * h, "{found} on the lid");
    }
    // A thin plate and a single particle have a surface as well.
    for cells in [[6, 6, 1], [1, 1, 1]] {
        let (shape, _) = formed(&block([0.0; 3], h, cells)).expect("has mass");
        assert!(
            shape.distance([0.0; 3]) < 0.0 && shape.radius > 0.2 * h,
            "{cells:?}"
        );
    }
    assert!(formed(&[]).is_none());
}

#[test]
fn particles_let_go_carry_the_angular_momentum_of_their_body() {
    // A cube, but for one heavy corner: axes as good as each other, with products of inertia between them.
    let mut grains = block([0.0; 3], 0.05, [6, 6, 6]);
    grains[0].mass *= 1.2;
    let body = frame(&grains, [0.0, 0.0, 0.0, 1.0]).expect("has mass");
    for g in &mut grains {
        g.x = body.inverse_point(g.x);
    }
    let momentum = [0.3, -1.0, 2.0];
    let own = 2e-3;
    let spin = Shape::spin(&grains, own, momentum);
    let mut carried = [0.0; 3];
    for g in &grains {
        let orbit = cross(g.x, cross(spin, g.x));
        carried = add(carried, along(scaled(orbit, g.mass), own * g.mass, spin));
    }
    // Round-off of a sum over 216 particles.
    assert!(length(sub(carried, momentum)) < 1e-13, "{carried:?}");
    let Inertia { moments, .. } = Shape::inertia(&grains, own);
    let diagonal = [0, 1, 2].map(|a| momentum[a] / moments[a]);
    assert!(
        length(sub(diagonal, spin)) > 1e-4 * length(spin),
        "the corner counts"
    );
}
