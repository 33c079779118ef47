//! What is taken away from a recording looks as the run did.

use std::path::{Path, PathBuf};

use cosplat_export::reel::{Reel, Steps};
use cosplat_ipc::schema::{GaussianRest, GaussianState, SERVER_PAUSED};
use cosplat_recorder::{ply::PlyScene, tape::TapeStep};
use cosplat_renderer::{Harmonics, Image, drawing::Look, picture, project};
use cosplat_scene::assets::ply;
use glam::{DQuat, DVec3, Mat3, Quat, Vec3};
use gltf::{Semantic, animation::util::ReadOutputs, mesh::util::ReadColors};

use crate::stage::{Process, Stage, psnr, wait_for_status, watchdog};

/// A box of Gaussians whose colours depend on the direction, falls and spins: once as a rigid body, once as soft matter.
const SCENE: &str = r#"
version = 1
name = "two splats"
frame_rate = 50
dx = 0.05

[[assets]]
name = "crate"
path = "crate.ply"
up = "+y"

[[objects]]
name = "rigid"
asset = "crate"
translation = [-0.3, 0.4, 0.0]
rotation_deg = [20, 30, 0]
angular_velocity = [1.0, 4.0, 2.0]
material = "soft_rubber"
fidelity = "rigid"

[[objects]]
name = "soft"
asset = "crate"
translation = [0.3, 0.25, 0.0]
angular_velocity = [0.0, 2.0, 0.0]
material = "soft_rubber"

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.4
"#;

/// Numbers between -1 and 1 that look random, the same in every run.
fn noise(n: usize) -> f32 {
    ((n as f32 * 12.9898).sin() * 43_758.547).fract()
}

/// The surface of a cube with a side of 0.2 m, harmonics of degree 3.
fn cube() -> Vec<u8> {
    let mut gaussians = Vec::new();
    for face in 0..6 {
        for n in 0..100 {
            let (u, v) = ((n % 10) as f32 / 50.0 - 0.09, (n / 10) as f32 / 50.0 - 0.09);
            let side = if face % 2 == 0 { 0.1 } else { -0.1 };
            let mut position = [u, v, side];
            position.rotate_right(face / 2);
            let spin = Quat::from_euler(glam::EulerRot::XYZ, noise(n), noise(n + 1), noise(face));
            gaussians.push(GaussianRest {
                position,
                opacity: 0.9,
                scale: [0.012, 0.008, 0.004],
                object: 0,
                rotation: spin.to_array(),
            });
        }
    }
    let sh: Vec<f32> = (0..48 * gaussians.len()).map(|n| 0.4 * noise(n)).collect();
    let scene = PlyScene {
        gaussians: &gaussians,
        sh_degree: 3,
        sh: &sh,
    };
    let mut bytes = Vec::new();
    let encoded = scene.encode(|piece| {
        bytes.extend_from_slice(piece);
        Ok::<_, std::convert::Infallible>(())
    });
    let Ok(()) = encoded;
    bytes
}

/// A recorded run of 21 frames.
fn recorded(stage: &Stage) -> PathBuf {
    std::fs::write(stage.path("crate.ply"), cube()).expect("written");
    let mut server = stage.serve_scene(SCENE, &["--paused", "--duration", "0.4"]);
    let client = stage.client();
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--json"]));
    wait_for_status(&client, |s| {
        s.frame_readers >= 1 && s.server_state == SERVER_PAUSED
    });
    assert!(stage.ctl(&["resume"]).status.success());
    server.result();
    assert_eq!(recorder.result()["frames_recorded"], 21);
    stage.path("run.mcap")
}

fn export(stage: &Stage, arguments: &[&str]) -> serde_json::Value {
    let words = [&["export", "run.mcap", "--json"][..], arguments].concat();
    Process::start(stage.cosplat(&words)).result()
}

fn reel(path: &Path, steps: Steps) -> Reel {
    Reel::open(path, None, steps, |_, _| {}).expect("a run")
}

fn steps(reel: &mut Reel) -> Vec<TapeStep> {
    std::iter::from_fn(|| reel.next(|_| {}).expect("readable")).collect()
}

fn look() -> Look {
    Look {
        width: 320,
        height: 240,
        orbit: Default::default(),
        turning: 0.0,
        follow: None,
        path: None,
        is_shaded: false,
        png: None,
        every: 1,
        mp4: None,
        fps: 50.0,
    }
}

/// The picture of a splat file, by the scene's reader.
fn picture_of(path: &Path, reel: &Reel) -> Image {
    let bytes = std::fs::read(path).expect("a file");
    let (splat, _) = ply::read("step.ply", &bytes).expect("a splat");
    let states: Vec<GaussianState> = (0..splat.position.len())
        .map(|n| {
            let axes = Mat3::from_quat(Quat::from_array(splat.rotation[n]).normalize());
            let scale = Mat3::from_diagonal(Vec3::from(splat.scale[n]));
            let c = (axes * scale * scale * axes.transpose()).to_cols_array();
            GaussianState {
                position: splat.position[n],
                color: [0, 0, 0, (splat.opacity[n] * 255.0).round() as u8],
                covariance: [c[0], c[1], c[2], c[4], c[5], c[8]],
                index: n as u32,
                rotation: [0.0, 0.0, 0.0, 1.0],
                ..Default::default()
            }
        })
        .collect();
    let sh = Harmonics::new(3, &splat.sh);
    picture(
        &states,
        sh,
        &look().camera(&reel.scene),
        cosplat_renderer::drawing::BACKGROUND,
    )
}

#[test]
fn splat_files_of_a_run_look_as_the_run_did() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let run = recorded(&stage);
    let written = export(&stage, &["--ply", "splats", "--every", "5"]);
    assert_eq!(written["files"], 5, "{written}");
    let mut reel = reel(&run, Steps::Every(5));
    for step in steps(&mut reel) {
        let number = step.frame.header.step;
        let file = stage.path(&format!("splats/step_{number:08}.ply"));
        let camera = look().camera(&reel.scene);
        let live = project(&step.frame.gaussians, &reel.scene, &reel.sh, &camera);
        let live = live.draw(cosplat_renderer::drawing::BACKGROUND);
        let found = psnr(&picture_of(&file, &reel), &live);
        assert!(found >= 45.0, "step {number}: {found} dB");
    }
    let refused =
        Process::start(stage.cosplat(&["export", "run.mcap", "--ply", "x", "--step", "99"])).wait();
    assert_eq!(refused.code(), Some(1));
}

/// Pixels of a picture that `view` left.
fn png(path: &Path) -> Image {
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("a picture"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG file");
    let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut rgb).expect("pixels");
    Image {
        width: info.width,
        height: info.height,
        rgb,
    }
}

#[test]
fn a_camera_path_leads_through_recordings_and_sessions() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let run = recorded(&stage);
    let reel = reel(&run, Steps::Every(1));
    // From where `--orbit` begins, to the other side.
    let camera = look().camera(&reel.scene);
    let target = camera.position + 2.0 * camera.world_from_camera.z_axis;
    let key = |step, eye: Vec3| {
        let (eye, target) = (eye.to_array(), target.to_array());
        format!("[[keys]]\nstep = {step}\neye = {eye:?}\nlook_at = {target:?}\n")
    };
    let away = target + (target - camera.position);
    let path = key(0, camera.position) + &key(20, away.with_y(camera.position.y));
    std::fs::write(stage.path("path.toml"), path).expect("writable");
    let view = |words: &[&str]| {
        let size = ["--size", "320x240", "--path", "path.toml", "--json"];
        Process::start(stage.cosplat(&[&["view"], words, &size].concat())).result()
    };
    view(&["run.mcap", "--png", "pictures", "--every", "20"]);
    let drawn =
        |folder: &str, step: u64| png(&stage.path(&format!("{folder}/frame_{step:08}.png")));
    let mut reel = reel;
    let states: Vec<TapeStep> = steps(&mut reel);
    let plain = |step: usize| {
        let drawn = project(
            &states[step].frame.gaussians,
            &reel.scene,
            &reel.sh,
            &camera,
        );
        drawn.draw(cosplat_renderer::drawing::BACKGROUND)
    };
    // A camera made of two points in place of two angles: single precision moves edges by less than a level.
    let found = psnr(&drawn("pictures", 0), &plain(0));
    assert!(found >= 45.0, "{found} dB");
    let found = psnr(&drawn("pictures", 20), &plain(20));
    assert!(found < 45.0, "{found} dB from the other side");
    let _server = stage.serve_scene(SCENE, &["--paused"]);
    view(&["--png", "live", "--frames", "1"]);
    assert_eq!(drawn("live", 0).rgb, drawn("pictures", 0).rgb);
    let mut refused = Process::start(stage.cosplat(&["view", "--png", "x", "--path", "none.toml"]));
    assert_eq!(refused.wait().code(), Some(1));
    assert!(refused.words().contains("none.toml"));
}

#[test]
fn a_recording_is_drawn_without_missing_a_frame() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    recorded(&stage);
    let words = [
        "view", "run.mcap", "--png", "pictures", "--mp4", "run.mp4", "--size", "64x48", "--json",
    ];
    let summary = Process::start(stage.cosplat(&words)).result();
    assert_eq!(summary["pictures"], 21, "{summary}");
    assert_eq!(summary["video_frames"], 21, "{summary}");
}

/// Nodes, tracks and places of Gaussians as another program reads them.
#[test]
fn rigid_objects_of_an_animated_scene_are_where_they_were() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let run = recorded(&stage);
    let written = export(&stage, &["--glb", "run.glb"]);
    assert_eq!(written["steps"], 21, "{written}");
    let approximated = written["approximated"].as_array().expect("a list");
    let names: Vec<_> = approximated
        .iter()
        .map(|object| &object["object"])
        .collect();
    assert_eq!(names, ["soft"], "{written}");

    let bytes = std::fs::read(stage.path("run.glb")).expect("a file");
    // The reader knows no names of extensions' attributes.
    let file = gltf::Gltf::from_slice_without_validation(&bytes).expect("a .glb");
    let blob = file.blob.as_deref().expect("a binary part");
    let buffer = |_: gltf::Buffer<'_>| Some(blob);
    let node = file
        .nodes()
        .find(|node| node.name() == Some("rigid"))
        .expect("a node");
    let primitive = node
        .mesh()
        .expect("a mesh")
        .primitives()
        .next()
        .expect("points");
    let reader = primitive.reader(buffer);
    let own: Vec<_> = reader.read_positions().expect("positions").collect();
    assert_eq!(own.len(), 600);
    assert!(matches!(reader.read_colors(0), Some(ReadColors::RgbaU8(_))));
    assert!(primitive.get(&Semantic::Positions).is_some());

    let animation = file.animations().next().expect("an animation");
    let (mut times, mut positions, mut rotations) = (Vec::new(), Vec::new(), Vec::new());
    for channel in animation.channels() {
        if channel.target().node().index() != node.index() {
            continue;
        }
        let reader = channel.reader(buffer);
        times = reader.read_inputs().expect("times").collect();
        match reader.read_outputs().expect("values") {
            ReadOutputs::Translations(values) => positions = values.collect(),
            ReadOutputs::Rotations(values) => rotations = values.into_f32().collect(),
            _ => panic!("a track of another kind"),
        }
    }
    let mut reel = reel(&run, Steps::Every(1));
    let recorded = steps(&mut reel);
    assert_eq!(
        [times.len(), positions.len(), rotations.len()],
        [recorded.len(); 3]
    );
    for (n, step) in recorded.iter().enumerate() {
        assert!((f64::from(times[n]) - step.frame.header.sim_time).abs() < 1e-6);
        let rotation = DQuat::from_array(rotations[n].map(f64::from)).normalize();
        let place = DVec3::from(positions[n].map(f64::from));
        let rigid = step.frame.gaussians.iter().filter(|g| g.object == 0);
        for (gaussian, own) in rigid.zip(&own) {
            let found = place + rotation * DVec3::from(own.map(f64::from));
            let expected = DVec3::from(gaussian.position.map(f64::from));
            // Rounding of f32 at half a metre.
            assert!(
                found.distance(expected) < 1e-6,
                "step {n}: {found} {expected}"
            );
        }
    }
}
