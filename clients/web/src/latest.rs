//! The newest state of a session as pages get it: per object what it looks like and where it is, each with the number of
//! its last change. A page says which number it has, and gets what is newer: nobody queues anything for it.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::cast_slice;
use bytes::{Bytes, BytesMut};
use cosplat_ipc::assembly::Placement;
use cosplat_ipc::schema::{FrameHeader, GaussianState, ObjectState, Status};
use serde_json::{Value, json};

use crate::packing::{BYTES, Bounds, pack_all, pack_rotation};

/// Record of an answer: an object is at this place.
const PLACED: u32 = 1;
/// Record of an answer: an object's Gaussians, packed.
const GAUSSIANS: u32 = 2;
/// Record of an answer: an object's colours and opacities.
const COLOURS: u32 = 3;
/// Bytes of an answer before its text and records.
const HEAD: usize = 40;

/// An object as pages see it.
#[derive(Default)]
struct Object {
    first: u32,
    count: u32,
    bounds: Bounds,
    /// Packed Gaussians, then their rotations where colours depend on the direction.
    packed: Bytes,
    /// Those of changes before, which answers on their way may still hold: written again once none does.
    former: Vec<Bytes>,
    packed_at: u32,
    colours: Bytes,
    colours_at: u32,
    place: Option<Placement>,
    placed_at: u32,
}

/// How an object is modelled, moves and is pressed, and the same as a page shows it.
#[derive(Default)]
struct Figures {
    state: Option<ObjectState>,
    row: Value,
    at: u64,
}

/// What became of what pages asked for, since the start.
#[derive(Debug, Default)]
pub struct Counters {
    /// Answers with something new.
    pub answers: AtomicU64,
    /// Changes that a page did not get as such, because a newer one was there.
    pub dropped: AtomicU64,
    /// Bytes of answers, without their heads.
    pub bytes: AtomicU64,
}

impl Counters {
    fn count(&self, dropped: u32, bytes: usize) {
        self.answers.fetch_add(1, Ordering::Relaxed);
        self.dropped.fetch_add(dropped.into(), Ordering::Relaxed);
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
    }
}

/// The newest state.
pub struct Latest {
    /// Number of the scene; another one has other Gaussians. 0 before the first.
    scene: u32,
    /// What a page has to know of the scene, as JSON.
    about: Value,
    /// Spherical harmonics of all Gaussians in half precision; empty where colours are the same from everywhere.
    harmonics: Bytes,
    /// Number of the newest change, from 1.
    version: u32,
    header: FrameHeader,
    objects: Vec<Object>,
    by_id: HashMap<u32, usize>,
    status: Option<Status>,
    is_alive: bool,
    figures: Vec<Figures>,
    figures_at: u64,
    /// What became of it.
    pub counters: Counters,
}

/// What a page has, as it says when it asks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Known {
    /// Number of its scene.
    pub scene: u32,
    /// Number of the newest change that it has; 0 for none.
    pub version: u32,
    /// Number of the figures that it has; `None` where it wants none.
    pub figures: Option<u64>,
}

impl Latest {
    /// Nothing yet.
    pub fn new() -> Latest {
        Latest {
            scene: 0,
            about: Value::Null,
            harmonics: Bytes::new(),
            version: 0,
            header: FrameHeader::default(),
            objects: Vec::new(),
            by_id: HashMap::new(),
            status: None,
            is_alive: false,
            figures: Vec::new(),
            figures_at: 0,
            counters: Counters::default(),
        }
    }

    /// Begins another scene: objects with these ids and ranges of Gaussians, first and count.
    pub fn begin(&mut self, about: Value, harmonics: Bytes, objects: &[(u32, u32, u32)]) {
        self.scene += 1;
        self.about = about;
        self.harmonics = harmonics;
        self.version += 1;
        self.by_id = objects.iter().map(|o| o.0).zip(0..).collect();
        let ranges = objects.iter().map(|&(_, first, count)| Object {
            first,
            count,
            ..Object::default()
        });
        self.objects = ranges.collect();
        self.figures.clear();
        self.figures.resize_with(objects.len(), Figures::default);
    }

    /// What a page has to know of the scene.
    pub fn about(&self) -> Value {
        let mut about = self.about.clone();
        about["scene"] = self.scene.into();
        about
    }

    /// Spherical harmonics of all Gaussians.
    pub fn harmonics(&self) -> Bytes {
        self.harmonics.clone()
    }

    /// Number of the newest change.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// The next changes belong to this frame.
    pub fn advance(&mut self, header: FrameHeader) {
        self.header = header;
    }

    /// A number for the changes of a frame, of which there is at least one.
    pub fn next_version(&mut self) {
        self.version += 1;
    }

    /// An object has these Gaussians, in the frame of `place` or in that of the world; `None` where that is no object of the
    /// scene with as many.
    pub fn set(
        &mut self,
        object: u32,
        gaussians: &[GaussianState],
        place: Option<Placement>,
    ) -> Option<()> {
        let has_harmonics = !self.harmonics.is_empty();
        let object = &mut self.objects[*self.by_id.get(&object)?];
        if gaussians.len() != object.count as usize {
            return None;
        }
        object.bounds = Bounds::of(gaussians);
        let own = BYTES + if has_harmonics { 4 } else { 0 };
        let mut packed = object.room(own * gaussians.len());
        let (sixteens, fours) = packed.split_at_mut(BYTES * gaussians.len());
        pack_all(
            gaussians,
            &object.bounds,
            sixteens.as_chunks_mut::<BYTES>().0,
        );
        let fours = fours.as_chunks_mut::<4>().0.iter_mut();
        for (gaussian, place) in gaussians.iter().zip(fours) {
            *place = pack_rotation(gaussian.rotation).to_le_bytes();
        }
        object.packed = packed.freeze();
        object.packed_at = self.version;
        let colours = gaussians.iter().map(|gaussian| gaussian.color);
        if !colours
            .clone()
            .eq(object.colours.as_chunks::<4>().0.iter().copied())
        {
            object.colours = colours.flatten().collect();
            object.colours_at = self.version;
        }
        if object.place != place {
            object.place = place;
            object.placed_at = self.version;
        }
        Some(())
    }

    /// An object is at this place; `None` where it is none of the scene.
    pub fn place(&mut self, object: u32, place: Placement) -> Option<()> {
        let object = &mut self.objects[*self.by_id.get(&object)?];
        object.place = Some(place);
        object.placed_at = self.version;
        Some(())
    }

    /// The server's status, and whether it gave a sign of life.
    pub fn note_status(&mut self, status: Option<Status>, is_alive: bool) {
        self.status = status;
        self.is_alive = is_alive;
    }

    /// How objects are after a step.
    pub fn note_objects(&mut self, states: &[ObjectState]) {
        for state in states {
            let number = self.by_id.get(&state.id);
            if let Some(figures) = number.and_then(|n| self.figures.get_mut(*n)) {
                figures.state = Some(*state);
            }
        }
    }

    fn figures(&mut self, since: u64) -> Value {
        self.figures_at += 1;
        for figures in &mut self.figures {
            let row = figures.state.as_ref().map_or(Value::Null, figures_json);
            if row != figures.row {
                (figures.row, figures.at) = (row, self.figures_at);
            }
        }
        let newer = self.figures.iter().filter(|f| f.at > since);
        let rows: Vec<&Value> = newer.map(|f| &f.row).collect();
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let counters = &self.counters;
        json!({
            "at": self.figures_at,
            "alive": self.is_alive,
            "status": self.status.as_ref().map(status_json),
            "objects": rows,
            "answers": load(&counters.answers),
            "dropped": load(&counters.dropped),
        })
    }

    /// What is newer than what a page has; `None` where nothing is. `now` is `CLOCK_MONOTONIC` [ns].
    pub fn answer(&mut self, known: Known, now: u64) -> Option<Parts> {
        let is_same_scene = known.scene == self.scene;
        let since = if is_same_scene { known.version } else { 0 };
        (!is_same_scene || since < self.version).then(|| self.write(known, since, now))
    }

    /// What there is to say when nothing is newer: the figures.
    pub fn nothing_new(&mut self, known: Known, now: u64) -> Parts {
        self.write(known, self.version, now)
    }

    fn write(&mut self, known: Known, since: u32, now: u64) -> Parts {
        let dropped = match since {
            0 => 0,
            since => self.version.saturating_sub(since + 1),
        };
        let figures = known.figures.map(|since| self.figures(since).to_string());
        let mut text = figures.unwrap_or_default();
        text.extend(std::iter::repeat_n(
            ' ',
            text.len().next_multiple_of(4) - text.len(),
        ));
        let mut parts = Parts::default();
        let mut records = 0u32;
        // A page without this scene has to learn of the scene before it can do anything with its Gaussians.
        let objects = self.objects.iter().filter(|_| known.scene == self.scene);
        for (object, number) in objects.zip(0u32..) {
            records += object.write_since(since, number, &mut parts);
        }
        let mut head = Vec::with_capacity(HEAD + text.len());
        let age = now.saturating_sub(self.header.publish_ns) as f64 * 1e-6;
        head.extend_from_slice(cast_slice(&[self.scene, self.version]));
        head.extend_from_slice(&(self.header.step as f64).to_le_bytes());
        head.extend_from_slice(&self.header.sim_time.to_le_bytes());
        head.extend_from_slice(&(age as f32).to_le_bytes());
        head.extend_from_slice(cast_slice(&[dropped, records, text.len() as u32]));
        head.extend_from_slice(text.as_bytes());
        parts.0.push_front(head.into());
        if records > 0 {
            self.counters.count(dropped, parts.len());
        }
        parts
    }
}

/// An answer in parts, of which the large ones are shared with the state and with other answers.
#[derive(Debug, Default)]
pub struct Parts(pub VecDeque<Bytes>);

impl Parts {
    /// Bytes in all.
    pub fn len(&self) -> usize {
        self.0.iter().map(Bytes::len).sum()
    }
}

impl Object {
    /// As many bytes to write packed Gaussians to, of before where no answer holds these any more.
    fn room(&mut self, length: usize) -> BytesMut {
        self.former.push(std::mem::take(&mut self.packed));
        let mut room = None;
        let mut held = Vec::new();
        for former in self.former.drain(..) {
            match former.try_into_mut() {
                Ok(free) if room.is_none() && free.len() == length => room = Some(free),
                Ok(_) => {}
                Err(former) => held.push(former),
            }
        }
        self.former = held;
        room.unwrap_or_else(|| BytesMut::zeroed(length))
    }

    /// Adds the records that are newer; says how many.
    fn write_since(&self, since: u32, number: u32, parts: &mut Parts) -> u32 {
        let mut records = 0;
        let mut add = |bytes| parts.0.push_back(bytes);
        if self.packed_at > since {
            let mut record = begin([GAUSSIANS, number, self.first, self.count]);
            record.extend_from_slice(cast_slice(&self.bounds.low));
            record.extend_from_slice(cast_slice(&self.bounds.extent));
            add(record.into());
            add(self.packed.clone());
            records += 1;
        }
        if self.colours_at > since {
            add(begin([COLOURS, number, self.first, self.count]).into());
            add(self.colours.clone());
            records += 1;
        }
        if self.placed_at > since {
            let mut record = begin([PLACED, number, 0, 0]);
            let place = self.place.unwrap_or(Placement {
                position: [0.0; 3],
                rotation: [0.0, 0.0, 0.0, 1.0],
            });
            record.extend_from_slice(cast_slice(&place.position.map(|x| x as f32)));
            record.extend_from_slice(cast_slice(&place.rotation.map(|x| x as f32)));
            add(record.into());
            records += 1;
        }
        records
    }
}

fn begin(head: [u32; 4]) -> Vec<u8> {
    cast_slice(&head).to_vec()
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Four digits: what a person reads, and what of a resting object stays as it is.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(0.0)
}

fn figures_json(state: &ObjectState) -> Value {
    json!({
        "id": state.id,
        "fidelity": state.fidelity,
        "mass": rounded(state.mass),
        "com": state.com.map(rounded),
        "radius": rounded(state.radius),
        "speed": rounded(norm(state.linear_velocity)),
        "contact": rounded(norm(state.contact_impulse)),
    })
}

fn status_json(status: &Status) -> Value {
    json!({
        "step": status.step,
        "time": rounded(status.sim_time),
        "state": status.server_state,
        "rate": rounded(status.steps_per_second),
        "real_time": rounded(status.real_time_factor),
        "modelled": rounded(status.modelled_fraction),
        "dt": rounded(status.dt),
        "kinetic": rounded(status.kinetic_energy),
        "elastic": rounded(status.elastic_energy),
        "potential": rounded(status.potential_energy),
        "spring_work": rounded(status.spring_work),
        "edit_energy": rounded(status.edit_energy),
        "edit_mass": rounded(status.edit_mass),
        "left": status.particles_left,
        "quarantined": status.particles_quarantined,
        "rollbacks": status.rollbacks,
        "skipped": status.frames_skipped,
        "step_seconds": rounded(status.step_seconds),
        "costs": costs_json(status),
    })
}

/// The objects that take most of a step's time, the dearest first.
fn costs_json(status: &Status) -> Value {
    let costs = (0..status.cost_objects.len()).filter(|&n| status.cost_shares[n] > 0.0);
    let costs = costs.map(|n| {
        json!({
            "id": status.cost_objects[n],
            "share": rounded(status.cost_shares[n]),
            "substeps": rounded(status.cost_substeps[n]),
            "dt": rounded(status.cost_dt[n]),
            "limit": status.cost_limits[n],
            "points": status.cost_points[n],
        })
    });
    costs.collect()
}
