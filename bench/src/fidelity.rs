//! `cosplat bench fidelity`: what automatic fidelity saves, and what it changes, against modelling everything.

use std::{fmt, path::Path, sync::atomic::Ordering, time::Instant};

use anyhow::{Context, bail};
use cosplat_server::load::load_text;
use cosplat_sim_core::{
    Scene, World,
    command::{Action, Command},
    report::{Level, ObjectState},
    scene::{ContactMethod, Fidelity},
};
use serde::Serialize;

use crate::{progress, signals};

/// Run scenes with every object modelled in full, then with automatic fidelity at several tolerances.
#[derive(clap::Args)]
pub struct Args {
    /// Only this scene: vases or box.
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Simulated seconds, in place of the scene's own.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Tolerances, shares of an object's radius.
    #[arg(long, value_delimiter = ',', default_values_t = [0.003, 0.01, 0.03, 0.05, 0.1])]
    tolerance: Vec<f64>,
    /// Print one JSON object per run.
    #[arg(long)]
    json: bool,
}

/// A scene and what pushes its objects.
struct Case {
    name: &'static str,
    text: &'static str,
    /// Simulated time [s].
    duration: f64,
    /// When [s], whom, impulse [N s].
    pushes: &'static [(f64, &'static str, [f64; 3])],
}

const CASES: [Case; 2] = [
    Case {
        name: "vases",
        text: include_str!("../../scenes/two_vases.toml"),
        duration: 10.0,
        pushes: &[
            (0.6, "left", [1.3, 0.0, 0.0]),
            (2.2, "right", [-0.5, 0.3, 0.0]),
        ],
    },
    Case {
        name: "box",
        text: include_str!("../../scenes/box_of_fifty.toml"),
        duration: 5.0,
        pushes: &[],
    },
];

/// One run.
#[derive(Serialize)]
struct Row {
    scene: &'static str,
    model: &'static str,
    /// Absent where everything is modelled.
    tolerance: Option<f64>,
    particles: usize,
    objects: usize,
    seconds: f64,
    particle_updates: u64,
    /// These over those of the run in which everything is modelled.
    modelled_fraction: f64,
    /// Against the run in which everything is modelled.
    fewer_updates: f64,
    wall_seconds: f64,
    /// Of the last simulated second.
    last_second_wall_seconds: f64,
    /// Largest distance of a centre of mass from where full modelling has it at the same time, relative to the
    /// longest way that an object went.
    com_path_error: f64,
    /// The same, mean over objects at the end, in radii.
    mean_com_error_radii: f64,
    /// Difference of the height of the centre of mass of all objects at the end, relative to its height above the lowest
    /// centre of mass: what heaps have in common whose objects lie elsewhere.
    height_error: f64,
    asleep_at_end: usize,
    fidelity_loss_j: f64,
}

/// What a run leaves.
struct Run {
    row: Row,
    /// Centres of mass per frame [m].
    path: Vec<Vec<[f64; 3]>>,
    radii: Vec<f64>,
    /// Of the centre of mass of all objects at the end [m]; of the lowest.
    heights: [f64; 2],
}

/// How the objects of a run are modelled.
#[derive(Clone, Copy)]
enum Model {
    /// All in full.
    Full,
    /// Likewise, with slightly smaller substeps: how far two equally good answers are apart.
    Twin,
    /// Automatically.
    Auto(f64),
}

/// Substeps of a twin relative to those of the others.
const TWIN: f64 = 0.98;

/// Runs the measurement.
///
/// # Errors
/// When a scene cannot be run.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let chosen = |case: &&Case| args.scene.as_deref().is_none_or(|name| name == case.name);
    let cases: Vec<&Case> = CASES.iter().filter(chosen).collect();
    if cases.is_empty() {
        bail!("unknown scene, expected vases or box");
    }
    if !args.json {
        println!("{}", Row::HEAD);
    }
    for case in cases {
        let full = simulate(case, Model::Full, args.duration)?;
        print(&full.row, args)?;
        let tolerances = args.tolerance.iter().map(|t| Model::Auto(*t));
        for model in [Model::Twin].into_iter().chain(tolerances) {
            let mut run = simulate(case, model, args.duration)?;
            run.compare(&full);
            print(&run.row, args)?;
        }
    }
    Ok(())
}

fn print(row: &Row, args: &Args) -> anyhow::Result<()> {
    if args.json {
        println!("{}", serde_json::to_string(row)?);
    } else {
        println!("{row}");
    }
    Ok(())
}

fn scene(case: &Case, model: Model) -> anyhow::Result<Scene> {
    let loaded = load_text(case.text.to_owned(), Path::new(case.name))?;
    let mut scene = loaded.scene;
    scene.contact.method = ContactMethod::TwoScale;
    for object in &mut scene.objects {
        if object.fidelity != Fidelity::Static {
            object.fidelity = match model {
                Model::Full | Model::Twin => Fidelity::Mpm,
                Model::Auto(_) => Fidelity::Auto,
            };
        }
    }
    match model {
        Model::Full => (),
        Model::Twin => scene.cfl *= TWIN,
        Model::Auto(tolerance) => scene.tolerance = tolerance,
    }
    Ok(scene)
}

fn simulate(case: &Case, model: Model, duration: Option<f64>) -> anyhow::Result<Run> {
    let stop = signals::stop_flag()?;
    let scene = scene(case, model)?;
    let up = scene.gravity.map(|g| -g);
    let duration = duration.unwrap_or(case.duration);
    let frame = 1.0 / scene.frame_rate;
    let frames = (duration / frame).round().max(1.0) as usize;
    let mut world = World::new(scene)?;
    let mut pushes = Vec::new();
    for &(time, name, impulse) in case.pushes {
        let object = world.scene().objects.iter().position(|o| o.name == name);
        let object = object.with_context(|| format!("{} has no object {name}", case.name))?;
        pushes.push((
            (time / frame).round() as usize,
            Action::Impulse { object, impulse },
        ));
    }
    let bar = progress::bar(case.name, frames as u64);
    let mut path = Vec::with_capacity(frames);
    let (mut updates, mut loss, mut last_second) = (0, 0.0, 0.0);
    let start = Instant::now();
    for at in 0..frames {
        if stop.load(Ordering::Relaxed) {
            bail!("interrupted");
        }
        let due = pushes.iter().filter(|(when, _)| *when == at).zip(0..);
        let commands: Vec<Command> = due
            .map(|((_, action), sequence)| Command {
                apply_at_step: 0,
                client: 0,
                sequence,
                action: action.clone(),
            })
            .collect();
        let report = world.step(frame, &commands);
        updates += report.particle_updates;
        loss += report.fidelity_loss;
        if (frames - at) as f64 * frame <= 1.0 + 1e-9 {
            last_second += report.timings.total;
        }
        path.push(report.objects.iter().map(|o| o.com).collect());
        bar.inc(1);
    }
    bar.finish_and_clear();
    let states = &world.report().objects;
    let row = Row {
        scene: case.name,
        model: match model {
            Model::Full => "all MPM",
            Model::Twin => "all MPM, substeps 2 % shorter",
            Model::Auto(_) => "auto",
        },
        tolerance: match model {
            Model::Full | Model::Twin => None,
            Model::Auto(tolerance) => Some(tolerance),
        },
        particles: world.scene().particles.position.len(),
        objects: states.iter().filter(|o| o.mass > 0.0).count(),
        seconds: duration,
        particle_updates: updates,
        modelled_fraction: 1.0,
        fewer_updates: 1.0,
        wall_seconds: start.elapsed().as_secs_f64(),
        last_second_wall_seconds: last_second,
        com_path_error: 0.0,
        mean_com_error_radii: 0.0,
        height_error: 0.0,
        asleep_at_end: states.iter().filter(|o| o.level == Level::Asleep).count(),
        fidelity_loss_j: loss,
    };
    let radii = states.iter().map(|o| o.radius).collect();
    let heights = heights(states, up);
    Ok(Run {
        row,
        path,
        radii,
        heights,
    })
}

/// Along `up`: of the centre of mass of all objects, and of the lowest of theirs.
fn heights(states: &[ObjectState], up: [f64; 3]) -> [f64; 2] {
    let length = distance(up, [0.0; 3]).max(f64::MIN_POSITIVE);
    let height = |o: &ObjectState| (0..3).map(|a| o.com[a] * up[a]).sum::<f64>() / length;
    let (mut mass, mut sum, mut lowest) = (0.0, 0.0, f64::INFINITY);
    for object in states.iter().filter(|o| o.mass > 0.0) {
        mass += object.mass;
        sum += object.mass * height(object);
        lowest = lowest.min(height(object));
    }
    [sum / mass, lowest]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>().sqrt()
}

impl Run {
    fn compare(&mut self, full: &Self) {
        let objects = self.radii.len();
        let way = |id: usize| {
            let steps = full.path.windows(2);
            steps
                .map(|two| distance(two[0][id], two[1][id]))
                .sum::<f64>()
        };
        let longest = (0..objects).map(way).fold(0.0, f64::max);
        let frames = self.path.iter().zip(&full.path);
        let apart = frames.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| distance(*a, *b)));
        self.row.com_path_error = apart.fold(0.0, f64::max) / longest;
        if let (Some(mine), Some(theirs)) = (self.path.last(), full.path.last()) {
            let simulated = (0..objects).filter(|&id| self.radii[id] > 0.0);
            let sum: f64 = simulated
                .map(|id| distance(mine[id], theirs[id]) / self.radii[id])
                .sum();
            self.row.mean_com_error_radii = sum / self.row.objects as f64;
        }
        let [height, lowest] = full.heights;
        self.row.height_error = (self.heights[0] - height).abs() / (height - lowest);
        let updates = self.row.particle_updates.max(1);
        self.row.fewer_updates = full.row.particle_updates as f64 / updates as f64;
        self.row.modelled_fraction = 1.0 / self.row.fewer_updates;
    }
}

impl Row {
    const HEAD: &str = "| scene | tolerance | particle-updates | modelled | fewer by | wall | wall, last second | COM path error \
                        | mean COM error at the end | height error | asleep at the end | energy booked |\n\
                        |---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|";
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tolerance = self.tolerance.map_or(self.model.into(), |t| t.to_string());
        write!(
            f,
            "| {} | {tolerance} | {:.1} M | {:.1} % | {:.2} x | {:.2} s | {:.3} s | {:.2} % | {:.3} radii | {:.2} % | {} of {} | {:.2e} J |",
            self.scene,
            self.particle_updates as f64 / 1e6,
            100.0 * self.modelled_fraction,
            self.fewer_updates,
            self.wall_seconds,
            self.last_second_wall_seconds,
            100.0 * self.com_path_error,
            self.mean_com_error_radii,
            100.0 * self.height_error,
            self.asleep_at_end,
            self.objects,
            self.fidelity_loss_j,
        )
    }
}
