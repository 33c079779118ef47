//! `boundary_conditions`: the seven types of the original.

use serde_json::Value;

use crate::{
    fields::{Fields, suggestion},
    notes::{NoteKind, Notes},
};

/// One boundary condition and where it stands.
#[derive(Clone, Debug)]
pub(super) struct Boundary {
    /// Path, such as `boundary_conditions[1]`.
    pub key: String,
    pub what: What,
    /// Acts from here on, and no longer at the end [s].
    pub time: [f64; 2],
}

/// What a boundary condition does. Coordinates are those of the simulation, lengths are half extents.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum What {
    BoundingBox,
    /// Nodes inside move with `velocity`, and the box with them.
    Cuboid {
        center: [f64; 3],
        half_size: [f64; 3],
        velocity: [f64; 3],
        reset: bool,
    },
    /// Half-space.
    Surface {
        point: [f64; 3],
        normal: [f64; 3],
        kind: SurfaceKind,
        friction: f64,
    },
    /// Particles that start inside get a force, each of them, for `num_dt` substeps.
    Impulse {
        center: [f64; 3],
        half_size: [f64; 3],
        force: [f64; 3],
        num_dt: u64,
    },
    /// Particles that start inside move with `velocity`.
    Translation {
        center: [f64; 3],
        half_size: [f64; 3],
        velocity: [f64; 3],
    },
    /// Particles that start inside a cylinder turn about its axis.
    Rotation {
        center: [f64; 3],
        normal: [f64; 3],
        half_height: f64,
        radius: f64,
        rotation: f64,
        translation: f64,
    },
    /// Layers along an axis are let go one after the other, the last one at the end position.
    Release {
        axis: usize,
        start_position: f64,
        end_position: f64,
        num_layers: u64,
    },
}

/// `surface` of a surface collider.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SurfaceKind {
    Sticky,
    Slip,
    Cut,
    Separate,
}

const TYPES: [&str; 7] = [
    "bounding_box",
    "cuboid",
    "surface_collider",
    "particle_impulse",
    "enforce_particle_translation",
    "enforce_particle_velocity_rotation",
    "release_particles_sequentially",
];

/// Reads the list; unknown types are noted and left out.
pub(super) fn read(top: &mut Fields, notes: &mut Notes) -> Vec<Boundary> {
    let list = top.list("boundary_conditions", notes);
    let mut boundaries = Vec::new();
    for (i, entry) in list.into_iter().flatten().enumerate() {
        let key = format!("boundary_conditions[{i}]");
        if let Some(fields) = Fields::new(&key, entry, notes)
            && let Some((what, time)) = one(fields, notes)
        {
            boundaries.push(Boundary { key, what, time });
        }
    }
    boundaries
}

fn one(mut f: Fields, notes: &mut Notes) -> Option<(What, [f64; 2])> {
    let name = f.text("type", notes);
    let name = f.required("type", name, notes)?;
    let start = f.number("start_time", notes);
    let end = f.number("end_time", notes);
    // Those that the original asserts.
    let timed = !["bounding_box", "cuboid", "particle_impulse"].contains(&name);
    if timed && TYPES.contains(&name) {
        f.required("start_time", start, notes);
        f.required("end_time", end, notes);
    }
    let what = match name {
        "bounding_box" => Some(What::BoundingBox),
        "cuboid" => cuboid(&mut f, notes),
        "surface_collider" => surface(&mut f, notes),
        "particle_impulse" => impulse(&mut f, notes),
        "enforce_particle_translation" => translation(&mut f, notes),
        "enforce_particle_velocity_rotation" => rotation(&mut f, notes),
        "release_particles_sequentially" => release(&mut f, notes),
        _ => {
            notes.add(
                NoteKind::Unknown,
                f.path("type"),
                name,
                Value::Null,
                format!(
                    "not a type of this format, left out{}; the original stops here",
                    suggestion(name, &TYPES)
                ),
            );
            return None;
        }
    };
    let forever = if name == "bounding_box" { 999.0 } else { 1e3 };
    let time = [start.unwrap_or(0.0), end.unwrap_or(forever)];
    f.finish(notes);
    Some((what?, time))
}

/// A vector that has to be there.
fn vector(f: &mut Fields, key: &'static str, notes: &mut Notes) -> Option<[f64; 3]> {
    let value = f.vector(key, notes);
    f.required(key, value, notes)
}

fn number(f: &mut Fields, key: &'static str, notes: &mut Notes) -> Option<f64> {
    let value = f.number(key, notes);
    f.required(key, value, notes)
}

fn direction(f: &mut Fields, key: &'static str, notes: &mut Notes) -> Option<[f64; 3]> {
    let v = vector(f, key, notes)?;
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 {
        notes.error(&f.path(key), "is zero, expected a direction");
        return None;
    }
    Some(v.map(|x| x / length))
}

fn cuboid(f: &mut Fields, notes: &mut Notes) -> Option<What> {
    let (center, half_size) = (vector(f, "point", notes), vector(f, "size", notes));
    let velocity = vector(f, "velocity", notes);
    let reset = f.flag("reset", notes).unwrap_or(false);
    Some(What::Cuboid {
        center: center?,
        half_size: half_size?,
        velocity: velocity?,
        reset,
    })
}

fn surface(f: &mut Fields, notes: &mut Notes) -> Option<What> {
    let (point, normal) = (vector(f, "point", notes), direction(f, "normal", notes));
    let name = f.text("surface", notes);
    let name = f.required("surface", name, notes);
    let friction = number(f, "friction", notes);
    let kind = match name? {
        "sticky" => SurfaceKind::Sticky,
        "slip" => SurfaceKind::Slip,
        "cut" => SurfaceKind::Cut,
        "separate" => SurfaceKind::Separate,
        other => {
            notes.warn(
                f.path("surface"),
                other,
                format!(
                    "not sticky, slip, cut or separate: read as separate, as the original does{}",
                    suggestion(other, &["sticky", "slip", "cut", "separate"])
                ),
            );
            SurfaceKind::Separate
        }
    };
    let mut friction = friction?;
    if kind == SurfaceKind::Sticky && friction != 0.0 {
        notes.add(
            NoteKind::Corrected,
            f.path("friction"),
            friction,
            0.0,
            "friction has no meaning on a sticky surface; the original refuses it",
        );
        friction = 0.0;
    }
    if friction < 0.0 {
        notes.add(
            NoteKind::Corrected,
            f.path("friction"),
            friction,
            0.0,
            "a coefficient of friction is not negative",
        );
        friction = 0.0;
    }
    Some(What::Surface {
        point: point?,
        normal: normal?,
        kind,
        friction,
    })
}

fn impulse(f: &mut Fields, notes: &mut Notes) -> Option<What> {
    let force = vector(f, "force", notes);
    let num_dt = f.count("num_dt", (0, 1 << 32), notes).unwrap_or(1);
    Some(What::Impulse {
        center: f.vector("point", notes).unwrap_or([1.0; 3]),
        half_size: f.vector("size", notes).unwrap_or([1.0; 3]),
        force: force?,
        num_dt,
    })
}

fn translation(f: &mut Fields, notes: &mut Notes) -> Option<What> {
    let (center, half_size) = (vector(f, "point", notes), vector(f, "size", notes));
    let velocity = vector(f, "velocity", notes);
    Some(What::Translation {
        center: center?,
        half_size: half_size?,
        velocity: velocity?,
    })
}

fn rotation(f: &mut Fields, notes: &mut Notes) -> Option<What> {
    let (center, normal) = (vector(f, "point", notes), direction(f, "normal", notes));
    let size = f.vector::<2>("half_height_and_radius", notes);
    let size = f.required("half_height_and_radius", size, notes);
    let rotation = number(f, "rotation_scale", notes);
    let translation = number(f, "translation_scale", notes);
    let [half_height, radius] = size?;
    Some(What::Rotation {
        center: center?,
        normal: normal?,
        half_height,
        radius,
        rotation: rotation?,
        translation: translation?,
    })
}

fn release(f: &mut Fields, notes: &mut Notes) -> Option<What> {
    let normal = vector(f, "normal", notes);
    let start = number(f, "start_position", notes);
    let end = number(f, "end_position", notes);
    let layers = f.count("num_layers", (1, 100_000), notes);
    let layers = f.required("num_layers", layers, notes);
    let normal = normal?;
    let along: Vec<usize> = (0..3).filter(|a| normal[*a] != 0.0).collect();
    let [axis] = along[..] else {
        notes.error(
            &f.path("normal"),
            format!("is {normal:?}, expected a direction along one axis"),
        );
        return None;
    };
    Some(What::Release {
        axis,
        start_position: start?,
        end_position: end?,
        num_layers: layers?,
    })
}

/// Smallest and largest corner of a box, without the dust of binary fractions.
pub(super) fn corners(center: [f64; 3], half_size: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let tidy = |x: f64| (x * 1e12).round() / 1e12;
    (
        std::array::from_fn(|a| tidy(center[a] - half_size[a])),
        std::array::from_fn(|a| tidy(center[a] + half_size[a])),
    )
}
