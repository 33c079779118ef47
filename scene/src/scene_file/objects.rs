//! Text to [`ObjectSpec`]: geometry, material, motion.

use std::collections::BTreeMap;

use cosplat_sim_core::{
    materials::{Law, Material},
    scene::{Fidelity, Solver},
};

use super::{
    boundaries::turned_box,
    clones::Clones,
    contact,
    error::{Finding, suggest},
    limits as l, materials,
    parse::{asset_source, min_opacity, objects_file},
    placement,
    reader::{Entry, Table},
    regions,
    spec::{AssetSpec, Geometry, Link, ObjectSpec, ParticleMode, Placement, Select, Shape, Split},
};

/// Longest name [bytes]; what the wire carries.
pub(super) const MAX_NAME: usize = 63;
/// Keys that say what an object looks like.
const GEOMETRY: [&str; 4] = ["asset", "path", "builtin", "shape"];

/// Names taken so far and the line that took them.
#[derive(Default)]
pub(super) struct Names(BTreeMap<String, usize>);

impl Names {
    /// The `name` key, which is required, never inherited, and unique among its kind.
    pub fn take(&mut self, table: &Table, kind: &str) -> Option<String> {
        let Some(entry) = table.get_own("name") else {
            table.error("`name` is missing");
            return None;
        };
        let name = entry.text()?;
        if name.len() > MAX_NAME {
            let length = name.len();
            entry.error(format!(
                "is {length} bytes long, expected at most {MAX_NAME}"
            ));
        }
        if let Some(line) = self.0.insert(name.to_owned(), entry.at.line) {
            entry.error(format!("{kind} `{name}` exists already, in line {line}"));
        }
        Some(name.to_owned())
    }

    /// Whether this is one of them, or one that splitting may make of them: with a number or name behind. Building
    /// checks those.
    pub fn makes(&self, name: &str) -> bool {
        let mut prefixes = name.match_indices('_').map(|(at, _)| &name[..at]);
        self.0.contains_key(name) || prefixes.any(|of| self.0.contains_key(of))
    }

    /// All of them, also those of tables with errors.
    pub fn all(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

/// Reads `[materials]` and `[[objects]]`; assets written at their object are appended to `assets`.
pub(super) fn read(
    root: &Table,
    assets: &mut Vec<AssetSpec>,
    names: &mut Names,
    warnings: &mut Vec<Finding>,
) -> Vec<ObjectSpec> {
    let materials = materials::read(root, warnings);
    let Some(entry) = root.required("objects") else {
        return Vec::new();
    };
    let entries = entry.array().unwrap_or_default();
    if entries.is_empty() {
        entry.error("is empty, expected at least one object");
    }
    let mut clones = Clones::new(entries.iter().filter_map(Entry::raw_table).collect());
    let mut objects = Vec::with_capacity(entries.len());
    for entry in &entries {
        let Some(mut table) = entry.table() else {
            continue;
        };
        clones.inherit(&mut table);
        objects.extend(object(&table, names, &materials, assets, warnings));
        table.finish();
    }
    objects
}

fn object(
    table: &Table,
    names: &mut Names,
    known: &materials::Known,
    assets: &mut Vec<AssetSpec>,
    warnings: &mut Vec<Finding>,
) -> Option<ObjectSpec> {
    let name = names.take(table, "object");
    let fidelity = table
        .get("fidelity")
        .and_then(|e| e.choice(&Fidelity::NAMES));
    let fidelity = fidelity.unwrap_or(Fidelity::Mpm);
    let present = table.get("present").and_then(|e| e.boolean());
    let solver = table.get("solver").and_then(|e| e.choice(&Solver::NAMES));
    let geometry = geometry(table, assets);
    let geometry_at = match table.get("select") {
        Some(entry) => entry.at,
        None => table
            .one_of(&GEOMETRY)
            .map_or(table.at.clone(), |(_, e)| e.at),
    };
    let entry = match fidelity {
        Fidelity::Static => table.get("material"),
        _ => table.required("material"),
    };
    let material = entry.map(|e| materials::from_entry(&e, known, warnings));
    let closed_below = table.get("closed_below").and_then(|e| e.boolean());
    let filled = ParticleMode::Filled {
        closed_below: closed_below.unwrap_or(true),
    };
    let particles = table.get("particles").and_then(|e| {
        e.choice(&[
            ("filled", filled),
            ("per_gaussian", ParticleMode::PerGaussian),
        ])
    });
    let vector = |key, bounds| table.get(key).and_then(|e| e.numbers::<3>(bounds));
    let linear_velocity = vector("linear_velocity", l::SPEED);
    let angular_velocity = vector("angular_velocity", l::SPIN);
    let velocity_gradient = table.get("velocity_gradient").and_then(|e| {
        let rows = e.array()?;
        if rows.len() != 3 {
            e.error(format!("has {} rows, expected 3", rows.len()));
            return None;
        }
        let rows: Vec<_> = rows.iter().map(|row| row.numbers::<3>(l::RATE)).collect();
        Some([rows[0]?, rows[1]?, rows[2]?])
    });
    let [velocity, body_force] = ["velocity", "body_force"].map(|key| {
        let entry = table.get(key)?;
        let rigid = key == "velocity"
            && (fidelity == Fidelity::Rigid
                || matches!(&material, Some(Some(material)) if material.law.is_rigid()));
        if rigid {
            entry.error("cannot be had by one body: give `linear_velocity` and `angular_velocity`");
        } else if fidelity == Fidelity::Static {
            entry.error("has no effect on an object that is only shown");
        }
        entry.formulas()
    });
    let (surface, coherence) = (contact::surface(table), contact::coherence(table));
    let object = ObjectSpec {
        name: name?,
        at: table.at.clone(),
        geometry: geometry?,
        geometry_at,
        is_clone: table.get_own("clone").is_some(),
        placement: placement::read(table),
        material: material.unwrap_or_else(|| Some(static_material()))?,
        regions: regions::read(table, known, warnings),
        surface,
        coherence,
        present: present.unwrap_or(true),
        fidelity,
        solver,
        particles: particles.unwrap_or(filled),
        linear_velocity: linear_velocity.unwrap_or_default(),
        angular_velocity: angular_velocity.unwrap_or_default(),
        velocity_gradient: velocity_gradient.unwrap_or_default(),
        velocity,
        body_force,
    };
    Some(object)
}

/// Stands in for the material of static objects, which nothing reads.
fn static_material() -> Material {
    Material {
        name: "static".into(),
        law: Law::FixedCorotated,
        youngs_modulus: 1e6,
        poisson_ratio: 0.3,
        density: 1000.0,
        loss: 0.0,
    }
}

fn geometry(table: &Table, assets: &mut Vec<AssetSpec>) -> Option<Geometry> {
    if table.get_own("clone").is_some() {
        for key in GEOMETRY
            .iter()
            .chain(&["select", "split", "min_opacity", "objects"])
        {
            if let Some(entry) = table.get_own(key) {
                entry.error("cannot be given here: a clone takes its geometry from its source");
            }
        }
    }
    let Some((key, entry)) = table.one_of(&GEOMETRY) else {
        let keys = GEOMETRY.map(|k| format!("`{k}`")).join(", ");
        table.error(format!("has no geometry: give one of {keys}, `clone`"));
        return None;
    };
    let select = table.get("select").map(|e| e.table().and_then(select));
    let split = table.get("split").map(|e| split(&e));
    let opacity = table.get("min_opacity");
    let objects = table.get("objects");
    if key == "shape" {
        for (key, given) in [
            ("select", select.is_some()),
            ("split", split.is_some()),
            ("min_opacity", opacity.is_some()),
            ("objects", objects.is_some()),
        ] {
            if given {
                entry.error(format!("a shape has no `{key}`: it is for assets"));
            }
        }
        return shape(entry.table()?);
    }
    let asset = if key == "asset" {
        for entry in opacity.iter().chain(&objects) {
            entry.error("belongs to the asset's own table");
        }
        let name = entry.text()?;
        let found = assets.iter().position(|a| a.name == name);
        if found.is_none() {
            let names = assets.iter().map(|a| a.name.as_str());
            let hint = suggest(name, names.filter(|n| !n.is_empty()));
            entry.error(format!("asset `{name}` does not exist: {hint}"));
        }
        found?
    } else {
        inline_asset(table, &entry, assets)?
    };
    // Given but wrong is not the same as absent.
    let select = select.map_or(Some(None), |s| s.map(Some))?;
    let split = split.map_or(Some(None), |s| s.map(Some))?;
    // What belongs to no object is in no part.
    let parted = (split == Some(Split::Objects)).then_some(Select::Objects);
    Some(Geometry::Asset {
        asset,
        select: select.or(parted),
        split,
    })
}

/// An asset written at its object; one entry for clones of the same.
fn inline_asset(table: &Table, entry: &Entry, assets: &mut Vec<AssetSpec>) -> Option<usize> {
    let spec = AssetSpec {
        name: String::new(),
        at: entry.at.clone(),
        objects: objects_file(table, asset_source(table).as_ref()),
        source: asset_source(table)?,
        min_opacity: min_opacity(table),
        placement: Placement::default(),
    };
    let same = |a: &AssetSpec| {
        let same = (&a.source, &a.objects, a.min_opacity);
        a.name.is_empty() && same == (&spec.source, &spec.objects, spec.min_opacity)
    };
    let found = assets.iter().position(same);
    Some(found.unwrap_or_else(|| {
        assets.push(spec);
        assets.len() - 1
    }))
}

fn select(table: Table) -> Option<Select> {
    let keys = ["ranges", "ids", "names", "boxes", "component", "rest"];
    let found = table.one_of(&keys);
    let link = link(&table, matches!(found, Some(("component", _))));
    let selected = match found {
        Some(("ranges", entry)) => ranges(&entry).map(Select::Ranges),
        Some(("ids", entry)) => {
            let ids = entry.array()?;
            let ids = ids.iter().map(|e| e.integer(0, 1 << 24));
            ids.collect::<Option<_>>().map(Select::Ids)
        }
        Some(("names", entry)) => names(&entry).map(Select::Names),
        Some(("boxes", entry)) => {
            let boxes = entry.array()?;
            let boxes: Vec<_> = boxes.iter().map(|e| turned_box(e.table()?)).collect();
            boxes.into_iter().collect::<Option<_>>().map(Select::Boxes)
        }
        Some(("component", entry)) => {
            let index = entry.integer(0, 1 << 20);
            index.map(|i| Select::Component(i as usize, link))
        }
        Some((_, entry)) => match entry.boolean() {
            Some(true) => Some(Select::Rest),
            Some(false) => {
                entry.error("is false, expected true: leave `select` out to take everything");
                None
            }
            None => None,
        },
        None => {
            let keys = keys.map(|k| format!("`{k}`")).join(", ");
            table.error(format!("selects nothing: give one of {keys}"));
            None
        }
    };
    table.finish();
    selected
}

/// Names of objects of a file.
pub(super) fn names(entry: &Entry) -> Option<Vec<String>> {
    let names = entry.array()?;
    names.iter().map(|e| e.text().map(str::to_owned)).collect()
}

pub(super) fn ranges(entry: &Entry) -> Option<Vec<[u64; 2]>> {
    let range = |e: &Entry| {
        let ends = e.array()?;
        let [first, end] = ends.as_slice() else {
            e.error(format!(
                "has {} elements, expected [first, end]",
                ends.len()
            ));
            return None;
        };
        let (first, end) = (first.integer(0, 1 << 32)?, end.integer(0, 1 << 32)?);
        if first >= end {
            e.error(format!(
                "[{first}, {end}] is empty: `end` is the first index behind it"
            ));
            return None;
        }
        Some([first, end])
    };
    let ranges: Vec<_> = entry.array()?.iter().map(range).collect();
    ranges.into_iter().collect()
}

/// Keys of the connection test, which only components have.
fn link(table: &Table, known: bool) -> Link {
    let mut link = Link {
        distance: None,
        min_gaussians: 50,
    };
    if known {
        link.distance = table.get("link_distance").and_then(|e| e.number(l::LENGTH));
        let min = table
            .get("min_gaussians")
            .and_then(|e| e.integer(1, 1 << 32));
        link.min_gaussians = min.map_or(link.min_gaussians, |m| m as usize);
    }
    link
}

fn split(entry: &Entry) -> Option<Split> {
    #[derive(Clone, Copy, PartialEq)]
    enum By {
        Components,
        Ids,
        Objects,
    }
    let choices = [
        ("components", By::Components),
        ("ids", By::Ids),
        ("objects", By::Objects),
    ];
    if entry.is_text() {
        return Some(match entry.choice(&choices)? {
            By::Components => Split::Components(Link {
                distance: None,
                min_gaussians: 50,
            }),
            By::Ids => Split::Ids,
            By::Objects => Split::Objects,
        });
    }
    let table = entry.table()?;
    let by = table.required("by").and_then(|e| e.choice(&choices));
    let link = link(&table, matches!(by, None | Some(By::Components)));
    table.finish();
    Some(match by? {
        By::Components => Split::Components(link),
        By::Ids => Split::Ids,
        By::Objects => Split::Objects,
    })
}

/// Values of `shape.kind`.
#[derive(Clone, Copy)]
enum Kind {
    Box,
    Sphere,
    Cylinder,
    Slab,
    Mesh,
}

fn shape(table: Table) -> Option<Geometry> {
    let kind = table.required("kind").and_then(|e| {
        e.choice(&[
            ("box", Kind::Box),
            ("sphere", Kind::Sphere),
            ("cylinder", Kind::Cylinder),
            ("slab", Kind::Slab),
            ("mesh", Kind::Mesh),
        ])
    });
    let wall = table.get("wall");
    let path = match kind {
        Some(Kind::Mesh) => table.required("path").and_then(|e| e.text()),
        _ => None,
    };
    let shape = primitive(&table, kind, wall.as_ref());
    let wall = wall.and_then(|e| e.number(l::LENGTH));
    let color = table.get("color").and_then(|e| e.numbers::<3>(l::COLOR));
    let spacing = table.get("gaussian_spacing");
    let gaussian_spacing = spacing.and_then(|e| e.number(l::LENGTH));
    table.finish();
    let color = color.unwrap_or([0.6, 0.6, 0.6]).map(|c| c as f32);
    if let Some(path) = path {
        return Some(Geometry::Mesh {
            path: path.to_owned(),
            wall,
            color,
            gaussian_spacing,
        });
    }
    Some(Geometry::Shape {
        shape: shape?,
        wall,
        gaussian_spacing,
        color,
    })
}

/// The keys of a shape's size; none of a mesh, which has its own.
fn primitive(table: &Table, kind: Option<Kind>, wall: Option<&Entry>) -> Option<Shape> {
    let length = |key| table.required(key).and_then(|e| e.number(l::LENGTH));
    match kind {
        Some(Kind::Box) => table
            .required("size")
            .and_then(|e| e.numbers(l::LENGTH))
            .map(|size| Shape::Box { size }),
        Some(Kind::Sphere) => length("radius").map(|radius| Shape::Sphere { radius }),
        Some(Kind::Cylinder) => {
            let (radius, height) = (length("radius"), length("height"));
            let inner = table.get("inner_radius");
            let inner_radius = inner.as_ref().and_then(|e| e.number(l::LENGTH));
            let inner_radius = inner_radius.unwrap_or(0.0);
            if let (Some(wall), Some(_)) = (wall, &inner) {
                wall.error(
                    "excludes `inner_radius`, which is given too: a pipe has no cavity in its wall",
                );
            }
            if let (Some(inner), Some(radius)) = (inner, radius)
                && inner_radius >= radius
            {
                inner.error(format!(
                    "is {inner_radius} m, expected less than the radius, which is {radius} m"
                ));
            }
            radius.zip(height).map(|(radius, height)| Shape::Cylinder {
                radius,
                inner_radius,
                height,
            })
        }
        Some(Kind::Slab) => {
            let size = table.required("size").and_then(|e| e.numbers(l::LENGTH));
            let thickness = length("thickness");
            size.zip(thickness)
                .map(|(size, thickness)| Shape::Slab { size, thickness })
        }
        Some(Kind::Mesh) => None,
        None => {
            // The keys are known, whatever the kind was meant to be.
            for key in [
                "size",
                "radius",
                "inner_radius",
                "height",
                "thickness",
                "path",
            ] {
                table.get(key);
            }
            None
        }
    }
}
