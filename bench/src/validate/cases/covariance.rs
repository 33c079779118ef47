//! Covariances that a client receives, of a body that spins and of matter that is sheared and stretched.

use std::array::from_fn;

use super::super::recorded::record;
use crate::{
    trial::{SceneText, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SPIN: SceneText = scene_text!("validate/gaussian_spin");
const SHEAR: SceneText = scene_text!("validate/gaussian_shear");
const STRETCH: SceneText = scene_text!("validate/gaussian_stretch");

/// The case.
pub const CASE: Case = Case {
    number: 19,
    name: "covariance",
    about: "the covariance a client receives is F Sigma F^T",
    run,
};

type Matrix = [[f64; 3]; 3];

fn run(_size: Size) -> anyhow::Result<Vec<Row>> {
    // Ten radians about y.
    let turned = |t: f64| {
        let (sin, cos) = (10.0 * t).sin_cos();
        [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]
    };
    let sheared = |t: f64| [[1.0, t, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let stretched = |t: f64| {
        [
            [1.0 + 0.5 * t, 0.0, 0.0],
            [0.0, 1.0 - 0.3 * t, 0.0],
            [0.0, 0.0, 1.0],
        ]
    };
    Ok(vec![
        worst("spin of 10 rad", &SPIN, &turned, 60, None)?,
        worst("simple shear of 0.1", &SHEAR, &sheared, 1, None)?,
        worst("simple shear of 1", &SHEAR, &sheared, 10, None)?,
        worst("stretches of 1.05 and 0.97", &STRETCH, &stretched, 1, None)?,
        worst(
            "stretches of 1.5 and 0.7",
            &STRETCH,
            &stretched,
            10,
            Some(EDGES),
        )?,
    ])
}

const EDGES: &str = "the covariance is that of the F of the particles, and that F is off: APIC keeps a velocity gradient C as it was \
     before its matter moved, where C (1 + dt C)^-1 is that of matter that flies apart. Inside, averaging over \
     neighbours makes up for it; at free edges F is 2 % too large after a stretch of 1.5, whatever dt is.";

/// Largest error over all Gaussians of a frame, relative to the size of the covariance.
fn worst(
    name: &str,
    scene: &SceneText,
    f: &dyn Fn(f64) -> Matrix,
    step: usize,
    known_failure: Option<&'static str>,
) -> anyhow::Result<Row> {
    let recorded = record(scene, 1.0, 0, &[])?;
    let (Some((_, at_rest)), Some((header, moved))) =
        (recorded.frames.first(), recorded.frames.get(step))
    else {
        anyhow::bail!("{} frames of {}", recorded.frames.len(), scene.path);
    };
    let f = f(header.sim_time);
    let mut error = 0.0_f64;
    for (before, after) in at_rest.iter().zip(moved) {
        let expected = times(&times(&f, &full(before.covariance)), &transposed(&f));
        let found = full(after.covariance);
        let difference = from_fn(|i| from_fn(|j| found[i][j] - expected[i][j]));
        let relative = norm(&difference) / norm(&expected);
        // max() would drop what is not a number.
        error = if relative > error || relative.is_nan() {
            relative
        } else {
            error
        };
    }
    Ok(Row {
        quantity: format!("{name}: worst error of {} covariances", moved.len()),
        reference: 0.0,
        source: "F Sigma F^T, exact F",
        measured: error,
        gate: Gate::AtMost(1e-5),
        known_failure,
        command: format!(
            "cosplat serve {} --paused --lossless --pace free --duration 1; cosplat record -o run.mcap; cosplat ctl resume",
            scene.path
        ),
    })
}

fn full(c: [f32; 6]) -> Matrix {
    let [xx, xy, xz, yy, yz, zz] = c.map(f64::from);
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    from_fn(|i| from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn transposed(a: &Matrix) -> Matrix {
    from_fn(|i| from_fn(|j| a[j][i]))
}

fn norm(a: &Matrix) -> f64 {
    a.iter().flatten().map(|x| x * x).sum::<f64>().sqrt()
}
