//! The renderer against a server that the test plays: scene and frames over shared memory, files out.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, where a panic is the message"
)]

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use cosplat_ipc::schema::{
    FRAME_FLAG_LAST, FrameHeader, GaussianRest, GaussianState, ObjectInfo, SceneHeader,
};
use cosplat_ipc::server::{PoolPlan, SceneBlocks};
use cosplat_ipc::{Domain, ServerPorts};
use cosplat_renderer::camera::Orbit;
use cosplat_renderer::client::{Options, Progress, RenderError};
use cosplat_renderer::drawing::{BACKGROUND, Look, Summary};
use cosplat_renderer::{Harmonics, Image, picture, run};
use glam::Vec3;

/// Long enough for a loaded machine; only a hang reaches it.
const PATIENCE: Duration = Duration::from_secs(30);
const COUNT: usize = 60;

/// A domain that no other test uses; its files go with it.
struct TestDomain(Domain);

impl TestDomain {
    fn new(name: &str) -> Self {
        // Files in shared memory have one name space: a prefix of its own lets a test clear away its own files only.
        let name = format!("cpr{}_{name}_", std::process::id());
        Self(Domain::new(format!("/tmp/{name}"), &name).unwrap())
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.0.root());
        for file in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if file
                .file_name()
                .to_string_lossy()
                .starts_with(self.0.prefix())
            {
                let _ = std::fs::remove_file(file.path());
            }
        }
    }
}

fn header(sh_degree: u32) -> SceneHeader {
    SceneHeader {
        frame_rate: 60.0,
        gravity: [0.0, -9.81, 0.0],
        bounds_min: [-1.0; 3],
        bounds_max: [1.0; 3],
        sh_degree,
        ..SceneHeader::default()
    }
}

/// Coefficients of the test scene: `tint` tells scenes apart.
fn coefficients(sh_degree: u32, tint: f32) -> Vec<f32> {
    let count = COUNT * 3 * (sh_degree as usize + 1).pow(2);
    (0..count)
        .map(|k| tint + 0.4 * (k as f32 * 0.7).sin())
        .collect()
}

fn serve(domain: &Domain, sh_degree: u32, tint: f32) -> ServerPorts {
    let mut ports = serve_without_scene(domain, sh_degree, tint);
    publish_scene(&mut ports, sh_degree, tint);
    ports
}

fn padded(name: &str) -> [u8; 64] {
    let mut bytes = [0; 64];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    bytes
}

/// Makes the scene, which the ports are planned for, and hands it on.
fn with_scene<T>(sh_degree: u32, tint: f32, act: impl FnOnce(&SceneBlocks) -> T) -> T {
    let gaussians = vec![GaussianRest::default(); COUNT];
    let object = ObjectInfo {
        gaussian_count: COUNT as u32,
        name: padded("ring"),
        ..bytemuck::Zeroable::zeroed()
    };
    let sh = coefficients(sh_degree, tint);
    act(&SceneBlocks {
        header: header(sh_degree),
        gaussians: &gaussians,
        sh: &sh,
        objects: &[object],
        features: &[],
        source: "",
        files: &[],
    })
}

fn serve_without_scene(domain: &Domain, sh_degree: u32, tint: f32) -> ServerPorts {
    with_scene(sh_degree, tint, |blocks| {
        ServerPorts::create(domain, "test", &PoolPlan::new(blocks)).unwrap()
    })
}

fn publish_scene(ports: &mut ServerPorts, sh_degree: u32, tint: f32) {
    with_scene(sh_degree, tint, |blocks| {
        ports.publish_scene(blocks).unwrap()
    });
}

/// A ring of splats, turned by `step`.
fn ring(step: u64) -> Vec<GaussianState> {
    (0..COUNT)
        .map(|k| {
            let angle = 0.1 * k as f32 + 0.05 * step as f32;
            let variance = 0.01;
            GaussianState {
                position: [
                    0.8 * angle.cos(),
                    0.5 * angle.sin(),
                    0.3 * (3.0 * angle).sin(),
                ],
                color: [200, (4 * k) as u8, 40, 220],
                covariance: [variance, 0.0, 0.0, variance, 0.0, variance],
                index: k as u32,
                rotation: [0.0, 0.0, (0.5 * angle).sin(), (0.5 * angle).cos()],
                ..GaussianState::default()
            }
        })
        .collect()
}

fn send(ports: &ServerPorts, step: u64, flags: u32) {
    let mut loan = ports.loan_frame_within(COUNT, PATIENCE).unwrap();
    loan.gaussians_mut().copy_from_slice(&ring(step));
    let header = FrameHeader {
        step,
        sim_time: step as f64 / 60.0,
        flags,
        ..FrameHeader::default()
    };
    loan.send(&header).unwrap();
}

fn options(domain: &Domain, folder: &Path) -> Options {
    Options {
        domain: domain.clone(),
        session: "test".into(),
        patience: PATIENCE,
        look: Look {
            width: 120,
            height: 80,
            orbit: Orbit::default(),
            turning: 0.0,
            follow: None,
            path: None,
            is_shaded: false,
            png: Some(folder.join("pictures")),
            every: 1,
            mp4: Some(folder.join("deep/video.mp4")),
            fps: 60.0,
        },
        frames: None,
        participant: None,
    }
}

fn read(path: &Path) -> Image {
    let file = BufReader::new(File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    Image {
        width: info.width,
        height: info.height,
        rgb,
    }
}

/// The picture that step `step` of the scene must give.
fn expected(options: &Options, step: u64, sh_degree: u32, tint: f32) -> Image {
    let sh = coefficients(sh_degree, tint);
    let sh = (sh_degree > 0).then(|| Harmonics::new(sh_degree, &sh).unwrap());
    let camera = options.look.camera(&header(sh_degree));
    picture(&ring(step), sh, &camera, BACKGROUND)
}

struct StopOnPanic<'a>(&'a AtomicBool);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// Runs the renderer beside `server`, which hears of every rendered frame.
fn beside(
    options: &Options,
    server: impl FnOnce(&dyn Fn() -> Progress, &AtomicBool),
) -> Result<Summary, RenderError> {
    let stop = AtomicBool::new(false);
    let (tell, hear) = mpsc::channel();
    std::thread::scope(|scope| {
        // A failed assertion must end the renderer, or the scope waits for it for ever.
        let _stop = StopOnPanic(&stop);
        let renderer = scope.spawn(|| {
            run(options, &stop, move |progress| {
                tell.send(*progress).unwrap()
            })
        });
        server(
            &|| hear.recv_timeout(PATIENCE).expect("a rendered frame"),
            &stop,
        );
        renderer.join().unwrap()
    })
}

#[test]
fn every_frame_becomes_the_picture_of_its_gaussians() {
    let domain = TestDomain::new("every");
    let folder = tempfile::tempdir().unwrap();
    let options = options(&domain.0, folder.path());
    let ports = serve(&domain.0, 2, 0.3);
    let summary = beside(&options, |rendered, _| {
        for step in 10..20 {
            send(&ports, step, if step == 19 { FRAME_FLAG_LAST } else { 0 });
            let progress = rendered();
            assert_eq!(progress.step, step);
            assert_eq!(progress.frames_rendered, step - 9);
        }
    })
    .unwrap();
    assert_eq!((summary.frames_rendered, summary.frames_missed), (10, 0));
    assert_eq!((summary.pictures, summary.video_frames), (10, 10));
    assert_eq!((summary.last_step, summary.runs), (19, 1));
    assert_eq!(summary.video, options.look.mp4);
    assert!(
        std::fs::metadata(options.look.mp4.as_ref().unwrap())
            .unwrap()
            .len()
            > 500
    );
    for step in 10..20 {
        let path = folder.path().join(format!("pictures/frame_{step:08}.png"));
        assert!(
            read(&path) == expected(&options, step, 2, 0.3),
            "step {step}"
        );
    }
    let last = summary.last_picture.unwrap();
    assert_eq!(last, folder.path().join("pictures/frame_00000019.png"));
    assert!(expected(&options, 10, 2, 0.3) != expected(&options, 19, 2, 0.3));
}

#[test]
fn a_late_joiner_on_an_idle_server_gets_one_picture() {
    let domain = TestDomain::new("late");
    let folder = tempfile::tempdir().unwrap();
    let ports = serve(&domain.0, 0, 0.0);
    for step in 1..=5 {
        send(&ports, step, 0);
    }
    let mut options = options(&domain.0, folder.path());
    (options.frames, options.look.mp4) = (Some(1), None);
    let summary = run(&options, &AtomicBool::new(false), |_| {}).unwrap();
    assert_eq!((summary.last_step, summary.pictures), (5, 1));
    assert!(summary.video.is_none());
    // Degree 0: the colours are those of the frame.
    assert!(read(&summary.last_picture.unwrap()) == expected(&options, 5, 0, 0.0));
}

#[test]
fn a_restarted_server_is_followed_with_its_new_scene() {
    let domain = TestDomain::new("restart");
    let folder = tempfile::tempdir().unwrap();
    let options = options(&domain.0, folder.path());
    let summary = beside(&options, |rendered, _| {
        let first = serve(&domain.0, 1, 0.0);
        send(&first, 100, 0);
        assert_eq!(rendered().runs, 1);
        drop(first);
        let second = serve(&domain.0, 3, 0.5);
        send(&second, 1, 0);
        assert_eq!(rendered().runs, 2);
        send(&second, 2, FRAME_FLAG_LAST);
        assert_eq!(rendered().step, 2);
    })
    .unwrap();
    assert_eq!((summary.runs, summary.frames_missed), (2, 0));
    assert_eq!(summary.video_frames, 3);
    let at = |step: u64| read(&folder.path().join(format!("pictures/frame_{step:08}.png")));
    assert!(at(100) == expected(&options, 100, 1, 0.0));
    assert!(at(2) == expected(&options, 2, 3, 0.5));
}

#[test]
fn a_stop_leaves_complete_files() {
    let domain = TestDomain::new("stop");
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(&domain.0, folder.path());
    options.look.every = 4;
    let ports = serve(&domain.0, 0, 0.0);
    let summary = beside(&options, |rendered, stop| {
        for step in 0..10 {
            send(&ports, step, 0);
            rendered();
        }
        stop.store(true, Ordering::Relaxed);
    })
    .unwrap();
    assert_eq!((summary.frames_rendered, summary.video_frames), (10, 10));
    let mut names: Vec<String> = std::fs::read_dir(folder.path().join("pictures"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "frame_00000000.png",
            "frame_00000004.png",
            "frame_00000008.png"
        ]
    );
    let video = std::fs::read(options.look.mp4.unwrap()).unwrap();
    assert!(video.windows(4).any(|w| w == b"moov") && video.windows(4).any(|w| w == b"mdat"));
}

#[test]
fn a_slow_renderer_skips_frames_and_its_video_keeps_the_time() {
    let domain = TestDomain::new("slow");
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(&domain.0, folder.path());
    (options.look.png, options.look.fps) = (None, 30.0);
    let ports = serve(&domain.0, 0, 0.0);
    let stop = AtomicBool::new(false);
    let (begin, begun) = mpsc::channel();
    let (go_on, may_go_on) = mpsc::channel::<()>();
    let summary = std::thread::scope(|scope| {
        let options = &options;
        let stop = &stop;
        let _stop = StopOnPanic(stop);
        let renderer = scope.spawn(move || {
            run(options, stop, move |progress| {
                if progress.frames_rendered == 1 {
                    begin.send(()).unwrap();
                    may_go_on.recv().unwrap();
                }
            })
        });
        send(&ports, 0, 0);
        begun.recv_timeout(PATIENCE).unwrap();
        // The renderer is stuck; the server goes on for a second.
        for step in 1..=60 {
            send(&ports, step, if step == 60 { FRAME_FLAG_LAST } else { 0 });
        }
        go_on.send(()).unwrap();
        renderer.join().unwrap().unwrap()
    });
    // The first frame, perhaps one that was copied meanwhile, and the last one.
    assert!((2..=3).contains(&summary.frames_rendered), "{summary:?}");
    assert!((50..=59).contains(&summary.frames_missed), "{summary:?}");
    assert_eq!(summary.pictures_missed, 0);
    // Frames 0 to 30 at 30 per second: the second between them is shown, as a still.
    assert_eq!(summary.video_frames, 31);
}

#[test]
fn pictures_of_chosen_steps_are_of_these_steps_however_late() {
    let domain = TestDomain::new("chosen");
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(&domain.0, folder.path());
    (options.look.every, options.look.mp4) = (3, None);
    let ports = serve(&domain.0, 0, 0.0);
    let (begin, begun) = mpsc::channel();
    let (go_on, may_go_on) = mpsc::channel::<()>();
    let stop = AtomicBool::new(false);
    let summary = std::thread::scope(|scope| {
        let _stop = StopOnPanic(&stop);
        let (options, stop) = (&options, &stop);
        let renderer = scope.spawn(move || {
            run(options, stop, move |progress| {
                if progress.frames_rendered == 1 {
                    begin.send(()).unwrap();
                    may_go_on.recv().unwrap();
                }
            })
        });
        send(&ports, 0, 0);
        begun.recv_timeout(PATIENCE).unwrap();
        // It is stuck at the first picture; frames come at a pace at which they can be copied.
        for step in 1..=20 {
            std::thread::sleep(Duration::from_millis(30));
            send(&ports, step, if step == 20 { FRAME_FLAG_LAST } else { 0 });
        }
        go_on.send(()).unwrap();
        renderer.join().unwrap().unwrap()
    });
    assert_eq!((summary.pictures, summary.pictures_missed), (8, 0));
    for step in [0, 3, 6, 9, 12, 15, 18, 20] {
        let path = folder.path().join(format!("pictures/frame_{step:08}.png"));
        assert!(read(&path) == expected(&options, step, 0, 0.0), "{step}");
    }
}

#[test]
fn the_camera_turns_and_follows_an_object_of_the_scene() {
    let domain = TestDomain::new("turns");
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(&domain.0, folder.path());
    options.look.mp4 = None;
    options.look.turning = 1.5;
    options.look.follow = Some("ring".into());
    let ports = serve(&domain.0, 0, 0.0);
    let (sent, frames) = (30, options.frames.replace(1));
    send(&ports, sent, 0);
    let summary = run(&options, &AtomicBool::new(false), |_| {}).unwrap();
    // The camera of that moment, by hand: half a second's turn, around the middle of the ring.
    let middle = ring(sent)
        .iter()
        .fold(Vec3::ZERO, |sum, g| sum + Vec3::from(g.position))
        / COUNT as f32;
    let mut still = options.clone();
    still.look.orbit = Orbit {
        azimuth: options.look.orbit.azimuth + 0.75,
        distance: Some(3f32.sqrt() / 20f32.to_radians().sin()),
        target: Some(middle),
        ..options.look.orbit
    };
    let (found, wanted) = (
        read(&summary.last_picture.unwrap()),
        expected(&still, sent, 0, 0.0),
    );
    let apart = found
        .rgb
        .iter()
        .zip(&wanted.rgb)
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    // Sums in another order.
    assert!(apart <= Some(1), "{apart:?}");
    options.frames = frames;
    options.look.follow = Some("rign".into());
    let error = run(&options, &AtomicBool::new(false), |_| {})
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("no object \"rign\"") && error.contains("one of ring"),
        "{error}"
    );
}

#[test]
fn a_missing_server_and_a_bad_folder_are_said_in_a_sentence() {
    let domain = TestDomain::new("none");
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(&domain.0, folder.path());
    options.patience = Duration::from_millis(10);
    let error = run(&options, &AtomicBool::new(false), |_| {}).unwrap_err();
    assert!(
        error.to_string().contains("no server for session \"test\""),
        "{error}"
    );
    assert!(!options.look.mp4.as_ref().unwrap().exists());
    let blocked = folder.path().join("file");
    std::fs::write(&blocked, "").unwrap();
    options.look.png = Some(blocked.join("pictures"));
    let error = run(&options, &AtomicBool::new(false), |_| {}).unwrap_err();
    assert!(error.to_string().contains("file/pictures"), "{error}");
    // A stop before the server came is no error.
    (options.look.png, options.patience) = (None, PATIENCE);
    let summary = run(&options, &AtomicBool::new(true), |_| {}).unwrap();
    assert_eq!(summary.frames_rendered, 0);
}

#[test]
fn frames_without_a_scene_end_in_a_sentence() {
    let domain = TestDomain::new("bare");
    let folder = tempfile::tempdir().unwrap();
    let options = Options {
        patience: Duration::from_millis(300),
        ..options(&domain.0, folder.path())
    };
    let ports = serve_without_scene(&domain.0, 0, 0.0);
    // One frame, as of a paused server, is enough to know that a scene is missing.
    send(&ports, 7, 0);
    let error = run(&options, &AtomicBool::new(false), |_| {}).unwrap_err();
    let words = error.to_string();
    assert!(words.contains("its scene did not come within"), "{words}");
    // Without a scene the end is heard, too.
    send(&ports, 8, FRAME_FLAG_LAST);
    let patient = Options {
        patience: PATIENCE,
        ..options
    };
    let error = run(&patient, &AtomicBool::new(false), |_| {}).unwrap_err();
    assert!(matches!(error, RenderError::Ended { .. }), "{error}");
    assert!(error.to_string().contains("before a picture"), "{error}");
}

#[test]
fn a_frame_is_kept_until_its_scene_comes() {
    let domain = TestDomain::new("kept");
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(&domain.0, folder.path());
    (options.frames, options.look.mp4) = (Some(1), None);
    let mut ports = serve_without_scene(&domain.0, 1, 0.2);
    send(&ports, 7, 0);
    std::thread::scope(|scope| {
        let options = &options;
        let renderer = scope.spawn(move || run(options, &AtomicBool::new(false), |_| {}));
        // Several tries; a renderer that is slower to start meets an easier case.
        std::thread::sleep(Duration::from_millis(350));
        let pictures = std::fs::read_dir(folder.path().join("pictures")).unwrap();
        assert_eq!(pictures.count(), 0, "nothing to draw yet");
        publish_scene(&mut ports, 1, 0.2);
        let summary = renderer.join().unwrap().unwrap();
        assert_eq!((summary.last_step, summary.pictures), (7, 1));
        assert!(read(&summary.last_picture.unwrap()) == expected(options, 7, 1, 0.2));
    });
}
