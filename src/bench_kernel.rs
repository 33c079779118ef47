//! `cosplat bench kernel`: particle-substeps per second of the solver.
//!
//! A jittered block of particles falls, spinning, onto a slipping floor. Each run is one short frame; sorting,
//! particle pass and grid pass count, reports do not.

use cosplat_sim_core::{
    Isa, Scene, StepReport, World,
    assets::Gaussians,
    materials::{Law, Material},
    scene::{
        Aabb, Binding, Collider, ColliderShape, Conditions, Fidelity, Object, Pose, RestParticles,
        Surface,
    },
};
use rayon::ThreadPoolBuilder;
use serde_json::json;

use crate::progress;

/// Cell size of the measured scene [m].
const DX: f64 = 1.0 / 64.0;

/// Measure particle-substeps per second.
#[derive(clap::Args)]
pub struct Args {
    /// Cells along each edge of the block of particles.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=128))]
    cells: u32,
    /// Particles along each edge of a cell.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=4))]
    per_edge: u32,
    /// Threads.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: u16,
    /// Instruction set: avx512, avx2 or portable; the best one when left out.
    #[arg(long)]
    isa: Option<Isa>,
    /// Runs per material.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(3..=10_000))]
    runs: u32,
    /// Print one JSON object per material.
    #[arg(long)]
    json: bool,
}

/// Runs the measurement.
///
/// # Errors
/// When no threads can be started or the processor lacks the instruction set.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let isa = args.isa.unwrap_or_else(Isa::detect);
    let pool = ThreadPoolBuilder::new()
        .num_threads(args.threads.into())
        .build()?;
    let laws = [
        ("fixed_corotated", Law::FixedCorotated),
        ("neo_hookean", Law::NeoHookean),
    ];
    let bar = progress::bar("bench kernel", 2 * u64::from(args.runs));
    for (name, law) in laws {
        let scene = scene(law, args);
        let particles = scene.particles.position.len();
        let mut world = pool.install(|| World::with_isa(scene, isa))?;
        // Every run advances equally long, some 16 substeps at rest.
        let frame_dt = 1.0 / 300.0;
        pool.install(|| world.step(frame_dt, &[]));
        let mut runs: Vec<Run> = Vec::new();
        for _ in 0..args.runs {
            runs.push(Run::new(&pool.install(|| world.step(frame_dt, &[]))));
            bar.inc(1);
        }
        runs.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        let quartile = |n: usize| runs[(runs.len() - 1) * n / 4];
        let [q1, median, q3] = [1, 2, 3].map(quartile);
        if args.json {
            let line = json!({
                "material": name,
                "particles": particles,
                "particles_per_cell": args.per_edge.pow(3),
                "threads": args.threads,
                "isa": isa.to_string(),
                "runs": args.runs,
                "mparticle_substeps_per_s": {"median": median.rate, "q1": q1.rate, "q3": q3.rate},
                "phases": {
                    "sort": median.sort,
                    "particles": median.particles,
                    "grid": median.grid,
                },
            });
            bar.suspend(|| println!("{line}"));
        } else {
            bar.suspend(|| {
                println!(
                    "{name}: {:.1} million particle-substeps/s (quartiles {:.1} to {:.1}); {particles} particles, \
                     {} threads, {isa}; sort {:.0} %, particles {:.0} %, grid {:.0} %",
                    median.rate,
                    q1.rate,
                    q3.rate,
                    args.threads,
                    100.0 * median.sort,
                    100.0 * median.particles,
                    100.0 * median.grid,
                );
            });
        }
    }
    bar.finish_and_clear();
    Ok(())
}

/// Rate and shares of one run.
#[derive(Clone, Copy)]
struct Run {
    /// Million particle-substeps per second.
    rate: f64,
    sort: f64,
    particles: f64,
    grid: f64,
}

impl Run {
    fn new(report: &StepReport) -> Self {
        let t = &report.timings;
        let busy = t.sort + t.particles + t.grid;
        Self {
            rate: report.particle_updates as f64 / busy / 1e6,
            sort: t.sort / busy,
            particles: t.particles / busy,
            grid: t.grid / busy,
        }
    }
}

/// Numbers in -0.5..0.5 from a linear congruential generator (Knuth's MMIX constants).
fn jitter(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
}

fn scene(law: Law, args: &Args) -> Scene {
    let h = DX / f64::from(args.per_edge);
    let edge = args.cells * args.per_edge;
    let mut seed = 1;
    let mut position = Vec::with_capacity((edge as usize).pow(3));
    for i in 0..edge {
        for j in 0..edge {
            for k in 0..edge {
                let at = [i, j, k].map(|n| (f64::from(n) + 0.5 + 0.5 * jitter(&mut seed)) * h);
                position.push([at[0], at[1], at[2] + 3.0 * DX]);
            }
        }
    }
    let count = position.len();
    Scene {
        name: "kernel".into(),
        gravity: [0.0, 0.0, -9.81],
        dx: DX,
        frame_rate: 60.0,
        cfl: 0.5,
        seed,
        domain: Aabb {
            min: [-100.0; 3],
            max: [100.0; 3],
        },
        objects: vec![Object {
            regions: vec![],
            name: "block".into(),
            material: Material {
                name: "bench".into(),
                law,
                youngs_modulus: 5e5,
                poisson_ratio: 0.3,
                density: 1000.0,
            },
            fidelity: Fidelity::Mpm,
            particles: 0..count,
            gaussians: 0..0,
            world_from_asset: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: [0.3, 0.2, -2.0],
            velocity_gradient: [[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0; 3]],
        }],
        colliders: vec![Collider::fixed(
            "floor",
            ColliderShape::HalfSpace {
                normal: [0.0, 0.0, 1.0],
            },
            Pose::IDENTITY,
            Surface::Slip,
        )],
        pinned_regions: vec![],
        conditions: Conditions::default(),
        particles: RestParticles {
            position,
            volume: vec![h * h * h; count],
        },
        gaussians: Gaussians::default(),
        binding: Binding::default(),
        probes: vec![],
    }
}
