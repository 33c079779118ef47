//! Text to colliders, held regions and everything prescribed for particles.

use std::sync::Arc;

use cosplat_sim_core::scene::{
    Aabb, Collider, ColliderMotion, ColliderShape, Conditions, DomainPolicy, ImpulseAmount,
    Keyframe, PinnedRegion, Pose, PrescribedMotion, Region, RegionImpulse, Selection,
    SequentialRelease, Surface, TimeSpan, Transfer, TriangleMesh, TurnedBox,
};
use glam::DVec3;

use crate::bounds::bounds_of;

use super::{
    build::LoadMesh,
    error::{Finding, suggest},
    ids::ObjectIds,
    limits as l,
    objects::Names,
    placement,
    reader::{Entry, Table},
    spec::{ColliderSpec, ConditionSpecs, MeshSpec, Placement, SceneFile, SelectionSpec},
};

/// Layers of a release when the file does not say: what the first program with such a release always uses.
const LAYERS: u32 = 50;

/// The corners of a box, `min` and `max`.
fn corners(table: &Table) -> Option<Aabb> {
    let corner = |key| table.required(key)?.numbers::<3>(l::POSITION);
    let (min, max) = (corner("min"), corner("max"));
    let (min, max) = (min?, max?);
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        if min[axis] >= max[axis] {
            table.error(format!(
                "min {name} is {} m, expected less than max {name}, which is {} m",
                min[axis], max[axis]
            ));
        }
    }
    Some(Aabb { min, max })
}

/// The keys of a box that may be turned.
fn turned(table: &Table) -> Option<TurnedBox> {
    let (bounds, rotation) = (corners(table), placement::rotation(table));
    Some(TurnedBox {
        bounds: bounds?,
        rotation: rotation.unwrap_or(Pose::IDENTITY.rotation),
    })
}

/// A table with `min`, `max` and perhaps a rotation alone.
pub(super) fn turned_box(table: Table) -> Option<TurnedBox> {
    let found = turned(&table);
    table.finish();
    found
}

/// The `[domain]` table.
pub(super) fn domain(table: &Table) -> (Option<Aabb>, DomainPolicy) {
    let Some(table) = table.get("domain").and_then(|e| e.table()) else {
        return Default::default();
    };
    let policy = table.get("policy");
    let alone = policy.is_some() && table.get("min").is_none() && table.get("max").is_none();
    let policy = policy.and_then(|e| {
        e.choice(&[
            ("delete", DomainPolicy::Delete),
            ("bounce", DomainPolicy::Bounce),
            ("stop", DomainPolicy::Stop),
        ])
    });
    let bounds = if alone { None } else { corners(&table) };
    table.finish();
    (bounds, policy.unwrap_or_default())
}

/// A direction, normalised.
fn direction(entry: &Entry) -> Option<[f64; 3]> {
    let v = entry.numbers::<3>(l::DIRECTION)?;
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length < 1e-6 {
        entry.error("has no direction, expected a vector that is not zero");
        return None;
    }
    Some(v.map(|x| x / length))
}

fn vector(table: &Table, key: &'static str, bounds: super::reader::Bounds) -> [f64; 3] {
    let given = table.get(key).and_then(|e| e.numbers(bounds));
    given.unwrap_or_default()
}

/// The `start_time` and `end_time` keys.
fn span(table: &Table) -> TimeSpan {
    let time = |key| table.get(key).and_then(|e| e.number(l::TIME));
    let span = TimeSpan {
        start: time("start_time").unwrap_or(0.0),
        end: time("end_time").unwrap_or(f64::INFINITY),
    };
    if span.start > span.end {
        table.error(format!(
            "start_time is {} s, expected at most end_time, which is {} s",
            span.start, span.end
        ));
    }
    span
}

/// One `[[colliders]]` entry.
pub(super) fn collider(table: Table, names: &mut Names) -> Option<ColliderSpec> {
    let name = names.take(&table, "collider");
    let at = table.at.clone();
    let kind = table.get("shape").map_or(Some("half_space"), |e| {
        e.choice(&["half_space", "box", "sphere", "cylinder", "capsule", "mesh"].map(|k| (k, k)))
    });
    let found = kind.and_then(|kind| shape(&table, kind));
    let surface = table.get("surface").and_then(|e| {
        e.choice(&[
            ("sticky", Surface::Sticky),
            ("slip", Surface::Slip),
            ("separate", Surface::Separate),
        ])
    });
    let friction = table.get("friction").and_then(|e| e.number(l::FRICTION));
    let restitution = table
        .get("restitution")
        .and_then(|e| e.number(l::RESTITUTION));
    let span = span(&table);
    let pose = found.as_ref().map_or(Pose::IDENTITY, |(_, pose, _)| *pose);
    let motion = table
        .get("motion")
        .and_then(|e| e.table())
        .and_then(|t| motion(t, &pose));
    // What keys a misspelt shape has is not known.
    if kind.is_some() {
        table.finish();
    }
    let (shape, pose, mesh) = found?;
    Some(ColliderSpec {
        at,
        collider: Collider {
            name: name?,
            shape,
            pose,
            surface: surface.unwrap_or(Surface::Separate),
            friction,
            restitution: restitution.unwrap_or(0.0),
            motion: motion.unwrap_or(ColliderMotion::Static),
            span,
        },
        mesh,
    })
}

/// Shape and pose by the keys that belong to the kind.
fn shape(table: &Table, kind: &str) -> Option<(ColliderShape, Pose, Option<MeshSpec>)> {
    if kind == "half_space" {
        let point = vector(table, "point", l::POSITION);
        let normal = table.required("normal").and_then(|e| direction(&e))?;
        return Some((ColliderShape::HalfSpace { normal }, Pose::at(point), None));
    }
    if kind == "mesh" {
        let path = table.required("path").and_then(|e| e.text());
        let placement = placement::read(table);
        let pose = Pose {
            translation: placement.translation,
            rotation: placement.rotation,
        };
        let mesh = MeshSpec {
            path: path?.to_owned(),
            placement,
        };
        return Some((ColliderShape::Mesh(Default::default()), pose, Some(mesh)));
    }
    let pose = Pose {
        rotation: placement::rotation(table).unwrap_or(Pose::IDENTITY.rotation),
        translation: vector(table, "translation", l::POSITION),
    };
    let length = |key| table.required(key).and_then(|e| e.number(l::LENGTH));
    let shape = match kind {
        "box" => {
            let size = table
                .required("size")
                .and_then(|e| e.numbers::<3>(l::LENGTH))?;
            ColliderShape::Box {
                half_extents: size.map(|s| 0.5 * s),
            }
        }
        "sphere" => ColliderShape::Sphere {
            radius: length("radius")?,
        },
        _ => {
            let (radius, height) = (length("radius"), length("height"));
            let (radius, height) = (radius?, height?);
            if kind == "cylinder" {
                ColliderShape::Cylinder {
                    radius,
                    half_height: 0.5 * height,
                }
            } else {
                if height < 2.0 * radius {
                    table.error(format!(
                        "height is {height} m, expected at least {} m: it includes both caps",
                        2.0 * radius
                    ));
                }
                ColliderShape::Capsule {
                    radius,
                    half_height: 0.5 * height - radius,
                }
            }
        }
    };
    Some((shape, pose, None))
}

fn motion(table: Table, pose: &Pose) -> Option<ColliderMotion> {
    if let Some(keyframes) = table.get("keyframes") {
        let entries = keyframes.array().unwrap_or_default();
        let read = entries.iter().map(|e| keyframe(e.table()?, pose));
        let frames: Vec<Keyframe> = read.collect::<Option<_>>().unwrap_or_default();
        if entries.is_empty() {
            keyframes.error("is empty, expected at least one pose");
        }
        if let Some(pair) = frames.windows(2).find(|w| w[0].time >= w[1].time) {
            keyframes.error(format!(
                "time {} s stands before time {} s, expected ascending times",
                pair[0].time, pair[1].time
            ));
        }
        table.finish();
        return Some(ColliderMotion::Keyframes(frames));
    }
    let motion = ColliderMotion::Velocity {
        linear: vector(&table, "linear_velocity", l::SPEED),
        angular: vector(&table, "angular_velocity", l::SPIN),
        span: span(&table),
    };
    table.finish();
    Some(motion)
}

fn keyframe(table: Table, pose: &Pose) -> Option<Keyframe> {
    let time = table.required("time").and_then(|e| e.number(l::TIME));
    let translation = table
        .required("translation")
        .and_then(|e| e.numbers(l::POSITION));
    let rotation = placement::rotation(&table).unwrap_or(pose.rotation);
    table.finish();
    Some(Keyframe {
        time: time?,
        pose: Pose {
            translation: translation?,
            rotation,
        },
    })
}

/// One `[[pinned_regions]]` entry.
pub(super) fn pinned_region(table: Table) -> Option<PinnedRegion> {
    let bounds = turned(&table);
    let velocity = vector(&table, "velocity", l::SPEED);
    let span = span(&table);
    table.finish();
    Some(PinnedRegion {
        bounds: bounds?,
        velocity,
        span,
    })
}

/// `damping`, `settle`, `transfer`, `rpic_damping` and the arrays `[[prescribed]]`, `[[impulses]]` and `[[releases]]`.
pub(super) fn conditions(root: &Table, policy: DomainPolicy, objects: &Names) -> ConditionSpecs {
    let damping = root.get("damping").and_then(|e| e.number(l::DAMPING));
    let settle = root.get("settle").and_then(|e| e.number(l::SETTLE));
    let rpic_damping = root
        .get("rpic_damping")
        .and_then(|e| e.number(l::RPIC_DAMPING));
    let transfer = root.get("transfer").and_then(|e| {
        let transfer = e.choice(&[("apic", Transfer::Apic), ("pic", Transfer::Pic)])?;
        if transfer == Transfer::Pic && rpic_damping.is_some_and(|d| d > 0.0) {
            e.error("`pic` drops all that `rpic_damping` could, expected one of the two");
        }
        Some(transfer)
    });
    let mut found = ConditionSpecs {
        domain_policy: policy,
        damping: damping.unwrap_or(0.0),
        settle: settle.unwrap_or(0.0),
        transfer: transfer.unwrap_or_default(),
        rpic_damping: rpic_damping.unwrap_or(0.0),
        ..Default::default()
    };
    for entry in root.tables("prescribed") {
        found
            .prescribed
            .extend(entry.table().and_then(|t| prescribed(t, objects)));
    }
    for entry in root.tables("impulses") {
        found
            .impulses
            .extend(entry.table().and_then(|t| impulse(t, objects)));
    }
    for entry in root.tables("releases") {
        found
            .releases
            .extend(entry.table().and_then(|t| release(t, objects)));
    }
    found
}

/// The keys that say which particles are meant.
fn selection(table: &Table, objects: &Names) -> SelectionSpec {
    let object = table.get("object").and_then(|entry| {
        let name = entry.text()?;
        if !objects.makes(name) {
            let hint = suggest(name, objects.all());
            entry.error(format!("object `{name}` does not exist: {hint}"));
        }
        Some(name.to_owned())
    });
    let region = table
        .one_of(&["box", "sphere", "cylinder"])
        .and_then(|(kind, entry)| region(kind, entry.table()?));
    SelectionSpec {
        at: table.at.clone(),
        object,
        region,
    }
}

fn region(kind: &str, table: Table) -> Option<Region> {
    if kind == "box" {
        return turned_box(table).map(Region::Box);
    }
    let length = |key| table.required(key).and_then(|e| e.number(l::LENGTH));
    let center = table
        .required("center")
        .and_then(|e| e.numbers::<3>(l::POSITION));
    let radius = length("radius");
    if kind == "sphere" {
        table.finish();
        return Some(Region::Sphere {
            center: center?,
            radius: radius?,
        });
    }
    let axis = table.required("axis").and_then(|e| direction(&e));
    let half_height = length("half_height");
    table.finish();
    Some(Region::Cylinder {
        center: center?,
        axis: axis?,
        radius: radius?,
        half_height: half_height?,
    })
}

fn prescribed(table: Table, objects: &Names) -> Option<(SelectionSpec, PrescribedMotion)> {
    let selection = selection(&table, objects);
    let motion = PrescribedMotion {
        selection: Default::default(),
        linear: vector(&table, "linear_velocity", l::SPEED),
        angular: vector(&table, "angular_velocity", l::SPIN),
        center: vector(&table, "center", l::POSITION),
        span: span(&table),
    };
    table.finish();
    Some((selection, motion))
}

fn impulse(table: Table, objects: &Names) -> Option<(SelectionSpec, RegionImpulse)> {
    let selection = selection(&table, objects);
    let time = |key| table.get(key).and_then(|e| e.number(l::TIME));
    let (start, duration) = (time("start_time"), time("duration").unwrap_or(0.0));
    let strength = table.one_of(&["impulse", "force", "impulse_per_particle"]);
    if strength.is_none() {
        table.error("has no strength: give `impulse`, `force` or `impulse_per_particle`");
    }
    let amount = strength.and_then(|(key, entry)| {
        let v = entry.numbers::<3>(l::IMPULSE)?;
        Some(match key {
            "impulse" => ImpulseAmount::Total(v),
            "impulse_per_particle" => ImpulseAmount::PerParticle(v),
            _ => {
                if duration == 0.0 {
                    table.error("`duration` is 0 s, expected how long the force acts");
                }
                ImpulseAmount::Total(v.map(|f| f * duration))
            }
        })
    });
    table.finish();
    let impulse = RegionImpulse {
        selection: Default::default(),
        amount: amount?,
        start: start.unwrap_or(0.0),
        duration,
    };
    Some((selection, impulse))
}

fn release(table: Table, objects: &Names) -> Option<(SelectionSpec, SequentialRelease)> {
    let selection = selection(&table, objects);
    let axis = table.required("axis").and_then(|e| direction(&e));
    let position = |key| table.required(key).and_then(|e| e.number(l::POSITION));
    let (first, last) = (position("start_position"), position("end_position"));
    if let (Some(first), Some(last)) = (first, last)
        && first == last
    {
        table.error(format!(
            "start_position and end_position are both {first} m, expected a distance between them"
        ));
    }
    let layers = table.get("layers").and_then(|e| e.integer(1, 1_000_000));
    table.required("end_time");
    let span = span(&table);
    table.finish();
    let release = SequentialRelease {
        selection: Default::default(),
        axis: axis?,
        start_position: first?,
        end_position: last?,
        layers: layers.map_or(LAYERS, |n| n as u32),
        span,
    };
    Some((selection, release))
}

/// The colliders with their meshes read and sized.
pub(super) fn build_colliders(
    file: &SceneFile,
    load: &mut LoadMesh,
    errors: &mut Vec<Finding>,
) -> Vec<Collider> {
    let mut build = |spec: &ColliderSpec| {
        let mut collider = spec.collider.clone();
        if let Some(mesh) = &spec.mesh {
            match load(&mesh.path).map_err(|e| e.to_string()) {
                Ok(read) => {
                    collider.shape = ColliderShape::Mesh(Arc::new(placed(read, &mesh.placement)));
                }
                Err(message) => errors.push(Finding::new(&spec.at, message)),
            }
        }
        collider
    };
    file.colliders.iter().map(&mut build).collect()
}

/// Applies up axis, size and anchor.
pub(super) fn placed(mut mesh: TriangleMesh, placement: &Placement) -> TriangleMesh {
    let Some(bounds) = bounds_of(mesh.points.iter().copied()) else {
        return mesh;
    };
    let (up, factor) = (placement.up.to_world_up(), placement.factor(&bounds));
    for p in &mut mesh.points {
        *p = (up * (factor * DVec3::from(*p))).to_array();
    }
    if let Some(bounds) = bounds_of(mesh.points.iter().copied()) {
        let anchor = placement.anchor_of(&bounds);
        for p in &mut mesh.points {
            *p = (DVec3::from(*p) - anchor).to_array();
        }
    }
    mesh
}

/// The conditions with object numbers.
pub(super) fn build_conditions(
    specs: &ConditionSpecs,
    ids: &ObjectIds,
    errors: &mut Vec<Finding>,
) -> Conditions {
    let mut numbered = |spec: &SelectionSpec| {
        let name = spec.object.as_ref();
        let object = name.map(|name| ids.find(name, &spec.at, errors).unwrap_or_default());
        Selection {
            object,
            region: spec.region,
        }
    };
    let mut conditions = Conditions {
        domain_policy: specs.domain_policy,
        damping: specs.damping,
        settle: specs.settle,
        transfer: specs.transfer,
        rpic_damping: specs.rpic_damping,
        ..Default::default()
    };
    for (spec, motion) in &specs.prescribed {
        conditions.prescribed.push(PrescribedMotion {
            selection: numbered(spec),
            ..*motion
        });
    }
    for (spec, impulse) in &specs.impulses {
        conditions.impulses.push(RegionImpulse {
            selection: numbered(spec),
            ..*impulse
        });
    }
    for (spec, release) in &specs.releases {
        conditions.releases.push(SequentialRelease {
            selection: numbered(spec),
            ..*release
        });
    }
    conditions
}
