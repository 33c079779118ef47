//! Filling: hollow shells of known solids, and a real capture.

use cosplat_scene::{
    assets::Gaussians,
    fill::{FillOptions, Filled, fill},
};
use glam::{Quat, Vec3};

use crate::{data, read};

fn options(dx: f64) -> FillOptions {
    FillOptions {
        dx,
        particles_per_cell: 8.0,
        seed: 1,
        closed_below: true,
    }
}

fn volume(filled: &Filled) -> f64 {
    filled.volume.iter().sum()
}

fn assert_near(what: &str, actual: f64, expected: f64, relative: f64) {
    let off = actual / expected - 1.0;
    assert!(
        off.abs() <= relative,
        "{what}: {actual} is {:.2} % off {expected}",
        100.0 * off
    );
}

/// Inertia about the axes through the origin, without the cells' own.
fn second_moments(filled: &Filled) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (p, v) in filled.position.iter().zip(&filled.volume) {
        for a in 0..3 {
            sum[a] += v * p[a] * p[a];
        }
    }
    [sum[1] + sum[2], sum[2] + sum[0], sum[0] + sum[1]]
}

/// Volume by the divergence theorem, `1/3 sum a n . x`. These shells are even samples of a mesh, and the third
/// local axis of each Gaussian is the mesh's outward normal; the spread of the discs is 0.9 of the root of the
/// area of each (exact to 1e-7 on the cube, whose area is 6).
fn divergence_volume(g: &Gaussians) -> f64 {
    let flux = |i: usize| {
        let normal = Quat::from_array(g.rotation[i]) * Vec3::Z;
        let area = f64::from(g.scale[i][0] / 0.9).powi(2);
        area * f64::from(normal.dot(Vec3::from_array(g.position[i]))) / 3.0
    };
    (0..g.len()).map(flux).sum()
}

#[test]
fn cube_shell_becomes_a_solid_cube() {
    let Some(path) = data("cube_shell_becomes_a_solid_cube", "cube_10k.splat") else {
        return;
    };
    let cube = read(&path);
    for dx in [1.0 / 8.0, 1.0 / 13.0, 1.0 / 20.0] {
        let filled = fill(&cube, &options(dx));
        assert_near("volume", volume(&filled), 1.0, 0.03);
        for inertia in second_moments(&filled) {
            assert_near("inertia", inertia + dx * dx / 24.0, 1.0 / 6.0, 0.03);
        }
    }
}

#[test]
fn cylinder_shell_becomes_a_solid_cylinder() {
    let Some(path) = data(
        "cylinder_shell_becomes_a_solid_cylinder",
        "cylinder_10k.splat",
    ) else {
        return;
    };
    let cylinder = read(&path);
    let exact = std::f64::consts::PI * 0.05 * 0.05;
    assert_near(
        "the oracle used for spot",
        divergence_volume(&cylinder),
        exact,
        0.02,
    );
    // Down to two cells across.
    for dx in [0.05, 0.03, 0.02] {
        assert_near(
            "volume",
            volume(&fill(&cylinder, &options(dx))),
            exact,
            0.03,
        );
    }
}

#[test]
fn spot_becomes_a_solid_cow() {
    let Some(path) = data("spot_becomes_a_solid_cow", "spot_10k.splat") else {
        return;
    };
    let spot = read(&path);
    // 0.1428, with a standard error of 0.7 % from the 10,000 samples.
    let expected = divergence_volume(&spot);
    for dx in [0.06, 0.04, 0.025] {
        assert_near("volume", volume(&fill(&spot, &options(dx))), expected, 0.03);
    }
}

/// A houseplant in a pot: translucent, full of holes, leaves thinner than any cell, underside never seen.
#[test]
fn a_real_capture_is_filled_sanely() {
    let Some(path) = data("a_real_capture_is_filled_sanely", "plant.splat") else {
        return;
    };
    let mut plant = read(&path);
    // The file has -y up: half a turn about x.
    for i in 0..plant.len() {
        let ([x, y, z], [a, b, c, w]) = (plant.position[i], plant.rotation[i]);
        plant.position[i] = [x, -y, -z];
        plant.rotation[i] = [w, -c, b, -a];
    }
    let dx = 1.0 / 32.0;
    let filled = fill(&plant, &options(dx));
    let report = filled.report;
    assert!(
        report.thin_particles > 300,
        "leaves have particles: {report:?}"
    );
    // The pot is a frustum of cone with radii 0.14 and 0.17 and height 0.3, with soil up to a fifth below the
    // rim (read off a picture): 0.018 to 0.023.
    assert!((0.014..0.026).contains(&report.solid_volume), "{report:?}");
    let near = |p: &[f64; 3], x: &[f32; 3], reach: f64| {
        (0..3).all(|a| (p[a] - f64::from(x[a])).abs() < reach)
    };
    // Nothing outside: a particle has a Gaussian near it, or lies within the pot.
    for p in &filled.position {
        let in_pot = p[1] < -0.15 && p[0].hypot(p[2]) < 0.2;
        let touched = || {
            (0..plant.len()).any(|i| {
                near(
                    p,
                    &plant.position[i],
                    dx + 2.0
                        * f64::from(
                            plant.scale[i][0]
                                .max(plant.scale[i][1])
                                .max(plant.scale[i][2]),
                        ),
                )
            })
        };
        assert!(in_pot || touched(), "{p:?} is out in the air");
    }
    // Nothing opaque is left behind: of the well visible Gaussians, nearly all have a particle within a cell
    // and a half. The rest are single specks, too faint to add up to a surface.
    let opaque = (0..plant.len())
        .filter(|&i| plant.opacity[i] > 0.5)
        .collect::<Vec<_>>();
    let lost = opaque
        .iter()
        .filter(|&&i| {
            !filled
                .position
                .iter()
                .any(|p| near(p, &plant.position[i], 1.5 * dx))
        })
        .count();
    assert!(
        lost * 200 < opaque.len(),
        "{lost} of {} opaque Gaussians are left behind",
        opaque.len()
    );
}
