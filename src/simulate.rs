//! `cosplat simulate`: a batch run without shared memory, one JSON line per frame.

use std::{
    collections::BTreeMap,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::Instant,
};

use anyhow::{Context, bail};
use cosplat_files::{Existing, NewFile, keep_apart};
use cosplat_reference::ReferenceWorld;
use cosplat_scene::{load::LoadedScene, scene_file::ObjectSpec};
use cosplat_sim_core::{
    ContactEpisode, DtLimit, Interruption, Isa, ObjectState, Scene, StepReport, Work,
    moments::{Matter, matter},
    notices::Notices,
    probe::{Measured, Probes},
    report::{GoneOver, ObjectCost, Timings},
    scene::{Part, Solver},
};
use serde::Serialize;

use crate::{
    costs::{self, CostShare},
    note, progress, say,
    scene_args::SceneArgs,
    seconds, signals, threads,
};

/// Objects whose cost a summary names.
const DEAREST: usize = 3;

/// Run a scene without shared memory and report every frame as a JSON line.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Simulated seconds to run; rounded up to whole frames.
    #[arg(long, value_parser = seconds::positive)]
    duration: f64,
    /// Where the lines go [default: standard output, as with '-'].
    #[arg(long)]
    report: Option<PathBuf>,
    /// Use the scalar double-precision reference solver: slow, for comparison.
    #[arg(long, conflicts_with = "isa")]
    f64: bool,
    /// Threads of the solver; results do not depend on it [default: one per core, with --f64 one].
    #[arg(long, value_parser = threads)]
    threads: Option<usize>,
    /// Instruction set of the kernels; results do not depend on it [default: the best].
    #[arg(long, value_parser = isa)]
    isa: Option<Isa>,
    /// Print the summary as one JSON object (with --report FILE).
    #[arg(long)]
    json: bool,
}

fn isa(text: &str) -> Result<Isa, String> {
    let known = Isa::ALL.into_iter().find(|isa| isa.to_string() == text);
    known.ok_or_else(|| {
        format!(
            "unknown instruction set, expected {}",
            Isa::ALL.map(|i| i.to_string()).join(", ")
        )
    })
}

/// One frame of the report. `docs/scene.md` explains the fields.
#[derive(Serialize)]
struct Line<'a> {
    step: u64,
    sim_time: f64,
    dt: f64,
    dt_min: f64,
    dt_limit: DtLimit,
    dt_object: Option<&'a str>,
    substeps: u32,
    rollbacks: u32,
    particle_updates: u64,
    particle_updates_full: u64,
    modelled_fraction: f64,
    work: Work,
    left_domain: &'a [u32],
    stopped: bool,
    quarantined: &'a [u32],
    kinetic_energy: f64,
    elastic_energy: f64,
    potential_energy: f64,
    lost_in_matter: f64,
    linear_momentum: [f64; 3],
    angular_momentum: [f64; 3],
    /// Absent for the reference solver, which has none.
    state_hash: Option<String>,
    contacts: Vec<ContactLine<'a>>,
    gone_over: Vec<GoneOverLine<'a>>,
    objects: Vec<ObjectLine<'a>>,
    probes: BTreeMap<&'a str, Option<Measured>>,
}

#[derive(Serialize)]
struct ObjectLine<'a> {
    name: &'a str,
    #[serde(flatten)]
    matter: Matter,
    #[serde(flatten)]
    state: ObjectState,
}

#[derive(Serialize)]
struct CostLine {
    name: String,
    #[serde(flatten)]
    cost: ObjectCost,
}

#[derive(Serialize)]
struct ContactLine<'a> {
    names: [&'a str; 2],
    #[serde(flatten)]
    episode: ContactEpisode,
}

#[derive(Serialize)]
struct GoneOverLine<'a> {
    name: &'a str,
    #[serde(flatten)]
    gone_over: GoneOver,
}

/// What a finished run comes to.
#[derive(Serialize)]
struct Summary {
    scene: String,
    frames: u64,
    sim_seconds: f64,
    wall_seconds: f64,
    particles: usize,
    substeps: u64,
    rollbacks: u64,
    particle_updates: u64,
    particle_updates_full: u64,
    work: Work,
    /// Wall seconds of the solver per phase.
    phases: Timings,
    /// What each object cost, in the order of the scene.
    objects: Vec<CostLine>,
    left_domain: usize,
    quarantined: usize,
    state_hash: Option<String>,
    warnings: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// When the scene cannot be used or the report cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if let (true, Some(threads @ (0 | 2..))) = (args.f64, args.threads) {
        bail!(
            "--threads {threads}: the solver of --f64 has one thread, expected --threads 1 or none"
        );
    }
    let loaded = args.scene.load()?;
    let scene = &loaded.scene;
    let warnings: Vec<String> = loaded
        .report
        .warnings
        .iter()
        .map(ToString::to_string)
        .collect();
    for warning in &warnings {
        note!("warning: {}: {warning}", args.scene.path.display());
    }
    let file = args.report.as_deref().filter(|p| *p != Path::new("-"));
    let new = file.map(|path| {
        keep_apart(path, loaded.files(&args.scene.path))?;
        let new = NewFile::stream(path, Existing::IsReplaced);
        new.with_context(|| format!("cannot write {}", path.display()))
    });
    let new = new.transpose()?;
    let mut out: Box<dyn Write + Send> = match &new {
        Some(new) => Box::new(BufWriter::new(new.file().try_clone()?)),
        None => Box::new(BufWriter::new(io::stdout())),
    };
    let mut summary = Summary {
        scene: scene.name.clone(),
        frames: 0,
        sim_seconds: 0.0,
        wall_seconds: 0.0,
        particles: scene.particles.position.len(),
        substeps: 0,
        rollbacks: 0,
        particle_updates: 0,
        particle_updates_full: 0,
        work: Work::default(),
        phases: Timings::default(),
        objects: (scene.objects.iter())
            .map(|object| CostLine {
                name: object.name.clone(),
                cost: ObjectCost::default(),
            })
            .collect(),
        left_domain: 0,
        quarantined: 0,
        state_hash: None,
        warnings,
    };
    let mut world = World::new(args, &loaded)?;
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = args.threads.or(args.f64.then_some(1)) {
        pool = pool.num_threads(threads);
    }
    let pool = pool.build().context("cannot start the solver's threads")?;
    let frames = match pool.install(|| simulate(args, scene, &mut world, &mut out, &mut summary)) {
        // Who reads standard output has seen enough: `| head` is no failure.
        Err(error) if io_error(&error) == Some(io::ErrorKind::BrokenPipe) => return Ok(()),
        // All that is written is the report.
        Err(error) if io_error(&error).is_some() => {
            let name = file.map_or("standard output".into(), |path| path.display().to_string());
            return Err(error.context(format!("cannot write {name}")));
        }
        outcome => outcome?,
    };
    if let (Some(new), Some(path)) = (new, file) {
        new.finish()
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    if let Some(frames) = frames {
        let frame = summary.frames;
        bail!("interrupted after {frame} of {frames} frames, which are in the report");
    }
    if args.json && file.is_some() {
        say!("{}", serde_json::to_string(&summary)?)?;
    } else {
        let text = summary_text(&summary);
        if file.is_some() {
            say!("{text}")?;
        } else {
            note!("{text}");
        }
    }
    Ok(())
}

/// Steps a world and reports every frame; of how many, where it was interrupted.
fn simulate(
    args: &Args,
    scene: &Scene,
    world: &mut World,
    out: &mut (dyn Write + Send),
    summary: &mut Summary,
) -> anyhow::Result<Option<u64>> {
    let stop = signals::stop_flag()?;
    // A duration of whole frames must not gain one by rounding.
    let frames = (args.duration * scene.frame_rate - 1e-6).ceil().max(1.0) as u64;
    let probes = Probes::new(scene);
    let mut notices = Notices::new(scene);
    let parts = scene.parts();
    let bar = progress::bar("frames", frames);
    let start = Instant::now();
    for frame in 0..frames {
        let asks = || stop.load(Ordering::Relaxed);
        let stepped = match asks() {
            true => None,
            false => world.step(&Interruption::when(&asks), 1.0 / scene.frame_rate),
        };
        let Some(report) = stepped else {
            out.flush()?;
            bar.finish_and_clear();
            return Ok(Some(frames));
        };
        let measured = world.measure(&probes, report.sim_time);
        let line = line(scene, &report, &world.matter(scene, &parts), measured);
        serde_json::to_writer(&mut *out, &line)?;
        out.write_all(b"\n")?;
        summary.frames = frame + 1;
        summary.sim_seconds = report.sim_time;
        summary.wall_seconds = start.elapsed().as_secs_f64();
        summary.substeps += u64::from(report.substeps);
        summary.rollbacks += u64::from(report.rollbacks);
        summary.particle_updates += report.particle_updates;
        summary.particle_updates_full += report.particle_updates_full;
        summary.work += report.work;
        summary.phases += report.timings;
        for (line, cost) in summary.objects.iter_mut().zip(&report.costs) {
            line.cost += *cost;
        }
        summary.left_domain += report.left_domain.len();
        summary.quarantined += report.quarantined.len();
        summary.state_hash = line.state_hash;
        for notice in notices.of(scene, &report) {
            bar.suspend(|| note!("warning: {notice}"));
            summary.warnings.push(notice);
        }
        bar.set_message(format!(
            "{:.2} s, {:.2} x real time",
            report.sim_time,
            report.sim_time / summary.wall_seconds
        ));
        bar.inc(1);
        if report.stopped {
            bar.suspend(|| {
                note!(
                    "stopped at {:.6} s: {} particles would leave the domain, whose policy is to stop",
                    report.sim_time,
                    report.left_domain.len()
                );
            });
            break;
        }
    }
    bar.finish_and_clear();
    out.flush()?;
    Ok(None)
}

/// The answer of the system behind an error, if there is one.
fn io_error(error: &anyhow::Error) -> Option<io::ErrorKind> {
    let kind = |e: &(dyn std::error::Error + 'static)| {
        let io = e.downcast_ref::<io::Error>().map(io::Error::kind);
        let json = e.downcast_ref::<serde_json::Error>();
        io.or(json.and_then(serde_json::Error::io_error_kind))
    };
    error.chain().find_map(kind)
}

fn line<'a>(
    scene: &'a Scene,
    report: &'a StepReport,
    matter: &[Matter],
    probes: Vec<(&'a str, Option<Measured>)>,
) -> Line<'a> {
    let name = |i: usize| scene.objects.get(i).map_or("", |o| o.name.as_str());
    let objects = report.objects.iter().zip(matter).enumerate();
    Line {
        step: report.step,
        sim_time: report.sim_time,
        dt: report.dt,
        dt_min: report.dt_min,
        dt_limit: report.dt_limit,
        dt_object: report.dt_object.map(name),
        substeps: report.substeps,
        rollbacks: report.rollbacks,
        particle_updates: report.particle_updates,
        particle_updates_full: report.particle_updates_full,
        modelled_fraction: fraction(report.particle_updates, report.particle_updates_full),
        work: report.work,
        left_domain: &report.left_domain,
        stopped: report.stopped,
        quarantined: &report.quarantined,
        kinetic_energy: report.kinetic_energy,
        elastic_energy: report.elastic_energy,
        potential_energy: report.potential_energy,
        lost_in_matter: report.lost_in_matter,
        linear_momentum: report.linear_momentum,
        angular_momentum: report.angular_momentum,
        state_hash: (report.state_hash != 0).then(|| format!("{:016x}", report.state_hash)),
        contacts: (report.contacts.iter())
            .map(|episode| ContactLine {
                names: episode.objects.map(name),
                episode: *episode,
            })
            .collect(),
        gone_over: (report.gone_over.iter())
            .map(|gone_over| GoneOverLine {
                name: name(gone_over.object),
                gone_over: *gone_over,
            })
            .collect(),
        objects: objects
            .map(|(i, (state, matter))| ObjectLine {
                name: name(i),
                matter: *matter,
                state: *state,
            })
            .collect(),
        probes: probes.into_iter().collect(),
    }
}

/// Updates done over those of full MPM; 1 when there was nothing to do.
fn fraction(done: u64, full: u64) -> f64 {
    if full == 0 {
        1.0
    } else {
        done as f64 / full as f64
    }
}

fn summary_text(s: &Summary) -> String {
    let rate = s.particle_updates as f64 / s.wall_seconds.max(1e-9);
    let mut text = format!(
        "{}: {} frames, {:.3} s simulated in {:.2} s ({:.2} x real time), {} particles, {} substeps, \
         {:.2} million particle-substeps/s, {} rollbacks, {} left the domain, {} quarantined, state {}",
        s.scene,
        s.frames,
        s.sim_seconds,
        s.wall_seconds,
        s.sim_seconds / s.wall_seconds.max(1e-9),
        s.particles,
        s.substeps,
        rate / 1e6,
        s.rollbacks,
        s.left_domain,
        s.quarantined,
        s.state_hash.as_deref().unwrap_or("without hash")
    );
    let mut dear: Vec<&CostLine> = s.objects.iter().collect();
    dear.sort_by(|a, b| b.cost.seconds.total_cmp(&a.cost.seconds));
    let all: f64 = dear.iter().map(|line| line.cost.seconds).sum();
    let shares = dear.iter().take(DEAREST).map(|line| CostShare {
        name: &line.name,
        share: line.cost.seconds / all,
        substeps: format!("{} substeps", line.cost.substeps),
        dt: match line.cost.substeps {
            0 => 0.0,
            _ => line.cost.dt_min,
        },
        limit: line.cost.dt_limit as u32,
        points: line.cost.contact_points,
    });
    text.push_str(&costs::of_objects(shares));
    text
}

/// One of the solvers.
enum World {
    Fast(Box<cosplat_sim_core::World>),
    Reference(Box<ReferenceWorld>),
}

impl World {
    fn new(args: &Args, loaded: &LoadedScene) -> anyhow::Result<Self> {
        let scene = &loaded.scene;
        if args.f64 {
            if scene.conditions.settle > 0.0 {
                bail!("--f64 cannot let a scene come to rest: add --set settle=0");
            }
            // What is on a grid of its own by choice is spatial matter here.
            let solid = |o: &&ObjectSpec| o.solver == Some(Solver::Lagrangian);
            if let Some(object) = loaded.file.objects.iter().find(solid) {
                let name = &object.name;
                bail!(
                    "--f64 has no solver = \"lagrangian\", which object `{name}` has: set it to \"spatial\""
                );
            }
            return Ok(Self::Reference(Box::new(ReferenceWorld::new(scene))));
        }
        let isa = args.isa.unwrap_or_else(Isa::detect);
        let world = cosplat_sim_core::World::with_isa(scene.clone(), isa)?;
        Ok(Self::Fast(Box::new(world)))
    }

    fn step(&mut self, interruption: &Interruption<'_>, frame_dt: f64) -> Option<StepReport> {
        match self {
            Self::Fast(world) => world.step_unless(interruption, frame_dt, &[]),
            Self::Reference(world) => world.step_unless(interruption, frame_dt, &[]),
        }
    }

    fn measure<'p>(&self, probes: &'p Probes, time: f64) -> Vec<(&'p str, Option<Measured>)> {
        match self {
            Self::Fast(world) => probes.measure(&world.arrays(), time),
            Self::Reference(world) => probes.measure(&world.particles.arrays(), time),
        }
    }

    fn matter(&self, scene: &Scene, parts: &[Part]) -> Vec<Matter> {
        let objects = scene.objects.len();
        match self {
            Self::Fast(world) => matter(&world.arrays(), parts, objects),
            Self::Reference(world) => matter(&world.particles.arrays(), parts, objects),
        }
    }
}
