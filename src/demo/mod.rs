//! `cosplat demo`: the main job in one go, as four processes.

mod children;
mod compare;
mod outcome;
mod paper;
mod scene;

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use anyhow::{Context, bail};
use cosplat_ipc::{
    Domain,
    client::{Client, StatusReader},
    schema::SERVER_STOPPING,
};
use cosplat_scene::scene_file::View;

use self::{
    children::Process,
    compare::Comparison,
    outcome::{Controlled, Outcome, Recorded, Served, Viewed},
};
use crate::{progress, say, seconds, signals};

/// Simulate, record, render and push a scene, each in a process of its own.
#[derive(clap::Args)]
pub struct Args {
    /// Splat to drop onto a floor and push (.ply or .splat); without it, two vases on a table. With a --scene that
    /// shows a capture, the file of that capture.
    #[arg(long, value_name = "FILE")]
    splat: Option<PathBuf>,
    /// A scene of the paper, or one on a real capture.
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(paper::names()))]
    scene: Option<String>,
    /// Instead of the four processes: the scene under several contact methods side by side, in one video and one
    /// sheet of pictures. `own` is the method that the scene names.
    #[arg(
        long,
        value_name = "METHODS",
        requires = "scene",
        num_args = 0..=1,
        require_equals = true,
        value_delimiter = ',',
        default_missing_value = "single_field,own"
    )]
    compare: Option<Vec<String>>,
    /// Up axis of the splat: +x -x +y -y +z -z.
    #[arg(
        long,
        value_name = "AXIS",
        allow_hyphen_values = true,
        requires = "splat",
        conflicts_with = "scene"
    )]
    up: Option<String>,
    /// Folder for the scene, recording, picture and video.
    #[arg(long, value_name = "DIR", default_value = "cosplat-demo")]
    out: PathBuf,
    /// Simulated seconds [default: 4, or what the --scene needs].
    #[arg(long, value_name = "S", value_parser = seconds::number)]
    duration: Option<f64>,
    /// Simulate as fast as possible instead of in real time.
    #[arg(long)]
    free: bool,
    /// Size of picture and video.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = crate::view::size)]
    size: (u32, u32),
    /// Print one JSON object as the last line.
    #[arg(long)]
    json: bool,
}

/// Simulated seconds where nothing else is said.
const DURATION: f64 = 4.0;
/// How long the processes may take to find each other, loading and filling included.
const ATTACH_TIMEOUT: Duration = Duration::from_secs(120);
/// How long the clients may take to finish their files after the last frame.
const FINISH_TIMEOUT: Duration = Duration::from_secs(120);
/// A run that makes no step for so long is called stuck.
const STUCK_TIMEOUT: Duration = Duration::from_secs(60);
/// How often the demo looks at its processes.
const LOOK: Duration = Duration::from_millis(50);

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let known = args.scene.as_deref().map(paper::find).transpose()?;
    let usual = known.as_ref().map_or(DURATION, |scene| scene.view.duration);
    let duration = args.duration.unwrap_or(usual);
    anyhow::ensure!(
        duration > 0.0,
        "--duration is 0, expected more: nothing would be seen"
    );
    let stop = signals::stop_flag()?;
    let files = Files::create(&args.out)?;
    if let (Some(scene), Some(methods)) = (&known, &args.compare) {
        let compared = Comparison {
            scene,
            text: scene.text(args.splat.as_deref())?,
            methods,
            duration,
            size: args.size,
            folder: &files.folder,
        }
        .run(&stop)?;
        match args.json {
            true => say!("{}", serde_json::to_string(&compared)?)?,
            false => say!("{}", compared.sentence())?,
        }
        return Ok(());
    }
    let view = match &known {
        Some(scene) => {
            scene::write_known(&files, &scene.text(args.splat.as_deref())?)?;
            Some(scene.view)
        }
        None => scene::write(&files, args.splat.as_deref(), args.up.as_deref())?,
    };
    let outcome = Demo {
        domain: Domain::from_env().context("cannot use the session folder")?,
        session: format!("demo-{}", std::process::id()),
        files: &files,
        args,
        view,
        duration,
        stop: &stop,
    }
    .run()?;
    if args.json {
        say!("{}", serde_json::to_string(&outcome)?)?;
    } else {
        say!("{}", outcome.sentence())?;
    }
    Ok(())
}

/// Where everything goes.
struct Files {
    folder: PathBuf,
    scene: PathBuf,
    script: PathBuf,
    recording: PathBuf,
    frames: PathBuf,
    picture: PathBuf,
    video: PathBuf,
}

impl Files {
    fn create(folder: &Path) -> anyhow::Result<Files> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let folder = folder
            .canonicalize()
            .with_context(|| format!("cannot find {}", folder.display()))?;
        Ok(Files {
            scene: folder.join("scene.toml"),
            script: folder.join("push.toml"),
            recording: folder.join("run.mcap"),
            frames: folder.join("frames"),
            picture: folder.join("picture.png"),
            video: folder.join("run.mp4"),
            folder,
        })
    }
}

struct Demo<'a> {
    domain: Domain,
    session: String,
    files: &'a Files,
    args: &'a Args,
    view: Option<View>,
    duration: f64,
    stop: &'a AtomicBool,
}

impl Demo<'_> {
    fn run(&self) -> anyhow::Result<Outcome> {
        self.remove_former()?;
        let mut server = self.start_server()?;
        let client = self.attach(&mut server)?;
        let mut status = client.status()?;
        let mut recorder = self.start("recorder", &self.recorder_arguments()?)?;
        let arguments = self.renderer_arguments()?;
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let mut renderer = self.start("renderer", &arguments)?;
        self.wait_for_readers(
            &mut status,
            2,
            &mut [&mut server, &mut recorder, &mut renderer],
        )?;
        let mut controller = self.start(
            "controller",
            &[
                "ctl",
                "--session",
                &self.session,
                "--json",
                "script",
                text(&self.files.script)?,
            ],
        )?;
        self.watch(
            &mut status,
            &mut [&mut server, &mut recorder, &mut renderer, &mut controller],
        )?;
        let served: Served = server.result(FINISH_TIMEOUT)?;
        let controlled: Controlled = controller.result(FINISH_TIMEOUT)?;
        let recorded: Recorded = recorder.result(FINISH_TIMEOUT)?;
        let viewed: Viewed = renderer.result(FINISH_TIMEOUT)?;
        self.choose_picture()?;
        Ok(Outcome {
            session: self.session.clone(),
            gaussians: served.gaussians,
            particles: served.particles,
            objects: served.objects,
            frames_published: served.frames_published,
            frames_recorded: recorded.frames_recorded,
            frames_dropped: (served.steps + 1).saturating_sub(recorded.frames_recorded),
            frames_rendered: viewed.frames_rendered,
            sim_seconds: served.sim_seconds,
            wall_seconds: served.wall_seconds,
            real_time_factor: served.real_time_factor,
            latency_us: recorded.latency_us,
            commands_acknowledged: controlled.acknowledged,
            recording: self.files.recording.clone(),
            picture: self.files.picture.clone(),
            video: self.files.video.clone(),
            state_hash: served.state_hash,
        })
    }

    fn start(&self, role: &'static str, arguments: &[&str]) -> anyhow::Result<Process> {
        Process::start(role, &self.files.folder, arguments)
    }

    fn start_server(&self) -> anyhow::Result<Process> {
        let duration = self.duration.to_string();
        let pace = if self.args.free { "free" } else { "realtime" };
        let scene = text(&self.files.scene)?;
        self.start(
            "server",
            &[
                "serve",
                scene,
                "--session",
                &self.session,
                "--pace",
                pace,
                "--duration",
                &duration,
                "--paused",
                "--json",
            ],
        )
    }

    fn recorder_arguments(&self) -> anyhow::Result<[&str; 7]> {
        let recording = text(&self.files.recording)?;
        Ok([
            "record",
            "--session",
            &self.session,
            "-o",
            recording,
            "--force",
            "--json",
        ])
    }

    fn renderer_arguments(&self) -> anyhow::Result<Vec<String>> {
        let (width, height) = self.args.size;
        let mut arguments: Vec<String> = [
            "view",
            "--session",
            &self.session,
            "--size",
            &format!("{width}x{height}"),
            "--mp4",
            text(&self.files.video)?,
            "--png",
            text(&self.files.frames)?,
            "--every",
            "10",
            "--json",
        ]
        .map(str::to_owned)
        .to_vec();
        arguments.extend(self.view.iter().flat_map(paper::view_arguments));
        Ok(arguments)
    }

    /// Waits until the server answers, while it loads and fills the scene.
    fn attach(&self, server: &mut Process) -> anyhow::Result<Client> {
        let waiting = progress::spinner("loading the scene");
        let deadline = Instant::now() + ATTACH_TIMEOUT;
        loop {
            self.look(&mut [server])?;
            match Client::connect(&self.domain, &self.session, "demo", LOOK) {
                Ok(client) => {
                    waiting.finish_and_clear();
                    return Ok(client);
                }
                Err(error) if Instant::now() > deadline => return Err(error.into()),
                Err(_) => waiting.tick(),
            }
        }
    }

    /// Removes what tells how far recorder and renderer are, where an earlier demo left it.
    fn remove_former(&self) -> anyhow::Result<()> {
        let mut former = self.pictures();
        former.extend(Some(self.files.recording.clone()).filter(|path| path.exists()));
        for path in former {
            std::fs::remove_file(&path)
                .with_context(|| format!("cannot remove {}", path.display()))?;
        }
        Ok(())
    }

    /// Pictures that the renderer has left so far, the earliest step first.
    fn pictures(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(&self.files.frames).into_iter().flatten();
        let mut pictures: Vec<_> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.extension().is_some_and(|e| e == "png"))
            .collect();
        pictures.sort();
        pictures
    }

    /// Waits until recorder and renderer read frames and have the scene, so that neither misses anything: both begin to write
    /// only then.
    fn wait_for_readers(
        &self,
        status: &mut StatusReader,
        readers: u32,
        processes: &mut [&mut Process],
    ) -> anyhow::Result<()> {
        let deadline = Instant::now() + ATTACH_TIMEOUT;
        loop {
            self.look(processes)?;
            let attached = status.next(LOOK)?.map_or(0, |s| s.frame_readers);
            let begun = self.files.recording.exists() && !self.pictures().is_empty();
            if attached >= readers && begun {
                return Ok(());
            }
            if Instant::now() > deadline {
                bail!(
                    "{attached} of {readers} readers attached within {ATTACH_TIMEOUT:?}{}",
                    if begun {
                        ""
                    } else {
                        ", and not all have begun"
                    }
                );
            }
        }
    }

    /// Shows progress until the server stops.
    fn watch(
        &self,
        status: &mut StatusReader,
        processes: &mut [&mut Process],
    ) -> anyhow::Result<()> {
        let milliseconds = |seconds: f64| (seconds * 1e3).round() as u64;
        let bar = progress::bar("simulated ms", milliseconds(self.duration));
        let (mut step, mut moved) = (0, Instant::now());
        while self.look(processes)? {
            let Some(newest) = status.next(LOOK)? else {
                continue;
            };
            bar.set_position(milliseconds(newest.sim_time));
            bar.set_message(format!("{:.2} x real time", newest.real_time_factor));
            if newest.server_state == SERVER_STOPPING {
                break;
            }
            if newest.step != step {
                (step, moved) = (newest.step, Instant::now());
            } else if moved.elapsed() > STUCK_TIMEOUT {
                bail!(
                    "no step for {STUCK_TIMEOUT:?}; see the logs in {}",
                    self.files.folder.display()
                );
            }
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Fails when a process failed or the user interrupts; says whether the first process, the server, is
    /// still running.
    fn look(&self, processes: &mut [&mut Process]) -> anyhow::Result<bool> {
        if self.stop.load(Ordering::Relaxed) {
            bail!("interrupted");
        }
        let mut running = Vec::with_capacity(processes.len());
        for process in processes {
            running.push(process.check()?);
        }
        Ok(running[0])
    }

    /// Keeps the picture from the middle of the run.
    fn choose_picture(&self) -> anyhow::Result<()> {
        let pictures = self.pictures();
        let middle = pictures.get(pictures.len() / 2).with_context(|| {
            let frames = self.files.frames.display();
            format!("the renderer left no picture in {frames}")
        })?;
        std::fs::copy(middle, &self.files.picture)
            .with_context(|| format!("cannot write {}", self.files.picture.display()))?;
        Ok(())
    }
}

/// A path as an argument.
fn text(path: &Path) -> anyhow::Result<&str> {
    path.to_str()
        .with_context(|| format!("{} is not UTF-8, choose another folder", path.display()))
}
