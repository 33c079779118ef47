//! One scene in motion, measured.

use std::time::Instant;

use cosplat_ipc::schema::GaussianState;
use cosplat_server::publish::Output;
use cosplat_sim_core::{Scene, World, report::Timings};
use rayon::ThreadPoolBuilder;

use crate::kernel::on_processor;

/// What a run of a scene came to.
pub struct Measured {
    /// Particle updates.
    pub updates: u64,
    /// Substeps, those taken back left out.
    pub substeps: u64,
    /// Simulated time [s].
    pub simulated: f64,
    /// Wall time of stepping and of writing frames; with one thread, the processor time of it [s].
    pub seconds: f64,
    /// Share of the wall time per phase, in the order of [`Timings::PHASES`]; that of what is published with the frames that are written.
    pub shares: [f64; Timings::PHASES.len()],
    /// Heap allocations per substep; counted with one thread only.
    pub allocations: Option<f64>,
}

/// Runs a scene for `duration` simulated seconds, whole frames, and writes every frame as the server does.
///
/// # Errors
/// When the scene cannot be simulated or no threads can be started.
pub fn run_scene(scene: &Scene, duration: f64, threads: u16) -> anyhow::Result<Measured> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads.into())
        .build()?;
    let mut world = pool.install(|| World::new(scene.clone()))?;
    let output = Output::new(scene);
    let mut slots = vec![GaussianState::default(); scene.gaussians.len()];
    let frame_dt = 1.0 / scene.frame_rate;
    let frames = (duration * scene.frame_rate - 1e-6).ceil().max(1.0) as u64;
    let mut measured = Measured {
        updates: 0,
        substeps: 0,
        simulated: frames as f64 * frame_dt,
        seconds: 0.0,
        shares: [0.0; Timings::PHASES.len()],
        allocations: None,
    };
    let (mut wall, mut allocations) = (0.0, 0);
    for _ in 0..frames {
        let ((report, counted, published), _, share) = on_processor(|| {
            pool.install(|| {
                let mut report = None;
                let info = allocation_counter::measure(|| report = Some(world.step(frame_dt, &[])));
                let publishing = Instant::now();
                output.write_frame(&world, &mut slots);
                (report, info.count_total, publishing.elapsed().as_secs_f64())
            })
        });
        let Some(report) = report else { continue };
        let t = &report.timings;
        let time = t.total + published;
        wall += time;
        // One thread that had to wait for a processor did not need the time.
        measured.seconds += if threads == 1 { time * share } else { time };
        allocations += counted;
        measured.updates += report.particle_updates;
        measured.substeps += u64::from(report.substeps);
        for (sum, time) in measured.shares.iter_mut().zip(t.phases()) {
            *sum += time;
        }
        measured.shares[Timings::PHASES.len() - 1] += published;
    }
    for share in &mut measured.shares {
        *share /= wall;
    }
    // Another thread's allocations are not seen.
    if threads == 1 && measured.substeps > 0 {
        measured.allocations = Some(allocations as f64 / measured.substeps as f64);
    }
    Ok(measured)
}
