//! An animated scene: binary glTF 2.0 with `KHR_gaussian_splatting`, a node per object.
//!
//! A node has the Gaussians of its object at the first exported step, in the object's own frame: centre of mass and rotation
//! since rest. Its track is where that frame is at every exported step. Rigid objects come out exactly; of others the format
//! carries the motion of the whole only, and the result says how far their Gaussians are from where they were.

use std::{
    io::Write,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use bytemuck::Pod;
use cosplat_ipc::schema::{GaussianState, ObjectState};
use cosplat_recorder::tape::TapeStep;
use cosplat_renderer::camera::up_from_gravity;
use glam::{DQuat, DVec3, Quat, Vec3};
use serde::Serialize;
use serde_json::{Value, json};

use crate::{
    ExportError,
    ply::{colors, is_shown},
    reel::Reel,
    shapes::Shapes,
};

/// Largest file that the format's 32-bit lengths allow [byte].
const MOST: u64 = u32::MAX as u64;
/// Component types of accessors.
const FLOAT: u32 = 5126;
const UNSIGNED_BYTE: u32 = 5121;
/// The name that every attribute of a splat begins with.
const EXTENSION: &str = "KHR_gaussian_splatting";

/// What was written.
#[derive(Clone, Debug, Serialize)]
pub struct Animation {
    /// The file.
    pub file: PathBuf,
    /// Its bytes.
    pub bytes: u64,
    /// Steps of the tracks.
    pub steps: u64,
    /// Objects that do more than move as a whole, and by how much their Gaussians are misplaced at most [m].
    pub approximated: Vec<Approximated>,
}

/// An object that the format does not carry exactly.
#[derive(Clone, Debug, Serialize)]
pub struct Approximated {
    /// Name of the object.
    pub object: String,
    /// Largest distance of a Gaussian from where it was [m].
    pub largest_error: f64,
}

/// Where an object's own frame is.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub position: DVec3,
    pub rotation: DQuat,
}

impl Place {
    fn of(state: &ObjectState) -> Self {
        let rotation = DQuat::from_array(state.rotation);
        Self {
            position: state.com.into(),
            rotation: match rotation.is_finite() && rotation.length() > 0.5 {
                true => rotation.normalize(),
                false => DQuat::IDENTITY,
            },
        }
    }

    pub fn own_from_world(&self, point: DVec3) -> DVec3 {
        self.rotation.inverse() * (point - self.position)
    }
}

/// What is gathered of one object.
struct Actor {
    name: String,
    /// Gaussians in the scene: the first, and how many.
    gaussians: std::ops::Range<usize>,
    /// Its places, one for every exported step.
    track: Vec<Place>,
    /// Squared distance of a Gaussian from where the track has it, the largest.
    misplaced: f64,
}

/// Writes a reel as a `.glb` file, until its end or `stop`. `passed` hears of every step.
///
/// # Errors
/// When the recording cannot be read, tells no places of objects or is too large for the format, or the file is the recording or
/// cannot be written.
pub fn write_animation(
    reel: &mut Reel,
    path: &Path,
    stop: &AtomicBool,
    mut passed: impl FnMut(u64),
) -> Result<Animation, ExportError> {
    reel.keep_apart(path)?;
    let mut actors = actors(reel);
    let (mut times, mut scene, mut own) = (Vec::new(), None, Vec::new());
    while !stop.load(Ordering::Relaxed) {
        let Some(step) = reel.next(&mut passed)? else {
            break;
        };
        let places = places(&step, actors.len())?;
        for (actor, place) in actors.iter_mut().zip(&places) {
            let mut place = *place;
            // Of the two quaternions of a rotation, the one next to that before.
            if let Some(before) = actor.track.last()
                && before.rotation.dot(place.rotation) < 0.0
            {
                place.rotation = -place.rotation;
            }
            actor.track.push(place);
        }
        times.push(step.frame.header.sim_time);
        if scene.is_none() {
            own = in_own_frames(&step.frame.gaussians, &places, reel.gaussians.len());
            scene = Some(Splats::of(reel, &step.frame.gaussians, &places));
        }
        misplace(&mut actors, &step.frame.gaussians, &places, &own);
    }
    let Some(splats) = scene else {
        let (path, epoch) = (path.to_owned(), reel.scene.epoch);
        return Err(ExportError::NoSteps { path, epoch });
    };
    let begin = times[0];
    let times: Vec<f32> = times.iter().map(|time| (time - begin) as f32).collect();
    let mut buffer = Buffer::default();
    let document = document(reel, &actors, &splats, &times, &mut buffer);
    let bytes = write_file(&document, buffer.bytes, path)?;
    // What differs by no more than a Gaussian's place in f32 is exact.
    let is_inexact = |actor: &&Actor| actor.misplaced.sqrt() > 1e-5;
    let approximated = actors.iter().filter(is_inexact).map(|actor| Approximated {
        object: actor.name.clone(),
        largest_error: actor.misplaced.sqrt(),
    });
    Ok(Animation {
        file: path.to_owned(),
        bytes,
        steps: times.len() as u64,
        approximated: approximated.collect(),
    })
}

fn actors(reel: &Reel) -> Vec<Actor> {
    let count = reel.gaussians.len();
    let actor = |info: &cosplat_ipc::schema::ObjectInfo| {
        let first = (info.gaussian_first as usize).min(count);
        Actor {
            name: info.name().unwrap_or_default().to_owned(),
            gaussians: first..(first + info.gaussian_count as usize).min(count),
            track: Vec::new(),
            misplaced: 0.0,
        }
    };
    reel.objects.iter().map(actor).collect()
}

/// Places of all objects at a step, by id.
pub(crate) fn places(step: &TapeStep, count: usize) -> Result<Vec<Place>, ExportError> {
    let states = step.objects.as_ref().map_or(&[][..], |(_, states)| states);
    let places: Vec<_> = (0..count)
        .filter_map(|id| states.iter().find(|state| state.id as usize == id))
        .map(Place::of)
        .collect();
    match places.len() == count {
        true => Ok(places),
        false => Err(ExportError::Objects {
            step: step.frame.header.step,
            found: places.len(),
            expected: count,
        }),
    }
}

/// Positions in the frames of their objects, by the number of the Gaussian.
fn in_own_frames(gaussians: &[GaussianState], places: &[Place], count: usize) -> Vec<DVec3> {
    let mut own = vec![DVec3::NAN; count];
    for gaussian in gaussians {
        if let Some(place) = places.get(gaussian.object as usize) {
            let position = DVec3::from(gaussian.position.map(f64::from));
            own[gaussian.index as usize] = place.own_from_world(position);
        }
    }
    own
}

/// Notes how far Gaussians are from where the tracks have them.
fn misplace(actors: &mut [Actor], gaussians: &[GaussianState], places: &[Place], own: &[DVec3]) {
    for gaussian in gaussians {
        let object = gaussian.object as usize;
        let (Some(actor), Some(place)) = (actors.get_mut(object), places.get(object)) else {
            continue;
        };
        let position = DVec3::from(gaussian.position.map(f64::from));
        let apart = place.own_from_world(position) - own[gaussian.index as usize];
        // Of what cannot be placed nothing is said.
        actor.misplaced = actor.misplaced.max(apart.length_squared());
    }
}

/// The Gaussians of the first step in the frames of their objects, in the order of the scene.
struct Splats {
    positions: Vec<[f32; 3]>,
    rotations: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    colors: Vec<[u8; 4]>,
    shown: Vec<bool>,
    /// `[gaussian][coefficient][rgb]`.
    sh: Vec<f32>,
    coefficients: usize,
}

impl Splats {
    fn of(reel: &Reel, gaussians: &[GaussianState], places: &[Place]) -> Self {
        let back: Vec<Quat> = places
            .iter()
            .map(|p| p.rotation.inverse().as_quat())
            .collect();
        let sh = colors(reel, gaussians, Some(&back));
        let mut colors = vec![[0; 4]; reel.gaussians.len()];
        for gaussian in gaussians {
            colors[gaussian.index as usize] = gaussian.color;
        }
        let shapes = Shapes::new(&reel.gaussians).at(gaussians);
        let place = |object: u32| places.get(object as usize);
        let own = |g: &cosplat_ipc::schema::GaussianRest| {
            let position = DVec3::from(g.position.map(f64::from));
            place(g.object)
                .map_or(position, |p| p.own_from_world(position))
                .as_vec3()
        };
        Self {
            positions: shapes.iter().map(|g| own(g).to_array()).collect(),
            rotations: shapes
                .iter()
                .map(|g| {
                    let axes = Quat::from_array(g.rotation);
                    let back = back.get(g.object as usize).copied().unwrap_or_default();
                    (back * axes).normalize().to_array()
                })
                .collect(),
            scales: shapes.iter().map(|g| g.scale).collect(),
            opacities: shapes.iter().map(|g| g.opacity.clamp(0.0, 1.0)).collect(),
            shown: shapes.iter().map(is_shown).collect(),
            colors,
            coefficients: sh.len() / (3 * reel.gaussians.len()).max(1),
            sh,
        }
    }
}

/// The binary part, and the accessors into it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Adds elements of a multiple of four bytes each; returns the number of their accessor.
    fn add<T: Pod>(&mut self, values: &[T], kind: &str, component: u32) -> usize {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let accessor = self.accessors.len();
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.bytes.len(),
            "byteLength": bytes.len(),
        }));
        self.accessors.push(json!({
            "bufferView": accessor,
            "componentType": component,
            "count": values.len(),
            "type": kind,
        }));
        if component == UNSIGNED_BYTE {
            self.accessors[accessor]["normalized"] = true.into();
        }
        self.bytes.extend_from_slice(bytes);
        accessor
    }

    /// Adds elements of `N` numbers, with their range.
    fn add_ranged<const N: usize>(&mut self, values: &[[f32; N]], kind: &str) -> usize
    where
        [f32; N]: Pod,
    {
        let accessor = self.add(values, kind, FLOAT);
        let range = |of: fn(f32, f32) -> f32, from: f32| {
            let fold = |k: usize| values.iter().fold(from, |range, value| of(range, value[k]));
            (0..N).map(fold).collect::<Vec<f32>>()
        };
        self.accessors[accessor]["min"] = json!(range(f32::min, f32::INFINITY));
        self.accessors[accessor]["max"] = json!(range(f32::max, f32::NEG_INFINITY));
        accessor
    }
}

/// The JSON part.
fn document(
    reel: &Reel,
    actors: &[Actor],
    splats: &Splats,
    times: &[f32],
    buffer: &mut Buffer,
) -> Value {
    let up = up_from_gravity(reel.scene.gravity);
    let upright = Quat::from_rotation_arc(up.normalize_or(Vec3::Y), Vec3::Y);
    // glTF has y upwards.
    let mut nodes = vec![json!({
        "name": "world",
        "rotation": upright.to_array(),
        "children": (1..=actors.len()).collect::<Vec<_>>(),
    })];
    let (mut meshes, mut channels, mut samplers) = (Vec::new(), Vec::new(), Vec::new());
    let times: Vec<[f32; 1]> = times.iter().map(|time| [*time]).collect();
    let clock = buffer.add_ranged(&times, "SCALAR");
    for actor in actors {
        let first = actor.track[0];
        let mut node = json!({
            "name": actor.name,
            "translation": first.position.as_vec3().to_array(),
            "rotation": first.rotation.as_quat().to_array(),
        });
        if let Some(primitive) = primitive(actor, splats, buffer) {
            node["mesh"] = meshes.len().into();
            meshes.push(json!({ "name": actor.name, "primitives": [primitive] }));
        }
        let positions: Vec<[f32; 3]> = actor
            .track
            .iter()
            .map(|p| p.position.as_vec3().to_array())
            .collect();
        let rotations: Vec<[f32; 4]> = actor
            .track
            .iter()
            .map(|p| p.rotation.as_quat().to_array())
            .collect();
        let mut animate = |path: &str, output: usize| {
            samplers.push(json!({ "input": clock, "output": output, "interpolation": "LINEAR" }));
            channels.push(json!({
                "sampler": samplers.len() - 1,
                "target": { "node": nodes.len(), "path": path },
            }));
        };
        if positions.iter().any(|p| *p != positions[0]) {
            animate("translation", buffer.add(&positions, "VEC3", FLOAT));
        }
        if rotations.iter().any(|r| *r != rotations[0]) {
            animate("rotation", buffer.add(&rotations, "VEC4", FLOAT));
        }
        nodes.push(node);
    }
    let mut document = json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("cosplat ", env!("CARGO_PKG_VERSION")),
        },
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": nodes,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    });
    if !meshes.is_empty() {
        document["meshes"] = meshes.into();
    }
    if !channels.is_empty() {
        document["animations"] =
            json!([{ "name": "run", "channels": channels, "samplers": samplers }]);
    }
    document
}

/// The Gaussians of an object that can be shown.
fn primitive(actor: &Actor, splats: &Splats, buffer: &mut Buffer) -> Option<Value> {
    let shown: Vec<usize> = actor
        .gaussians
        .clone()
        .filter(|n| splats.shown[*n])
        .collect();
    if shown.is_empty() {
        return None;
    }
    let positions: Vec<[f32; 3]> = shown.iter().map(|n| splats.positions[*n]).collect();
    let rotations: Vec<[f32; 4]> = shown.iter().map(|n| splats.rotations[*n]).collect();
    let scales: Vec<[f32; 3]> = shown.iter().map(|n| splats.scales[*n]).collect();
    let opacities: Vec<f32> = shown.iter().map(|n| splats.opacities[*n]).collect();
    let colors: Vec<[u8; 4]> = shown.iter().map(|n| splats.colors[*n]).collect();
    let mut attributes = json!({
        "POSITION": buffer.add_ranged(&positions, "VEC3"),
        "COLOR_0": buffer.add(&colors, "VEC4", UNSIGNED_BYTE),
    });
    let mut attribute = |name: &str, accessor: usize| {
        attributes[format!("{EXTENSION}:{name}")] = accessor.into();
    };
    attribute("ROTATION", buffer.add(&rotations, "VEC4", FLOAT));
    attribute("SCALE", buffer.add(&scales, "VEC3", FLOAT));
    attribute("OPACITY", buffer.add(&opacities, "SCALAR", FLOAT));
    for coefficient in 0..splats.coefficients {
        let degree = coefficient.isqrt();
        let values: Vec<[f32; 3]> = shown
            .iter()
            .map(|n| {
                let at = 3 * (n * splats.coefficients + coefficient);
                [splats.sh[at], splats.sh[at + 1], splats.sh[at + 2]]
            })
            .collect();
        let name = format!("SH_DEGREE_{degree}_COEF_{}", coefficient - degree * degree);
        attribute(&name, buffer.add(&values, "VEC3", FLOAT));
    }
    let splatting = json!({ "kernel": "ellipse", "colorSpace": "srgb_rec709_display" });
    Some(json!({
        "mode": 0,
        "attributes": attributes,
        "extensions": { EXTENSION: splatting },
    }))
}

/// Writes header, JSON chunk and binary chunk (glTF 2.0, section 4.4); returns the bytes of the file.
fn write_file(document: &Value, mut binary: Vec<u8>, path: &Path) -> Result<u64, ExportError> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let bytes = (12 + 8 + text.len() + 8 + binary.len()) as u64;
    if bytes > MOST {
        return Err(ExportError::TooLarge { bytes, most: MOST });
    }
    let written = cosplat_files::write_with(path, |file| {
        let words = [u32::from_le_bytes(*b"glTF"), 2, bytes as u32];
        for word in words {
            file.write_all(&word.to_le_bytes())?;
        }
        for (chunk, kind) in [(&text, b"JSON"), (&binary, b"BIN\0")] {
            file.write_all(&(chunk.len() as u32).to_le_bytes())?;
            file.write_all(kind)?;
            file.write_all(chunk)?;
        }
        Ok(())
    });
    written.map_err(ExportError::write(path))?;
    Ok(bytes)
}
