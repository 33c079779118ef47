//! Text to [`SceneFile`]: the top level, assets, colliders and probes.

use toml::de::DeTable;

use super::{
    boundaries::{self, turned_box},
    contact,
    error::{At, Finding, SceneErrors, suggest},
    limits as l,
    objects::{self, Names},
    placement,
    quality::Quality,
    reader::{Context, Entry, Table},
    shapes::JITTER,
    spec::{AssetSource, AssetSpec, ProbeKindSpec, ProbeSpec, Resolution, SceneFile},
    view,
};
use crate::assets::generate::BUILTINS;

/// The one version of the format.
const VERSION: u64 = 1;

/// Parses and checks a scene file; see [`SceneFile::parse`].
pub(super) fn parse(text: &str) -> Result<SceneFile, SceneErrors> {
    let context = Context::new(text);
    let (root, syntax) = DeTable::parse_recoverable(text);
    for error in &syntax {
        let span = error.span().unwrap_or_default();
        context.error(&context.at(&span, ""), error.message());
    }
    // What a recovering parser makes of a broken line would only raise misleading follow-up errors.
    if !syntax.is_empty() {
        SceneErrors::check(context.into_findings())?;
        return Err(SceneErrors(Vec::new()));
    }
    let mut warnings = Vec::new();
    let table = context.table(root.get_ref(), String::new(), 0..0);
    let file = scene(&table, &mut warnings);
    table.finish();
    SceneErrors::check(context.into_findings())?;
    Ok(SceneFile { warnings, ..file })
}

/// Values that cannot be read are replaced by defaults: the error is noted and the result thrown away.
fn scene(table: &Table, warnings: &mut Vec<Finding>) -> SceneFile {
    check_version(table);
    let name = table.get("name").and_then(|e| e.text()).unwrap_or("scene");
    let gravity = table
        .get("gravity")
        .and_then(|e| e.numbers(l::ACCELERATION));
    let quality = table.get("quality").and_then(|e| e.choice(&Quality::ALL));
    let preset = quality.unwrap_or_default().numbers();
    let (resolution, resolution_at) = resolution(table, preset.resolution);
    let number = |key, bounds, default| {
        let value = table.get(key).and_then(|e| e.number(bounds));
        value.unwrap_or(default)
    };
    let particles_per_cell = number(
        "particles_per_cell",
        l::PARTICLES_PER_CELL,
        preset.particles_per_cell,
    );
    let frame_rate = number("frame_rate", l::FRAME_RATE, 60.0);
    let cfl = number("cfl", l::CFL, preset.cfl);
    if cfl > 1.0
        && let Some(entry) = table.get("cfl")
    {
        warnings.push(Finding::new(&entry.at, beyond_the_limit(cfl)));
    }
    let tolerance = number("tolerance", l::TOLERANCE, preset.tolerance);
    let jitter = number("jitter", l::JITTER, JITTER);
    let seed = table
        .get("seed")
        .and_then(|e| e.integer(0, i64::MAX as u64));
    let (domain, policy) = boundaries::domain(table);
    let mut assets = assets(table);
    let mut object_names = Names::default();
    let objects = objects::read(table, &mut assets, &mut object_names, warnings);
    let mut collider_names = Names::default();
    let colliders = table.tables("colliders");
    let colliders = colliders
        .iter()
        .filter_map(|e| boundaries::collider(e.table()?, &mut collider_names));
    let colliders = colliders.collect();
    let pinned = table.tables("pinned_regions");
    let pinned_regions = pinned
        .iter()
        .filter_map(|e| boundaries::pinned_region(e.table()?))
        .collect();
    let conditions = boundaries::conditions(table, policy, &object_names);
    let contact = contact::read(table, &object_names);
    let mut probe_names = Names::default();
    let probes = table.tables("probes");
    let probes = probes
        .iter()
        .filter_map(|e| probe(e.table()?, &mut probe_names, &object_names))
        .collect();
    SceneFile {
        name: name.into(),
        gravity: gravity.unwrap_or([0.0, -9.81, 0.0]),
        resolution,
        resolution_at,
        particles_per_cell,
        frame_rate,
        cfl,
        tolerance,
        jitter,
        seed: seed.unwrap_or(0),
        domain,
        assets,
        objects,
        contact,
        colliders,
        pinned_regions,
        conditions,
        probes,
        view: view::read(table),
        warnings: Vec::new(),
    }
}

fn check_version(table: &Table) {
    if let Some(version) = table.required("version") {
        let given = version.integer(0, u64::MAX);
        if given.is_some_and(|v| v != VERSION) {
            version.error(format!(
                "is {}, and this program reads version {VERSION}",
                given.unwrap_or_default()
            ));
        }
    }
}

/// The warning about a `cfl` above 1.
fn beyond_the_limit(cfl: f64) -> String {
    format!(
        "{cfl} of the stability limit blows up what flies alone, and leaves it to the guard; expected 1 or less"
    )
}

fn resolution(table: &Table, preset: Resolution) -> (Resolution, At) {
    let default = (preset, At::default());
    let Some((key, entry)) = table.one_of(&["dx", "cells_per_object"]) else {
        return default;
    };
    let resolution = match key {
        "dx" => entry.number(l::DX).map(Resolution::Dx),
        _ => entry
            .number(l::CELLS_PER_OBJECT)
            .map(Resolution::CellsPerObject),
    };
    (resolution.unwrap_or(default.0), entry.at)
}

fn assets(table: &Table) -> Vec<AssetSpec> {
    let mut names = Names::default();
    let entries = table.tables("assets");
    let mut read = |entry: &Entry| {
        let table = entry.table()?;
        let name = names.take(&table, "asset");
        let source = asset_source(&table);
        if source.is_none() {
            table.error("has no source: give `path` or `builtin`");
        }
        let asset = AssetSpec {
            name: name.unwrap_or_default(),
            at: table.at.clone(),
            objects: objects_file(&table, source.as_ref()),
            source: source.unwrap_or(AssetSource::Builtin(String::new())),
            min_opacity: min_opacity(&table),
            placement: placement::read(&table),
        };
        table.finish();
        Some(asset)
    };
    entries.iter().filter_map(&mut read).collect()
}

/// The `path` or `builtin` key.
pub(super) fn asset_source(table: &Table) -> Option<AssetSource> {
    let (key, entry) = table.one_of(&["path", "builtin"])?;
    let text = entry.text().unwrap_or_default().to_owned();
    Some(match key {
        "path" => AssetSource::Path(text),
        _ => {
            if !text.is_empty() && !BUILTINS.contains(&text.as_str()) {
                let hint = suggest(&text, BUILTINS);
                entry.error(format!("builtin `{text}` does not exist: {hint}"));
            }
            AssetSource::Builtin(text)
        }
    })
}

/// The `objects` key of an asset.
pub(super) fn objects_file(table: &Table, source: Option<&AssetSource>) -> Option<String> {
    let entry = table.get("objects")?;
    if matches!(source, Some(AssetSource::Builtin(_))) {
        entry.error("belongs to a `path`: a generated asset has no file of objects");
    }
    entry.text().map(str::to_owned)
}

/// The `min_opacity` key.
pub(super) fn min_opacity(table: &Table) -> f64 {
    let given = table.get("min_opacity").and_then(|e| e.number(l::OPACITY));
    // Renderers skip what blends with less than 1/255.
    given.unwrap_or(1.0 / 255.0)
}

fn probe(table: Table, names: &mut Names, objects: &Names) -> Option<ProbeSpec> {
    let name = names.take(&table, "probe");
    let at = table.at.clone();
    #[derive(Clone, Copy)]
    enum Kind {
        Extent,
        Point,
        MaterialPoint,
        Deviation,
    }
    let kind = table.required("kind").and_then(|e| {
        e.choice(&[
            ("extent", Kind::Extent),
            ("point", Kind::Point),
            ("material_point", Kind::MaterialPoint),
            ("deviation", Kind::Deviation),
        ])
    });
    let object = || {
        let entry = table.required("object")?;
        let name = entry.text()?;
        if !objects.makes(name) {
            let hint = suggest(name, objects.all());
            entry.error(format!("object `{name}` does not exist: {hint}"));
        }
        Some(name.to_owned())
    };
    let position = || table.required("position")?.numbers(l::POSITION);
    let kind = match kind {
        Some(Kind::Extent) => {
            let share = table.get("share").and_then(|e| e.number(l::SHARE));
            let share = share.unwrap_or(1.0);
            object().map(|object| ProbeKindSpec::Extent { object, share })
        }
        Some(Kind::Point) => position().map(|position| ProbeKindSpec::Point { position }),
        Some(Kind::MaterialPoint) => {
            let (object, position) = (object(), position());
            object
                .zip(position)
                .map(|(object, position)| ProbeKindSpec::MaterialPoint { object, position })
        }
        Some(Kind::Deviation) => {
            let position = table.required("position").and_then(|e| e.formulas());
            let bounds = table.get("box").map(|e| e.table().and_then(turned_box));
            object()
                .zip(position)
                .map(|(object, position)| ProbeKindSpec::Deviation {
                    object,
                    position,
                    bounds: bounds.flatten(),
                })
        }
        None => {
            // The keys are known, whatever the kind was meant to be.
            for key in ["object", "position", "box", "share"] {
                table.get(key);
            }
            None
        }
    };
    table.finish();
    Some(ProbeSpec {
        name: name?,
        at,
        kind: kind?,
    })
}
