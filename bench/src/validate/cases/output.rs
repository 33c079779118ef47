//! What models an object, what a client receives, what computes it: none of it may show.

use std::array::from_fn;

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{
        case::{Case, Size},
        measures::first,
        recorded::{Recorded, record},
        report::Gate,
    },
};

const FIDELITY: SceneText = scene_text!("validate/fidelity");
/// Half an edge of the cubes [m]; the tolerance is relative to their effective radius, which is no less.
const RADIUS: f64 = 0.2;
/// `tolerance` of the scene, the default.
const TOLERANCE: f64 = 0.01;

/// 18: objects that change what models them on their way keep momentum, spin and path.
pub fn fidelity(_size: Size) -> Vec<Case> {
    let trial = |fidelity: &str| {
        let quoted = format!("\"{fidelity}\"");
        Trial::new(&FIDELITY, 1.0)
            .set("objects.0.fidelity", &quoted)
            .set("objects.1.fidelity", &quoted)
    };
    let auto = trial("auto");
    let path = |quantity, until| {
        let claim = "distance of the paths [radii]";
        Case::of_all(
            claim,
            quantity,
            [trial("auto"), trial("mpm")],
            move |runs| Ok(distance(runs[0], runs[1], until)),
        )
        .against(0.0, "the same with fidelity = \"mpm\"")
        .within(Gate::AtMost(TOLERANCE))
    };
    vec![
        Case::new(
            "changes of model of the first cube",
            "changes of model of the first cube",
            &auto,
            |run| {
                let level = |frame: &serde_json::Value| {
                    frame
                        .pointer("/objects/0/level")
                        .is_some_and(|l| l == "rigid")
                };
                let levels: Vec<bool> = run.frames.iter().map(level).collect();
                let switches = levels.windows(2).filter(|pair| pair[0] != pair[1]);
                Ok(switches.count() as f64)
            },
        )
        .against(3.0, "flies, meets, flies")
        .within(Gate::AtLeast(2.0)),
        Case::new(
            "change of momentum and angular momentum",
            "change of momentum, relative to that of one cube",
            &auto,
            |run| {
                let speed = first(&run.series("/objects/0/linear_velocity/0")).abs();
                Ok(change(run, "linear_momentum") / (speed * run.last("/objects/0/mass")?))
            },
        )
        .against(0.0, "nothing acts from outside")
        .within(Gate::AtMost(1e-6)),
        Case::new(
            "change of momentum and angular momentum",
            "change of angular momentum, relative",
            &auto,
            |run| {
                let at_start = |axis| first(&run.series(&format!("/angular_momentum/{axis}")));
                let length = (0..3)
                    .map(|axis| at_start(axis).powi(2))
                    .sum::<f64>()
                    .sqrt();
                Ok(change(run, "angular_momentum") / length)
            },
        )
        .against(0.0, "nothing acts from outside")
        .within(Gate::AtMost(1e-6)),
        path("distance of the paths before they meet [radii]", 0.3),
        path("distance of the paths, the collision included [radii]", 1.0),
    ]
}

/// Largest change of a component of a conserved vector of the whole scene.
fn change(run: &Outcome, vector: &str) -> f64 {
    let mut worst = 0.0_f64;
    for axis in 0..3 {
        let values = run.series(&format!("/{vector}/{axis}"));
        let start = first(&values);
        worst = values
            .iter()
            .fold(worst, |worst, v| worst.max((v.1 - start).abs()));
    }
    worst
}

/// Largest distance between the centres of mass of two runs until a time, in radii.
fn distance(a: &Outcome, b: &Outcome, until: f64) -> f64 {
    let mut worst = 0.0_f64;
    for (object, axis) in (0..2).flat_map(|o| (0..3).map(move |a| (o, a))) {
        let pointer = format!("/objects/{object}/com/{axis}");
        let (a, b) = (a.series(&pointer), b.series(&pointer));
        let frames = a.iter().zip(&b).filter(|(a, _)| a.0 <= until);
        worst = frames.fold(worst, |worst, (a, b)| worst.max((a.1 - b.1).abs()));
    }
    worst / RADIUS
}

const SPIN: SceneText = scene_text!("validate/gaussian_spin");
const SHEAR: SceneText = scene_text!("validate/gaussian_shear");
const STRETCH: SceneText = scene_text!("validate/gaussian_stretch");

type Matrix = [[f64; 3]; 3];

/// 19: covariances that a client receives, of a body that spins and of matter that is sheared and stretched.
pub fn covariance(_size: Size) -> Vec<Case> {
    // Ten radians about y in a second.
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
    let turn = "covariances of a body that spins";
    let strain = "covariances of sheared and stretched matter";
    vec![
        worst_covariance(turn, ("spin of 10 rad", 1600), &SPIN, turned, 60),
        worst_covariance(strain, ("simple shear of 0.1", 2400), &SHEAR, sheared, 1),
        worst_covariance(strain, ("simple shear of 1", 2400), &SHEAR, sheared, 10),
        worst_covariance(
            strain,
            ("stretches of 1.05 and 0.97", 2400),
            &STRETCH,
            stretched,
            1,
        ),
        worst_covariance(
            strain,
            ("stretches of 1.5 and 0.7", 2400),
            &STRETCH,
            stretched,
            10,
        ),
    ]
}

/// Largest error over so many Gaussians of a frame, relative to the size of the covariance, where `F` is known.
fn worst_covariance(
    claim: &'static str,
    (name, count): (&str, usize),
    scene: &'static SceneText,
    f: impl Fn(f64) -> Matrix + 'static,
    step: usize,
) -> Case {
    let command = format!(
        "cosplat serve {} --paused --lossless --pace free --duration 1; cosplat record -o run.mcap; cosplat ctl resume",
        scene.path
    );
    let quantity = format!("{name}: worst error of {count} covariances");
    Case::session(claim, quantity, command, move || {
        let recorded = record(scene, 1.0, 0, &[])?;
        let (Some((_, at_rest)), Some((header, moved))) =
            (recorded.frames.first(), recorded.frames.get(step))
        else {
            anyhow::bail!("{} frames of {}", recorded.frames.len(), scene.path);
        };
        anyhow::ensure!(
            moved.len() == count,
            "{} Gaussians of {}, expected {count}",
            moved.len(),
            scene.path
        );
        let f = f(header.sim_time);
        let mut error = 0.0_f64;
        for (before, after) in at_rest.iter().zip(moved) {
            let expected = times(&times(&f, &full(before.covariance)), &transposed(&f));
            let found = full(after.covariance);
            let difference = from_fn(|i| from_fn(|j| found[i][j] - expected[i][j]));
            let relative = norm(&difference) / norm(&expected);
            // max() would drop what is not a number.
            if relative > error || relative.is_nan() {
                error = relative;
            }
        }
        Ok(error)
    })
    .against(0.0, "F Sigma F^T, exact F")
    .within(Gate::AtMost(1e-5))
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

const DETERMINISM: SceneText = scene_text!("validate/determinism");
/// Frames per second of the scene.
const RATE: f64 = 50.0;
/// What is asked of the recorded session.
const ORDER: &[&str] = &["--at-step", "5", "push", "ball", "2", "0", "0"];

/// 20: same scene, same orders: the same bits, whatever computes them.
pub fn determinism(size: Size) -> Vec<Case> {
    let duration = size.pick(0.5, 2.0);
    let frames = (duration * RATE) as usize;
    let trial = |option: &str| Trial::new(&DETERMINISM, duration).option(option);
    let mut cases: Vec<Case> = [
        ("--threads=2", "2 threads"),
        ("--threads=4", "4 threads"),
        ("--threads=8", "8 threads"),
        ("--isa=portable", "portable instructions"),
    ]
    .into_iter()
    .map(|(option, name)| {
        Case::of_all(
            "frames that differ by threads or instruction set",
            format!("{name} against 1 thread: frames of {frames} that differ"),
            [trial(option), trial("--threads=1")],
            |runs| {
                let [other, one] = [runs[0], runs[1]].map(|run| &run.frames);
                let differ = |(a, b): &(&serde_json::Value, &serde_json::Value)| {
                    a["state_hash"] != b["state_hash"]
                };
                let different = one.iter().zip(other).filter(differ).count();
                Ok((different + one.len().abs_diff(other.len())) as f64)
            },
        )
        .against(0.0, "same bits")
    })
    .collect();
    let command = format!(
        "cosplat serve {} --paused --lossless --pace free --duration {duration} --threads 4; cosplat record -o run.mcap; \
         cosplat ctl {}; cosplat ctl resume",
        DETERMINISM.path,
        ORDER.join(" ")
    );
    // The state before the first step is a frame, too.
    let quantity = format!(
        "recorded, played again: frames of {} that differ in any bit",
        frames + 1
    );
    let claim = "frames of a session played again that differ";
    cases.push(
        Case::session(claim, quantity, command, move || {
            let once = record(&DETERMINISM, duration, 1, &[ORDER])?;
            let again = record(&DETERMINISM, duration, 4, &[ORDER])?;
            anyhow::ensure!(
                once.frames.len() == frames + 1,
                "{} frames recorded, expected {}",
                once.frames.len(),
                frames + 1
            );
            Ok(different(&once, &again) as f64)
        })
        .against(0.0, "same bits"),
    );
    cases
}

fn different(a: &Recorded, b: &Recorded) -> usize {
    let frames = a.frames.iter().zip(&b.frames);
    let unlike = frames.filter(|((h, g), (i, k))| {
        (h.step, h.sim_time, h.state_hash) != (i.step, i.sim_time, i.state_hash) || g != k
    });
    unlike.count() + a.frames.len().abs_diff(b.frames.len()) + a.commands.abs_diff(b.commands)
}
