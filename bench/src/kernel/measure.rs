//! Interleaved measurement of one material: yardstick, solver in several configurations, reference solver.

use std::time::Instant;

use cosplat_reference::ReferenceWorld;
use cosplat_sim_core::{Isa, World, materials::Material};
use indicatif::ProgressBar;
use rayon::{ThreadPool, ThreadPoolBuilder};
use rustix::time::{ClockId, clock_gettime};

use super::{
    scene::{Layout, material, scene, yardstick_of},
    yardstick::Yardstick,
};

/// Substeps at rest that make one run: about what a published frame takes.
const SUBSTEPS: u32 = 32;
/// Particles that the yardstick is measured with at most: more only slow it down.
const YARDSTICK_PARTICLES: u32 = 1 << 18;
/// Particles and substeps of the reference solver, which is slow.
const REFERENCE: (u32, usize) = (1 << 12, 2);

/// One configuration of the solver.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Particles, rounded to a power of two.
    pub particles: u32,
    /// Particles per cell.
    pub per_cell: u32,
    /// Threads.
    pub threads: u16,
    /// Instruction set.
    pub isa: Isa,
    /// Whether a Gaussian hangs on every particle.
    pub gaussians: bool,
}

/// First quartile, median and third quartile.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Quartiles {
    /// Median.
    pub median: f64,
    /// First quartile.
    pub q1: f64,
    /// Third quartile.
    pub q3: f64,
}

impl Quartiles {
    /// Of any samples, at least one.
    pub fn of(mut samples: Vec<f64>) -> Self {
        samples.sort_by(f64::total_cmp);
        let at = |n: usize| samples[(samples.len() - 1) * n / 4];
        Self {
            median: at(2),
            q1: at(1),
            q3: at(3),
        }
    }

    /// Of ratios of samples taken in the same rounds.
    pub fn of_ratios(above: &[f64], below: &[f64]) -> Self {
        Self::of(above.iter().zip(below).map(|(a, b)| a / b).collect())
    }
}

/// What was measured of one case.
pub struct Measured {
    /// What it is.
    pub case: Case,
    /// Particles, exactly.
    pub particles: usize,
    /// Million particle-substeps per second, one per round.
    pub rates: Vec<f64>,
    /// Share of sorting, particle pass and grid pass, medians.
    pub phases: [f64; 3],
    /// Rates of the yardstick at this density, one per round.
    pub yardstick: Vec<f64>,
    /// Rates of the reference solver, one per round.
    pub reference: Vec<f64>,
}

/// Seconds of processor time that this process has used.
fn cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Runs `work` and returns its result, its processor time [s], and the share of wall time in which one thread had a processor.
pub fn on_processor<T>(work: impl FnOnce() -> T) -> (T, f64, f64) {
    let (wall, cpu) = (Instant::now(), cpu_seconds());
    let result = work();
    let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    (result, cpu, (cpu / wall).min(1.0))
}

/// The falling block, in motion.
pub struct Runner {
    world: World,
    pool: ThreadPool,
    frame_dt: f64,
    /// Substeps [s] of the latest run, and their number.
    substeps: (f64, u32),
    /// Million particle-substeps per second, one per run.
    pub rates: Vec<f64>,
    shares: [Vec<f64>; 3],
}

impl Runner {
    /// A block of `material` that has made its first frame.
    ///
    /// # Errors
    /// When no threads can be started or the processor lacks the instruction set.
    pub fn new(material: Material, case: &Case) -> anyhow::Result<Self> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(case.threads.into())
            .build()?;
        let layout = Layout::new(case.particles, case.per_cell);
        let scene = scene(material, &layout, case.gaussians);
        let mut world = pool.install(|| World::with_isa(scene, case.isa))?;
        // The first frame sorts everything and shows the substep at rest.
        let report = pool.install(|| world.step(1e-3, &[]));
        Ok(Self {
            frame_dt: f64::from(SUBSTEPS) * report.dt_min,
            substeps: (report.dt_min, SUBSTEPS),
            world,
            pool,
            rates: vec![],
            shares: Default::default(),
        })
    }

    /// One frame; only sorting, particle pass and grid pass count.
    pub fn run(&mut self, threads: u16) {
        let (report, _, share) =
            on_processor(|| self.pool.install(|| self.world.step(self.frame_dt, &[])));
        let t = &report.timings;
        let busy = t.sort + t.particles + t.grid;
        // One thread that had to wait for a processor did not need the time.
        let time = if threads == 1 { busy * share } else { busy };
        self.rates.push(report.particle_updates as f64 / time / 1e6);
        for (shares, phase) in self.shares.iter_mut().zip([t.sort, t.particles, t.grid]) {
            shares.push(phase / busy);
        }
        self.substeps = (self.frame_dt / f64::from(report.substeps), report.substeps);
    }
}

/// A yardstick and what it has shown.
struct Rod {
    per_cell: u32,
    body: Box<dyn Yardstick>,
    rates: Vec<f64>,
}

/// Measures all cases of one material: in every round each of them, the yardsticks and the reference solver run
/// once, in rotating order.
///
/// # Errors
/// When no threads can be started or the processor lacks an instruction set.
pub fn measure(
    name: &str,
    cases: &[Case],
    rounds: u32,
    bar: &ProgressBar,
) -> anyhow::Result<Vec<Measured>> {
    let mut runners = Vec::new();
    let mut rods: Vec<Rod> = Vec::new();
    for case in cases {
        bar.set_message(format!("{name}: prepare"));
        let material = material(name).ok_or_else(|| anyhow::anyhow!("no material `{name}`"))?;
        let runner = Runner::new(material, case)?;
        if !rods.iter().any(|rod| rod.per_cell == case.per_cell) {
            let layout = Layout::new(case.particles.min(YARDSTICK_PARTICLES), case.per_cell);
            let mut scene = runner.world.scene().clone();
            if layout.particles() != scene.particles.position.len() {
                scene = super::scene::scene(scene.objects[0].material.clone(), &layout, false);
            }
            let body = yardstick_of(&scene)
                .ok_or_else(|| anyhow::anyhow!("the yardstick has no law `{name}`"))?;
            rods.push(Rod {
                per_cell: case.per_cell,
                body,
                rates: vec![],
            });
        }
        runners.push(runner);
    }
    let small = material(name).map(|m| scene(m, &Layout::new(REFERENCE.0, 8), false));
    let mut reference = small.map(|scene| ReferenceWorld::new(&scene));
    let mut reference_rates = Vec::new();
    let turns = runners.len() + rods.len();
    for round in 0..rounds as usize {
        for turn in 0..turns {
            let who = (round + turn) % turns;
            bar.set_message(format!("{name}: round {} of {rounds}", round + 1));
            if let Some(rod) = who.checked_sub(runners.len()).map(|n| &mut rods[n]) {
                let (dt, substeps) = runners[0].substeps;
                let ((), cpu, _) = on_processor(|| rod.body.advance(dt, substeps));
                let updates = rod.body.len() as f64 * f64::from(substeps);
                rod.rates.push(updates / cpu / 1e6);
            } else {
                runners[who].run(cases[who].threads);
            }
            bar.inc(1);
        }
        if let Some(world) = &mut reference {
            let substeps = [runners[0].substeps.0; REFERENCE.1];
            let (report, cpu, _) = on_processor(|| world.step_with(&substeps, &[]));
            reference_rates.push(report.particle_updates as f64 / cpu / 1e6);
        }
    }
    let measured = runners.into_iter().zip(cases).map(|(runner, case)| {
        let rod = rods.iter().find(|rod| rod.per_cell == case.per_cell);
        Measured {
            case: case.clone(),
            particles: runner.world.scene().particles.position.len(),
            phases: runner.shares.map(|shares| Quartiles::of(shares).median),
            rates: runner.rates,
            yardstick: rod.map_or(vec![], |rod| rod.rates.clone()),
            reference: reference_rates.clone(),
        }
    });
    Ok(measured.collect())
}
