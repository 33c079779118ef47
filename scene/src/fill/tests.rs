//! Laws of filling on surfaces that are made here; real files are in the integration tests.

use super::*;
use crate::assets::{
    Paint,
    generate::{self, Style, VASE},
};

fn options(dx: f64) -> FillOptions {
    FillOptions {
        dx,
        particles_per_cell: 8.0,
        seed: 1,
        closed_below: true,
    }
}

fn style(spacing: f64) -> Style {
    Style {
        spacing,
        paint: Paint::Plain([0.5; 3]),
        seed: 1,
    }
}

fn volume(filled: &Filled) -> f64 {
    filled.volume.iter().sum()
}

fn removed(g: &Gaussians, gone: impl Fn([f32; 3]) -> bool) -> Gaussians {
    let mut out = Gaussians::default();
    for i in (0..g.len()).filter(|&i| !gone(g.position[i])) {
        out.position.push(g.position[i]);
        out.scale.push(g.scale[i]);
        out.rotation.push(g.rotation[i]);
        out.opacity.push(g.opacity[i]);
        out.sh.extend_from_slice(&g.sh[3 * i..3 * i + 3]);
    }
    out
}

const BALL: f64 = 4.0 / 3.0 * std::f64::consts::PI * 0.125;

fn ball() -> Gaussians {
    generate::surface_sphere(0.5, &style(0.02))
}

fn assert_near(what: &str, actual: f64, expected: f64, relative: f64) {
    let off = actual / expected - 1.0;
    assert!(
        off.abs() <= relative,
        "{what}: {actual} is {:.2} % off {expected}",
        100.0 * off
    );
}

// The gate of 3 % is the project's; what is reached here is better, and these tests hold it: 0.5 %, five times
// the error of a planar cut of voxels on this curvature.
#[test]
fn ball_has_its_volume_centre_and_inertia_at_every_resolution() {
    for dx in [0.25, 0.1, 0.05] {
        let filled = fill(&ball(), &options(dx));
        assert_near("volume", volume(&filled), BALL, 0.005);
        assert_eq!(filled.report.thin_particles, 0);
        let moment = |f: &dyn Fn([f64; 3]) -> f64| {
            let weighted = filled
                .position
                .iter()
                .zip(&filled.volume)
                .map(|(p, v)| v * f(*p));
            weighted.sum::<f64>()
        };
        for a in 0..3 {
            let mean = moment(&|p| p[a]) / BALL;
            assert!(mean.abs() < 2e-3 * dx / 0.05, "centre {mean} along {a}");
            // Point masses lack the inertia of their own cells, a^2/12 per axis with a = dx/2.
            let own = BALL * dx * dx / 48.0;
            assert_near("inertia", moment(&|p| p[a] * p[a]) + own, BALL * 0.05, 0.02);
        }
    }
}

#[test]
fn particles_have_the_wanted_density_and_stay_inside() {
    let dx = 0.05;
    let filled = fill(&ball(), &options(dx));
    let full = filled
        .volume
        .iter()
        .filter(|v| (**v * 8.0 / dx.powi(3) - 1.0).abs() < 0.01)
        .count();
    assert!(
        full > filled.volume.len() / 2,
        "most particles have an eighth of a cell"
    );
    assert!(
        filled
            .volume
            .iter()
            .all(|v| *v > 0.0 && *v < 2.0 * dx.powi(3) / 8.0)
    );
    let outermost = filled
        .position
        .iter()
        .map(|p| p[0].hypot(p[1]).hypot(p[2]))
        .fold(0.0, f64::max);
    // A sliver joined to its neighbour keeps its voxels' centres, which may lie half a voxel out.
    assert!(outermost < 0.5 + 0.5 * filled.report.voxel, "{outermost}");
    assert_eq!(filled, fill(&ball(), &options(dx)), "repeatable");
    let other = fill(
        &ball(),
        &FillOptions {
            seed: 2,
            ..options(dx)
        },
    );
    assert_ne!(filled.position, other.position);
    assert_eq!(filled.volume, other.volume);
}

#[test]
fn vase_wall_is_filled_and_its_cavity_is_not() {
    let profile = VASE.profile();
    let vase = generate::surface_of_revolution(&profile, &style(0.0035));
    let filled = fill(&vase, &options(VASE.wall / 3.0));
    assert_near(
        "wall",
        volume(&filled),
        generate::revolution_volume(&profile),
        0.03,
    );
    for p in &filled.position {
        // Inside the polygon of the profile, or within a quarter of a wall of it.
        let r = p[0].hypot(p[2]);
        let near = profile.windows(2).any(|w| {
            let ([r0, y0], [r1, y1]) = (w[0], w[1]);
            let (dr, dy) = (r1 - r0, y1 - y0);
            let t = (((r - r0) * dr + (p[1] - y0) * dy) / (dr * dr + dy * dy)).clamp(0.0, 1.0);
            (r - r0 - t * dr).hypot(p[1] - y0 - t * dy) <= 0.75 * VASE.wall
        });
        assert!(
            near,
            "a particle at r = {r}, y = {} is not in the wall",
            p[1]
        );
    }
    let coarse = fill(&vase, &options(VASE.wall));
    assert_near(
        "wall one cell thick",
        volume(&coarse),
        generate::revolution_volume(&profile),
        0.03,
    );
}

#[test]
fn small_holes_do_not_leak() {
    // Six holes 0.06 to 0.07 wide in a ball of diameter 1.
    let hole = |p: [f32; 3]| p.iter().map(|x| x.abs()).fold(0.0, f32::max) > 0.4989;
    let holey = removed(&ball(), hole);
    assert!(holey.len() < ball().len());
    for dx in [0.1, 0.05] {
        assert_near("volume", volume(&fill(&holey, &options(dx))), BALL, 0.03);
    }
}

#[test]
fn open_sheets_stay_open_and_get_particles_along_them() {
    let cup = generate::surface_of_revolution(&[[0.0, 0.0], [0.3, 0.0], [0.3, 0.8]], &style(0.015));
    let dx = 0.05;
    let filled = fill(&cup, &options(dx));
    // But for a fillet in the corner between bottom and wall, which the ball that closes holes cannot enter.
    let cavity = std::f64::consts::PI * 0.09 * 0.8;
    let held = filled.report.solid_volume / cavity;
    assert!(held < 0.01, "a cup of paper holds {held} of its cavity");
    assert!(filled.report.thin_particles > 500);
    for p in &filled.position {
        let r = p[0].hypot(p[2]);
        let off = if r < 0.29 {
            p[1].abs()
        } else {
            (r - 0.3).abs()
        };
        assert!(off < 0.5 * dx, "{p:?} is off the sheet");
    }
    // Every Gaussian has a particle within reach of the grid's kernel.
    for x in &cup.position {
        let near = |p: &[f64; 3]| (0..3).all(|a| (p[a] - f64::from(x[a])).abs() < dx);
        assert!(
            filled.position.iter().any(near),
            "nothing moves the Gaussian at {x:?}"
        );
    }
}

#[test]
fn a_hidden_underside_is_closed_on_request() {
    let bucket =
        generate::surface_of_revolution(&[[0.3, 0.0], [0.3, 0.6], [0.0, 0.6]], &style(0.015));
    let solid = std::f64::consts::PI * 0.09 * 0.6;
    assert_near("closed", volume(&fill(&bucket, &options(0.1))), solid, 0.06);
    let open = fill(
        &bucket,
        &FillOptions {
            closed_below: false,
            ..options(0.1)
        },
    );
    assert!(open.report.solid_volume < 0.01 * solid);
    // A vase upside down has a cavity that is open below only, yet it is no solid.
    let mut vase = generate::surface_of_revolution(&VASE.profile(), &style(0.0035));
    for i in 0..vase.len() {
        let ([x, y, z], [a, b, c, w]) = (vase.position[i], vase.rotation[i]);
        vase.position[i] = [x, -y, -z];
        vase.rotation[i] = [w, -c, b, -a];
    }
    let expected = generate::revolution_volume(&VASE.profile());
    assert_near(
        "upside down",
        volume(&fill(&vase, &options(0.006))),
        expected,
        0.03,
    );
}

#[test]
fn bad_giant_and_stray_gaussians_neither_hang_nor_spoil() {
    let mut g = ball();
    let clean = volume(&fill(&g, &options(0.1)));
    for (i, value) in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e30, 1e9, 0.0]
        .into_iter()
        .enumerate()
    {
        g.scale[100 * i] = [value; 3];
        g.rotation[100 * i + 1] = [value, 0.0, 0.0, if i == 5 { 0.0 } else { 1.0 }];
        g.position[100 * i + 2] = [value, 0.0, 0.0];
    }
    let filled = fill(&g, &options(0.1));
    let report = filled.report;
    assert_eq!(
        (report.skipped, report.outliers, report.limited),
        (10, 2, 2)
    );
    // Limited to 12 voxels, a giant is still an opaque blob on the surface.
    assert_near("volume", volume(&filled), clean, 0.05);
    assert!(filled.position.as_flattened().iter().all(|x| x.is_finite()));
    let nothing = removed(&g, |_| true);
    assert!(fill(&nothing, &options(0.1)).position.is_empty());
    let invisible = Gaussians {
        opacity: vec![0.0; g.len()],
        ..g
    };
    assert!(fill(&invisible, &options(0.1)).position.is_empty());
}

#[test]
fn cost_is_linear_in_voxels_and_gaussians() {
    for (spacing, giant) in [(0.04, 1.0), (0.02, 1.0), (0.01, 1.0), (0.02, 1e6)] {
        let mut g = generate::surface_sphere(0.5, &style(spacing));
        for s in g.scale.iter_mut().step_by(2) {
            *s = s.map(|s| s * giant);
        }
        let report = fill(&g, &options(4.0 * spacing)).report;
        // At most twice a sphere of the size limit, 3 x 12 voxels in radius, per Gaussian; 62 sweeps.
        let per_gaussian = if giant > 1.0 {
            4 * 36 * 36 * 36 * 5
        } else {
            4_000
        };
        let bound = 62 * report.voxels + per_gaussian * g.len();
        assert!(
            report.operations <= bound as u64,
            "{} > {bound}",
            report.operations
        );
        assert!(report.voxels <= 4_000_000);
    }
}

#[test]
fn one_particle_per_gaussian_shares_the_volume_of_its_cell() {
    let mut g = ball();
    g.position[7] = [f32::NAN, 0.0, 0.0];
    let filled = per_gaussian(&g, 0.1);
    assert_eq!(filled.position.len(), g.len() - 1);
    assert_eq!(filled.report.skipped, 1);
    // Every occupied cell is filled exactly once.
    let cells = filled
        .position
        .iter()
        .map(|p| p.map(|x| (x / 0.1).floor() as i64))
        .collect::<std::collections::BTreeSet<_>>();
    assert_near("volume", volume(&filled), cells.len() as f64 * 1e-3, 1e-9);
}

#[test]
fn whatever_comes_in_finite_particles_come_out() {
    use rand_core::{Rng, SeedableRng};
    let mut rng = rand_pcg::Pcg32::seed_from_u64(5);
    for round in 0..10 {
        // Numbers of every size, and a few that are none.
        let mut number = || {
            let magnitude = 10f32.powi((rng.next_u32() % (3 + round)) as i32 % 18 - 9);
            let sign = if rng.next_u32().is_multiple_of(2) {
                1.0
            } else {
                -1.0
            };
            match rng.next_u32() % 100 {
                0 => f32::NAN,
                1 => f32::INFINITY,
                _ => sign * magnitude * (rng.next_u32() as f32 / u32::MAX as f32),
            }
        };
        let n = 1 + 30 * round as usize;
        let mut g = Gaussians::default();
        for _ in 0..n {
            g.position.push([number(), number(), number()]);
            g.scale.push([number(), number(), number()].map(f32::abs));
            g.rotation.push([number(), number(), number(), number()]);
            g.opacity.push(number().abs());
            g.sh.extend([0.0; 3]);
        }
        let dx = f64::from(number().abs());
        let filled = fill(&g, &options(dx));
        assert!(filled.position.as_flattened().iter().all(|x| x.is_finite()));
        assert!(filled.volume.iter().all(|v| v.is_finite() && *v > 0.0));
        assert!(filled.report.voxels <= 4_000_000, "{:?}", filled.report);
    }
    let point = Gaussians {
        position: vec![[1e6, -1e9, 3.0]; 5],
        scale: vec![[0.0; 3]; 5],
        rotation: vec![[0.0, 0.0, 0.0, 1.0]; 5],
        opacity: vec![1.0; 5],
        ..Gaussians::default()
    };
    assert!(!fill(&point, &options(1e-3)).position.is_empty());
    assert!(fill(&ball(), &options(0.0)).position.is_empty());
    assert!(fill(&ball(), &options(f64::NAN)).position.is_empty());
    // An object smaller than a cell keeps its volume and can still turn.
    let tiny = fill(&ball(), &options(10.0));
    assert_near("tiny", volume(&tiny), BALL, 0.01);
    assert!((8..100).contains(&tiny.position.len()));
}
