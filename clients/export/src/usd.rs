//! A USD file: every object as splats in its own frame, in time. The Python package writes it, with `usd-core`.
//!
//! An object's frame moves as in [`glb`](crate::glb). What changes in it (matter that deforms) is told at every step, what does
//! not is told once. So rigid objects cost a place per step, and matter comes out exactly.

use std::{
    ffi::OsString,
    io::{BufWriter, Read, Write},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
};

use cosplat_ipc::schema::GaussianRest;
use cosplat_recorder::tape::TapeStep;
use cosplat_renderer::camera::up_from_gravity;
use glam::{DVec3, Quat};
use serde::Serialize;
use serde_json::{Value, json};

use crate::{
    ExportError,
    glb::{Place, places},
    ply::colors,
    reel::Reel,
    shapes::Shapes,
};

/// Names the interpreter that has the package; `python3` without it.
pub const PYTHON: &str = "COSPLAT_PYTHON";
/// Rounding of positions in f32, brought into another frame: a few units of the last place.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

/// What was written.
#[derive(Clone, Debug, Serialize)]
pub struct Written {
    /// The file.
    pub file: PathBuf,
    /// Its bytes.
    pub bytes: u64,
    /// Steps in it.
    pub steps: u64,
    /// Names of objects that deform: their Gaussians are told at more than one step.
    pub deforming: Vec<String>,
}

/// Gaussians of an object in its own frame, as they were told last.
#[derive(Default)]
struct Told {
    positions: Vec<DVec3>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    times: u64,
    rotation: Option<glam::DQuat>,
}

impl Told {
    /// Whether the object has only moved since.
    fn is_as_told(&self, positions: &[DVec3], gaussians: &[GaussianRest]) -> bool {
        let size = gaussians.iter().flat_map(|g| g.position);
        let size = size.fold(0.0, |size, x| f64::max(size, f64::from(x).abs()));
        self.times > 0
            && (self.positions.iter().zip(positions))
                .all(|(told, now)| (*told - *now).abs().max_element() <= ROUNDING * size)
            && (self.scales.iter().zip(gaussians)).all(|(told, now)| *told == now.scale)
            && (self.opacities.iter().zip(gaussians)).all(|(told, now)| *told == now.opacity)
    }
}

/// Writes a reel as a `.usd`, `.usdc` or `.usda` file, until its end or `stop`. `passed` hears of every step.
///
/// # Errors
/// When the recording cannot be read or tells no places of objects, there is no Python with the package `cosplat[usd]`, or
/// the file cannot be written.
pub fn write_scene(
    reel: &mut Reel,
    path: &Path,
    stop: &AtomicBool,
    mut passed: impl FnMut(u64),
) -> Result<Written, ExportError> {
    reel.keep_apart(path)?;
    let mut told: Vec<Told> = reel.objects.iter().map(|_| Told::default()).collect();
    let mut shapes = Shapes::new(&reel.gaussians);
    let mut writer = Writer::start(path)?;
    writer.tell(&header(reel, path), &[])?;
    let (mut steps, mut begin) = (0, 0.0);
    while !stop.load(Ordering::Relaxed) {
        let Some(step) = reel.next(&mut passed)? else {
            break;
        };
        if steps == 0 {
            begin = step.frame.header.sim_time;
        }
        steps += 1;
        let (words, arrays) = message(reel, &step, &mut shapes, &mut told, begin)?;
        writer.tell(&words, &arrays)?;
    }
    writer.finish()?;
    let deforming = reel.objects.iter().zip(&told);
    let deforming = deforming.filter(|(_, told)| told.times > 1);
    Ok(Written {
        file: path.to_owned(),
        bytes: std::fs::metadata(path).map_or(0, |file| file.len()),
        steps,
        deforming: deforming
            .map(|(info, _)| info.name().unwrap_or_default().to_owned())
            .collect(),
    })
}

fn header(reel: &Reel, path: &Path) -> Value {
    let object = |info: &cosplat_ipc::schema::ObjectInfo| {
        let name = info.name().unwrap_or_default();
        json!({ "name": name, "count": range(reel, info).len() })
    };
    json!({
        "file": path,
        "up": up_from_gravity(reel.scene.gravity).to_array(),
        "frame_rate": reel.scene.frame_rate,
        "sh_degree": reel.scene.sh_degree.min(3),
        "objects": reel.objects.iter().map(object).collect::<Vec<_>>(),
    })
}

/// Gaussians of an object in the scene.
fn range(reel: &Reel, info: &cosplat_ipc::schema::ObjectInfo) -> std::ops::Range<usize> {
    let count = reel.gaussians.len();
    let first = (info.gaussian_first as usize).min(count);
    first..(first + info.gaussian_count as usize).min(count)
}

/// What is told of a step: words, and the numbers behind them.
fn message(
    reel: &Reel,
    step: &TapeStep,
    shapes: &mut Shapes,
    told: &mut [Told],
    begin: f64,
) -> Result<(Value, Vec<f32>), ExportError> {
    let places = places(step, told.len())?;
    let back: Vec<Quat> = places
        .iter()
        .map(|place| place.rotation.inverse().as_quat())
        .collect();
    let gaussians = shapes.at(&step.frame.gaussians);
    let sh = colors(reel, &step.frame.gaussians, Some(&back));
    let width = sh.len() / gaussians.len().max(1);
    let (mut objects, mut numbers) = (Vec::new(), Vec::new());
    for ((info, told), place) in reel.objects.iter().zip(told).zip(&places) {
        let range = range(reel, info);
        let own = &gaussians[range.clone()];
        let positions: Vec<DVec3> = own.iter().map(|g| position(place, g)).collect();
        let is_new = !told.is_as_told(&positions, own);
        if is_new {
            let turned = own.iter().map(|g| {
                let axes = place.rotation.inverse().as_quat() * Quat::from_array(g.rotation);
                axes.normalize().to_array()
            });
            numbers.extend(positions.iter().flat_map(|p| p.as_vec3().to_array()));
            numbers.extend(turned.flatten());
            numbers.extend(own.iter().flat_map(|g| g.scale));
            numbers.extend(own.iter().map(|g| g.opacity));
            numbers.extend_from_slice(&sh[range.start * width..range.end * width]);
            told.positions = positions;
            told.scales = own.iter().map(|g| g.scale).collect();
            told.opacities = own.iter().map(|g| g.opacity).collect();
            told.times += 1;
        }
        // Of the two quaternions of a rotation, the one next to that before.
        let before = told.rotation.unwrap_or(place.rotation);
        let rotation = match before.dot(place.rotation) < 0.0 {
            true => -place.rotation,
            false => place.rotation,
        };
        told.rotation = Some(rotation);
        objects.push(json!({
            "position": place.position.to_array(),
            "rotation": rotation.to_array(),
            "is_new": is_new,
        }));
    }
    let time = step.frame.header.sim_time - begin;
    Ok((json!({ "time": time, "objects": objects }), numbers))
}

fn position(place: &Place, gaussian: &GaussianRest) -> DVec3 {
    place.own_from_world(DVec3::from(gaussian.position.map(f64::from)))
}

/// The Python process.
struct Writer {
    program: OsString,
    child: Child,
    pipe: Option<BufWriter<std::process::ChildStdin>>,
}

impl Writer {
    fn start(path: &Path) -> Result<Self, ExportError> {
        let program = std::env::var_os(PYTHON).unwrap_or_else(|| "python3".into());
        let mut command = Command::new(&program);
        command.args(["-m", "cosplat.usd"]).arg(path);
        command.stdin(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command
            .stdout(Stdio::null())
            .spawn()
            .map_err(|error| ExportError::python(&program, &error.to_string()))?;
        let pipe = child.stdin.take().map(BufWriter::new);
        Ok(Self {
            program,
            child,
            pipe,
        })
    }

    /// Sends a line of words and the numbers behind it.
    fn tell(&mut self, words: &Value, numbers: &[f32]) -> Result<(), ExportError> {
        let Some(pipe) = &mut self.pipe else {
            return Ok(());
        };
        let sent = writeln!(pipe, "{words}")
            .and_then(|()| pipe.write_all(bytemuck::cast_slice(numbers)))
            .and_then(|()| pipe.flush());
        match sent {
            Ok(()) => Ok(()),
            // Whoever does not listen any more has a reason.
            Err(_) => self.finish(),
        }
    }

    /// Waits until the file is there.
    fn finish(&mut self) -> Result<(), ExportError> {
        self.pipe = None;
        let mut words = String::new();
        if let Some(mut errors) = self.child.stderr.take() {
            // What cannot be read is not told.
            let _ = errors.read_to_string(&mut words);
        }
        let ended = self.child.wait();
        match ended {
            Ok(status) if status.success() => Ok(()),
            _ => {
                let last = words.trim().lines().last().unwrap_or("it said nothing");
                Err(ExportError::python(&self.program, last))
            }
        }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // After an error: without its input it ends, and leaves no file.
        self.pipe = None;
        let _ = self.child.wait();
    }
}
