//! One scene under several contact methods, side by side: a video, and a sheet of pictures with a row per method.

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use anyhow::{Context, bail};
use cosplat_ipc::schema::GaussianState;
use cosplat_renderer::{
    Camera, Harmonics, Image, camera::up_from_gravity, drawing::BACKGROUND, mp4::Mp4Writer,
    picture, png::write_png,
};
use cosplat_scene::{load::load_text, scene_file::SceneFile, settings};
use cosplat_server::publish::Output;
use cosplat_sim_core::{Interruption, Scene, World};
use glam::Vec3;
use serde::Serialize;

use crate::{
    Progress,
    paper::{PaperScene, orbit},
    run::whole_folder,
};

/// Frames per second of the video.
const VIDEO_RATE: f64 = 30.0;
/// Scenes that publish more often than this are over in no time: their video is slow motion.
const REAL_TIME: f64 = 60.0;

/// White pixels between pictures.
const GAP: u32 = 2;

/// What to compare.
pub struct Comparison<'a> {
    /// The scene.
    pub scene: &'a PaperScene,
    /// The captured splat that it needs, where it does not lie where it is looked for.
    pub splat: Option<&'a Path>,
    /// Contact methods; `own` is the one that the text names.
    pub methods: &'a [String],
    /// Simulated seconds.
    pub duration: f64,
    /// Size of one picture in the video.
    pub size: (u32, u32),
    /// Where the files go.
    pub folder: &'a Path,
}

/// Last line of `cosplat demo --compare --json`.
#[derive(Debug, Serialize)]
pub struct Compared {
    /// Scene name.
    pub scene: &'static str,
    /// Simulated seconds.
    pub sim_seconds: f64,
    /// One entry per method, in the order of the pictures.
    pub methods: Vec<Side>,
    /// All methods side by side.
    pub video: PathBuf,
    /// A row per method, moments from left to right.
    pub sheet: PathBuf,
    /// Moments of the sheet [s].
    pub moments: Vec<f64>,
}

/// What one method came to.
#[derive(Debug, Serialize)]
pub struct Side {
    /// Contact method as asked for.
    pub method: String,
    /// Wall seconds in the solver.
    pub wall_seconds: f64,
    /// Substeps.
    pub substeps: u64,
    /// Particle-substeps executed.
    pub particle_updates: u64,
    /// Kinetic and elastic energy at the start and at the end [J].
    pub energy: [f64; 2],
    /// Total linear momentum at the start and at the end [kg m/s].
    pub linear_momentum: [[f64; 3]; 2],
    /// Total angular momentum about the origin at the start and at the end [kg m^2/s].
    pub angular_momentum: [[f64; 3]; 2],
    /// Objects: name, first and last velocity of the centre of mass [m/s].
    pub objects: Vec<(String, [f64; 3], [f64; 3])>,
    /// State hash of the last frame.
    pub state_hash: String,
}

struct Run {
    world: World,
    output: Output,
    slots: Vec<GaussianState>,
    camera: Camera,
    side: Side,
}

impl Comparison<'_> {
    /// Simulates and draws.
    ///
    /// # Errors
    /// When the scene cannot be used, a file cannot be written, or `stop` is set.
    pub fn run(&self, stop: &AtomicBool, progress: &Progress) -> anyhow::Result<Compared> {
        let folder = whole_folder(self.folder)?;
        let text = self.scene.text(self.splat)?;
        let starts = self
            .methods
            .iter()
            .map(|method| self.start(&text, &folder, method));
        let mut runs = starts.collect::<Result<Vec<_>, _>>()?;
        let first = runs.first().context("no method to compare")?;
        let rate = first.world.scene().frame_rate;
        let frames = (self.duration * rate - 1e-6).ceil().max(1.0) as u64;
        let every = (rate.min(REAL_TIME) / VIDEO_RATE).round().max(1.0) as u64;
        let every = if rate > REAL_TIME { 1 } else { every };
        let moments = self
            .scene
            .view
            .moments
            .map(|part| (part * frames as f64).round() as u64);
        let video = folder.join("compare.mp4");
        let sheet = folder.join("compare.png");
        let count = runs.len() as u32;
        let width = count * self.size.0 + (count - 1) * GAP;
        let mut writer = Mp4Writer::create(&video, width, self.size.1, VIDEO_RATE)?;
        let mut rows: Vec<Vec<Image>> = vec![Vec::new(); runs.len()];
        for frame in 0..=frames {
            if stop.load(Ordering::Relaxed) {
                bail!("interrupted");
            }
            let shown = moments.iter().filter(|&&m| m == frame).count();
            if frame % every == 0 || shown > 0 {
                let images: Vec<Image> = runs.iter_mut().map(Run::draw).collect();
                for (row, image) in rows.iter_mut().zip(&images) {
                    row.extend(std::iter::repeat_n(image, shown).map(Image::halved));
                }
                if frame % every == 0 {
                    writer.add(&Image::mosaic(&[images], GAP))?;
                }
            }
            if frame < frames {
                for run in &mut runs {
                    run.step(1.0 / rate, stop)?;
                }
            }
            progress("frames", frame, frames, "");
        }
        writer.finish()?;
        write_png(&sheet, &Image::mosaic(&rows, GAP))?;
        Ok(Compared {
            scene: self.scene.name,
            sim_seconds: frames as f64 / rate,
            methods: runs.into_iter().map(Run::finish).collect(),
            video,
            sheet,
            moments: moments.iter().map(|&m| m as f64 / rate).collect(),
        })
    }

    fn start(&self, text: &str, folder: &Path, method: &str) -> anyhow::Result<Run> {
        // Methods are of the grid that objects share.
        let objects = 0..SceneFile::parse(text)?.objects.len();
        let mut settings: Vec<String> = objects
            .map(|n| format!("objects.{n}.solver=spatial"))
            .collect();
        if method != "own" {
            settings.push(format!("contact={method}"));
        }
        let text = settings::apply(text, &settings)?;
        let path = folder.join(format!("scene_{method}.toml"));
        cosplat_files::write(&path, &text)
            .with_context(|| format!("cannot write {}", path.display()))?;
        let scene: Scene = load_text(text, &path)?.scene;
        let up = match scene.gravity {
            [0.0, 0.0, 0.0] => Vec3::Y,
            gravity => up_from_gravity(gravity),
        };
        // Target and distance are given: the box does not matter.
        let everything = [Vec3::splat(-1.0), Vec3::ONE];
        let camera = Camera::orbit(
            everything,
            up,
            orbit(&self.scene.view),
            self.size.0,
            self.size.1,
        );
        let output = Output::new(&scene);
        let slots = vec![GaussianState::default(); scene.gaussians.len()];
        let world = World::new(scene)?;
        let report = world.report();
        let side = Side {
            method: method.to_owned(),
            wall_seconds: 0.0,
            substeps: 0,
            particle_updates: 0,
            energy: [report.kinetic_energy + report.elastic_energy; 2],
            linear_momentum: [report.linear_momentum; 2],
            angular_momentum: [report.angular_momentum; 2],
            objects: named_velocities(&world),
            state_hash: String::new(),
        };
        Ok(Run {
            world,
            output,
            slots,
            camera,
            side,
        })
    }
}

fn named_velocities(world: &World) -> Vec<(String, [f64; 3], [f64; 3])> {
    let states = &world.report().objects;
    let moving = world.scene().objects.iter().zip(states);
    moving
        .filter(|(_, state)| state.mass > 0.0)
        .map(|(object, state)| (object.name.clone(), state.linear_velocity, [0.0; 3]))
        .collect()
}

impl Run {
    fn step(&mut self, frame_dt: f64, stop: &AtomicBool) -> anyhow::Result<()> {
        let start = Instant::now();
        let asks = || stop.load(Ordering::Relaxed);
        let interruption = Interruption::when(&asks);
        let report = self.world.step_unless(&interruption, frame_dt, &[]);
        let report = report.context("interrupted")?;
        self.side.wall_seconds += start.elapsed().as_secs_f64();
        self.side.substeps += u64::from(report.substeps);
        self.side.particle_updates += report.particle_updates;
        self.side.energy[1] = report.kinetic_energy + report.elastic_energy;
        self.side.linear_momentum[1] = report.linear_momentum;
        self.side.angular_momentum[1] = report.angular_momentum;
        Ok(())
    }

    fn draw(&mut self) -> Image {
        self.output.write_frame(&self.world, &mut self.slots);
        let gaussians = &self.world.scene().gaussians;
        let sh = match gaussians.sh_degree {
            0 => None,
            degree => Harmonics::new(degree.into(), &gaussians.sh),
        };
        picture(&self.slots, sh, &self.camera, BACKGROUND)
    }

    fn finish(mut self) -> Side {
        let last = named_velocities(&self.world);
        for (object, (_, velocity, _)) in self.side.objects.iter_mut().zip(last) {
            object.2 = velocity;
        }
        self.side.state_hash = format!("{:016x}", self.world.report().state_hash);
        self.side
    }
}

impl Compared {
    /// The same for people.
    pub fn sentence(&self) -> String {
        let mut text = format!("{}: {:.3} s simulated\n", self.scene, self.sim_seconds);
        for side in &self.methods {
            text.push_str(&format!(
                "{:>12}: {:.1} s, {} substeps, {:.1} million particle updates, energy {:.4} -> {:.4} J, state {}\n",
                side.method,
                side.wall_seconds,
                side.substeps,
                side.particle_updates as f64 / 1e6,
                side.energy[0],
                side.energy[1],
                side.state_hash,
            ));
            for (name, before, after) in &side.objects {
                let shown = |v: &[f64; 3]| v.map(|x| format!("{x:.3}")).join(" ");
                text.push_str(&format!(
                    "{:>14}{name}: {} -> {} m/s\n",
                    "",
                    shown(before),
                    shown(after)
                ));
            }
        }
        text + &format!(
            "video {}\nsheet {}",
            self.video.display(),
            self.sheet.display()
        )
    }
}
