//! The four processes of a demo, from the first start to the last file.

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use anyhow::{Context, bail};
use cosplat_export::{
    film,
    reel::{Reel, Steps},
};
use cosplat_ipc::{
    Domain,
    client::{Client, StatusReader},
    schema::SERVER_STOPPING,
};
use cosplat_renderer::drawing::{Look, Summary};
use cosplat_scene::scene_file::View;

use crate::{
    Progress,
    children::Process,
    outcome::{Controlled, Outcome, Recorded, Served, Viewed},
    paper::{self, PaperScene},
    scene,
};

/// How long the processes may take to find each other, loading and filling included.
const ATTACH_TIMEOUT: Duration = Duration::from_secs(120);
/// How long the clients may take to finish their files after the last frame.
const FINISH_TIMEOUT: Duration = Duration::from_secs(120);
/// A run that makes no step for so long is called stuck.
const STUCK_TIMEOUT: Duration = Duration::from_secs(60);
/// How often the demo looks at its processes.
const LOOK: Duration = Duration::from_millis(50);

/// What to show, and how.
pub struct Options<'a> {
    /// A scene that is known by name; without it, `splat` dropped onto a floor, or two vases on a table.
    pub scene: Option<&'a PaperScene>,
    /// A splat of the user's own.
    pub splat: Option<&'a Path>,
    /// Its up axis: +x -x +y -y +z -z.
    pub up: Option<&'a str>,
    /// Folder for the scene, recording, picture and video.
    pub folder: &'a Path,
    /// Simulated seconds, more than 0.
    pub duration: f64,
    /// As fast as possible instead of in real time.
    pub free: bool,
    /// Size of picture and video [pixels].
    pub size: (u32, u32),
}

/// Simulates, records, renders and pushes a scene, each in a process of its own.
///
/// # Errors
/// When the scene cannot be used, a process fails or makes no step for a minute, or `stop` is set.
pub fn run(options: &Options, stop: &AtomicBool, progress: &Progress) -> anyhow::Result<Outcome> {
    Demo::prepare(options, stop, progress)?.run()
}

/// Shows a scene in the browser until `stop`, whatever `options` say of duration, pace and size: `tell` is given the link of the
/// page. The simulation begins when the page is opened, with the pushes of the demo.
///
/// # Errors
/// When the scene cannot be used, a process fails, or `tell` does.
pub fn show(
    options: &Options,
    stop: &AtomicBool,
    progress: &Progress,
    tell: impl FnOnce(&str) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    Demo::prepare(options, stop, progress)?.show(tell)
}

/// Where everything goes.
pub(crate) struct Files {
    folder: PathBuf,
    pub(crate) scene: PathBuf,
    pub(crate) script: PathBuf,
    recording: PathBuf,
    frames: PathBuf,
    picture: PathBuf,
    video: PathBuf,
}

impl Files {
    fn create(folder: &Path) -> anyhow::Result<Files> {
        let folder = whole_folder(folder)?;
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

/// Makes the folder where it is missing; its whole path.
pub(crate) fn whole_folder(folder: &Path) -> anyhow::Result<PathBuf> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    folder
        .canonicalize()
        .with_context(|| format!("cannot find {}", folder.display()))
}

struct Demo<'a> {
    domain: Domain,
    session: String,
    files: Files,
    options: &'a Options<'a>,
    view: Option<View>,
    stop: &'a AtomicBool,
    progress: &'a Progress<'a>,
}

impl<'a> Demo<'a> {
    /// Writes the scene and the script of its pushes.
    fn prepare(
        options: &'a Options<'a>,
        stop: &'a AtomicBool,
        progress: &'a Progress<'a>,
    ) -> anyhow::Result<Self> {
        let files = Files::create(options.folder)?;
        let view = match options.scene {
            Some(known) => {
                scene::write_known(&files, &known.text(options.splat)?)?;
                Some(known.view)
            }
            None => scene::write(&files, options.splat, options.up)?,
        };
        Ok(Demo {
            domain: Domain::from_env().context("cannot use the session folder")?,
            session: format!("demo-{}", std::process::id()),
            files,
            options,
            view,
            stop,
            progress,
        })
    }

    fn show(&self, tell: impl FnOnce(&str) -> anyhow::Result<()>) -> anyhow::Result<()> {
        let mut server = self.start_server(&[])?;
        let client = self.attach(&mut server)?;
        let mut status = client.status()?;
        let arguments = ["view", "--web", "--session", &self.session];
        let mut page = self.start("page", &arguments)?;
        tell(&page.first_line()?)?;
        let script = text(&self.files.script)?;
        let mut controller: Option<Process> = None;
        while !self.stop.load(Ordering::Relaxed) && server.check()? && page.check()? {
            let readers = status.next(LOOK)?.map_or(0, |status| status.frame_readers);
            match &mut controller {
                Some(controller) => {
                    controller.check()?;
                }
                None if readers > 0 => {
                    let arguments = ["ctl", "--session", &self.session, "script", script];
                    controller = Some(self.start("controller", &arguments)?);
                }
                None => {}
            }
        }
        Ok(())
    }

    fn run(&self) -> anyhow::Result<Outcome> {
        self.remove_former()?;
        let duration = self.options.duration.to_string();
        let mut server = self.start_server(&["--duration", &duration])?;
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
        let film = self.draw_film()?;
        Ok(Outcome {
            session: self.session.clone(),
            gaussians: served.gaussians,
            particles: served.particles,
            objects: served.objects,
            frames_published: served.frames_published,
            frames_recorded: recorded.frames_recorded,
            frames_dropped: (served.steps + 1).saturating_sub(recorded.frames_recorded),
            frames_rendered: viewed.frames_rendered,
            video_frames: film.video_frames,
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

    fn start_server(&self, more: &[&str]) -> anyhow::Result<Process> {
        let pace = match self.options.free {
            true => "free",
            false => "realtime",
        };
        let scene = text(&self.files.scene)?;
        let mut arguments = vec!["serve", scene, "--session", &self.session, "--pace", pace];
        arguments.extend(["--paused", "--json"]);
        arguments.extend(more);
        self.start("server", &arguments)
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
        let (width, height) = self.options.size;
        let mut arguments: Vec<String> = [
            "view",
            "--session",
            &self.session,
            "--size",
            &format!("{width}x{height}"),
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
        let deadline = Instant::now() + ATTACH_TIMEOUT;
        loop {
            self.look(&mut [server])?;
            match Client::connect(&self.domain, &self.session, "demo", LOOK) {
                Ok(client) => return Ok(client),
                Err(error) if Instant::now() > deadline => return Err(error.into()),
                Err(_) => (self.progress)("loading the scene", 0, 0, ""),
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
        let whole = milliseconds(self.options.duration);
        let (mut step, mut moved) = (0, Instant::now());
        while self.look(processes)? {
            let Some(newest) = status.next(LOOK)? else {
                continue;
            };
            let pace = format!("{:.2} x real time", newest.real_time_factor);
            (self.progress)("simulated ms", milliseconds(newest.sim_time), whole, &pace);
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

    /// Draws the video from the recording: beside the run there is no time for all of it.
    fn draw_film(&self) -> anyhow::Result<Summary> {
        let looked =
            |done, chunks| (self.progress)("looking through", done as u64, chunks as u64, "");
        let mut reel = Reel::open(&self.files.recording, None, Steps::Every(1), looked)?;
        let look = Look {
            width: self.options.size.0,
            height: self.options.size.1,
            orbit: self.view.as_ref().map(paper::orbit).unwrap_or_default(),
            turning: 0.0,
            follow: None,
            path: None,
            is_shaded: false,
            png: None,
            every: 1,
            mp4: Some(self.files.video.clone()),
            fps: reel.scene.frame_rate,
        };
        let (mut done, frames) = (0, reel.count() as u64);
        Ok(film::draw(&mut reel, &look, self.stop, |step| {
            done += 1;
            (self.progress)("video frames", done, frames, &format!("step {step}"));
        })?)
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
