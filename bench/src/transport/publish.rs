//! What publishing a step costs by how much of the scene moves: half a million Gaussians, all awake or a tenth of them.

use std::time::Duration;

use anyhow::Context;
use cosplat_console::say;
use cosplat_ipc::{
    Client, Domain, ServerPorts,
    client::ChangesReader,
    schema::{ChangesHeader, FrameHeader},
    server::{ChangesReaders, PoolPlan},
};
use cosplat_server::{changes::Told, gaussians::GaussianWriter};
use cosplat_sim_core::{
    Scene, World,
    materials::{Law, Material},
    scene::{BINDING_NEIGHBORS, Fidelity, Object},
};
use rayon::ThreadPoolBuilder;
use serde::Serialize;

use crate::{kernel::on_processor, quantiles::Quantiles};

const OBJECTS: usize = 10;
/// Gaussians of an object.
const GAUSSIANS: usize = 50_000;
/// Particles along the edge of an object.
const EDGE: usize = 12;
/// Frames until what may sleep does, and every slot of the pool was written.
const SETTLING: usize = 40;
/// Slots of the pool.
const SLOTS: usize = 8;
const PATIENCE: Duration = Duration::from_secs(20);

/// Processor time of publishing a step, with a reader of `changes` [us].
#[derive(Clone, Copy, Serialize)]
pub struct PublishReport {
    gaussians: usize,
    /// The whole `frame`, with all awake.
    frame_all_us: f64,
    /// With a tenth awake.
    frame_tenth_us: f64,
    frame_ratio: f64,
    /// The message of `changes`, with all awake.
    changes_all_us: f64,
    /// With a tenth awake.
    changes_tenth_us: f64,
    changes_ratio: f64,
    /// Bytes of the messages of `changes`.
    changes_all_bytes: usize,
    changes_tenth_bytes: usize,
}

impl PublishReport {
    /// Prints both lines.
    pub fn print(&self) -> anyhow::Result<()> {
        say!(
            "publishing {} Gaussians, processor time by what moves [us]",
            self.gaussians
        )?;
        for (what, all, tenth, ratio) in [
            (
                "frame",
                self.frame_all_us,
                self.frame_tenth_us,
                self.frame_ratio,
            ),
            (
                "changes",
                self.changes_all_us,
                self.changes_tenth_us,
                self.changes_ratio,
            ),
        ] {
            say!("{what:>8}: all {all:.0}, a tenth {tenth:.0}, ratio {ratio:.3}")?;
        }
        Ok(())
    }
}

/// Boxes at rest where nothing pulls: those that may sleep do so after a quarter of a second.
fn scene(awake: usize) -> Scene {
    let mut scene = Scene::empty("publish", 0.05);
    let material = Material {
        name: "soft".into(),
        law: Law::NeoHookean,
        youngs_modulus: 3e4,
        poisson_ratio: 0.3,
        density: 1000.0,
        loss: 0.0,
    };
    let (h, count) = (0.025, EDGE.pow(3));
    for object in 0..OBJECTS {
        let (first, begin) = (object * count, object * GAUSSIANS);
        for n in 0..count {
            let lattice = [n / (EDGE * EDGE), n / EDGE % EDGE, n % EDGE];
            let mut x = lattice.map(|i| (i as f64 + 0.5) * h);
            x[0] += object as f64;
            scene.particles.position.push(x);
            scene.particles.volume.push(h * h * h);
        }
        for g in 0..GAUSSIANS {
            // Eight that follow one another in memory stand for eight neighbours.
            let p = first + g * (count - BINDING_NEIGHBORS) / GAUSSIANS;
            let x = scene.particles.position[p].map(|x| x as f32);
            scene.gaussians.position.push(x);
            scene.gaussians.scale.push([0.01; 3]);
            scene.gaussians.rotation.push([0.0, 0.0, 0.0, 1.0]);
            scene.gaussians.opacity.push(0.5);
            scene.gaussians.sh.extend([0.5; 3]);
            let near = std::array::from_fn(|n| (p + n) as u32);
            scene.binding.particle.push(near);
            let even = 1.0 / BINDING_NEIGHBORS as f32;
            scene.binding.weight.push([even; BINDING_NEIGHBORS]);
        }
        scene.objects.push(Object {
            gaussians: begin..begin + GAUSSIANS,
            fidelity: match object < awake {
                true => Fidelity::Mpm,
                false => Fidelity::Auto,
            },
            ..Object::new(
                format!("box{object}"),
                material.clone(),
                first..first + count,
            )
        });
    }
    scene
}

/// A world and all that publishes it.
struct Session {
    world: World,
    writer: GaussianWriter,
    told: Told,
    ports: ServerPorts,
    reader: ChangesReader,
    frame: Vec<f64>,
    changes: Vec<f64>,
    bytes: usize,
}

impl Session {
    fn new(domain: &Domain, name: &str, awake: usize) -> anyhow::Result<Self> {
        let scene = scene(awake);
        let plan = PoolPlan {
            gaussian_count: scene.gaussians.len(),
            object_count: OBJECTS,
            frame_slots: Some(SLOTS),
            ..PoolPlan::default()
        };
        let ports = ServerPorts::create(domain, name, &plan)?;
        let client = Client::connect(domain, name, "bench", PATIENCE)?;
        Ok(Self {
            writer: GaussianWriter::new(&scene),
            world: World::new(scene)?,
            told: Told::default(),
            reader: client.changes(2)?,
            ports,
            frame: vec![],
            changes: vec![],
            bytes: 0,
        })
    }

    /// Makes a step and publishes it as the server does.
    fn step(&mut self) -> anyhow::Result<()> {
        self.world.step(1.0 / 60.0, &[]);
        let step = self.world.report().step;
        let (world, writer) = (&self.world, &mut self.writer);
        let (loan, seconds, _) = on_processor(|| -> anyhow::Result<_> {
            writer.prepare(world);
            let mut loan = self.ports.loan_frame(OBJECTS * GAUSSIANS)?;
            writer.update(world, loan.slot(), loan.gaussians_mut());
            Ok(loan)
        });
        let mut loan = loan?;
        self.frame.push(seconds * 1e6);
        if self.ports.changes_readers() == ChangesReaders::New {
            self.told.forget();
        }
        let (told, frame) = (&mut self.told, &*loan.gaussians_mut());
        let (bytes, seconds, _) = on_processor(|| -> anyhow::Result<_> {
            let plan = told.plan(world, writer);
            let mut message = self.ports.loan_changes(plan.rows.len(), plan.gaussians)?;
            let (rows, gaussians) = message.parts_mut();
            rows.copy_from_slice(&plan.rows);
            plan.write(world, writer, Some(frame), gaussians);
            let bytes = size_of_val(rows) + size_of_val(gaussians);
            let header = ChangesHeader {
                step,
                since: plan.since,
                gaussians: (OBJECTS * GAUSSIANS) as u32,
                ..ChangesHeader::default()
            };
            self.ports.send_changes(message, &header, false)?;
            told.sent(world);
            Ok(bytes)
        });
        self.bytes = bytes?;
        self.changes.push(seconds * 1e6);
        loan.send(&FrameHeader {
            step,
            ..FrameHeader::default()
        })?;
        let taken = self.reader.next(PATIENCE)?;
        taken.context("no changes came")?;
        Ok(())
    }
}

/// Measures.
///
/// # Errors
/// When shared memory is short, or the scene cannot be simulated.
pub fn measure(rounds: usize) -> anyhow::Result<PublishReport> {
    let domain = Domain::named(&format!("bpub{}", std::process::id()))?;
    // On one thread processor time is the time of the work.
    let pool = ThreadPoolBuilder::new().num_threads(1).build()?;
    let outcome = pool.install(|| -> anyhow::Result<_> {
        let mut all = Session::new(&domain, "all", OBJECTS)?;
        let mut tenth = Session::new(&domain, "tenth", OBJECTS / 10)?;
        for round in 0..SETTLING + rounds {
            if round == SETTLING {
                for session in [&mut all, &mut tenth] {
                    session.frame.clear();
                    session.changes.clear();
                }
            }
            // By turns, so that both meet the same load.
            all.step()?;
            tenth.step()?;
        }
        let median = |us: &[f64]| Quantiles::of(us.to_vec()).p50;
        let [frame_all_us, frame_tenth_us] = [&all, &tenth].map(|s| median(&s.frame));
        let [changes_all_us, changes_tenth_us] = [&all, &tenth].map(|s| median(&s.changes));
        Ok(PublishReport {
            gaussians: OBJECTS * GAUSSIANS,
            frame_all_us,
            frame_tenth_us,
            frame_ratio: frame_tenth_us / frame_all_us,
            changes_all_us,
            changes_tenth_us,
            changes_ratio: changes_tenth_us / changes_all_us,
            changes_all_bytes: all.bytes,
            changes_tenth_bytes: tenth.bytes,
        })
    });
    domain.discard();
    outcome
}
