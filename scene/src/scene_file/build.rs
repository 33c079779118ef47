//! [`SceneFile`] and its assets to a [`Scene`]: place, select, fill, bind, assemble.

use std::{collections::HashMap, error::Error};

use cosplat_sim_core::scene::{Aabb, Fidelity, Scene, TriangleMesh};
use glam::{DQuat, DVec3};

use super::{
    assembly::{Part, default_domain, push},
    boundaries, captures, cells, checks, contact,
    edit::Unplaced,
    error::{At, Finding, SceneErrors},
    formed,
    ids::ObjectIds,
    objects::MAX_NAME,
    placement::Rigid,
    probes, regions,
    report::{AssetReport, BuildReport},
    sampling::{self, Body, Looks, Rest, Sampled},
    select::Placed,
    solver,
    spec::*,
};
use crate::{
    assets::{Gaussians, ReadReport, generate, objects::Objects},
    bounds::bounds_of,
    floaters::core,
};

/// Reads the asset file that a scene file names.
pub type Load<'a> =
    dyn FnMut(&str) -> Result<(Gaussians, ReadReport), Box<dyn Error + Send + Sync>> + 'a;

/// Reads the triangle mesh file that a scene file names.
pub type LoadMesh<'a> = dyn FnMut(&str) -> Result<TriangleMesh, Box<dyn Error + Send + Sync>> + 'a;

/// Reads the file of objects that a scene file names, for an asset file with so many rows.
pub type LoadObjects<'a> =
    dyn FnMut(&str, &str, usize) -> Result<Objects, Box<dyn Error + Send + Sync>> + 'a;

/// A part that an object makes, with its geometry.
struct NewPart {
    name: String,
    body: Body,
    world_from_body: Rigid,
    regions: Vec<RegionSpec>,
}

/// The part that a shape or mesh makes; none where it is empty.
fn formed_part(spec: &ObjectSpec, load_mesh: &mut LoadMesh) -> Result<Vec<NewPart>, Finding> {
    let formed = formed::body(spec, load_mesh);
    let formed = formed.map_err(|why| Finding::new(&spec.geometry_at, why))?;
    let unnamed = |_: &[String]| Err("`names` needs an asset with a file of objects".to_owned());
    let regions = spec.regions.iter().map(|r| r.resolved(unnamed));
    let regions: Vec<RegionSpec> = regions.collect::<Result<_, _>>()?;
    let part = |(body, world_from_body)| NewPart {
        name: spec.name.clone(),
        body,
        world_from_body,
        regions: regions.clone(),
    };
    Ok(formed.into_iter().map(part).collect())
}

/// Builds the scene that a file describes; `load` reads the asset files. A mesh or a file of objects is an error: see
/// [`build_with_files`].
///
/// # Errors
/// Everything that is wrong with the assets, selections and sizes, each with line and field.
pub fn build(file: &SceneFile, load: &mut Load) -> Result<(Scene, BuildReport), SceneErrors> {
    let nothing = |path: &str| format!("there is nothing to read {path} with");
    build_with_files(
        file,
        load,
        &mut |path| Err(nothing(path).into()),
        &mut |path, _, _| Err(nothing(path).into()),
    )
}

/// Like [`build`]; `load_mesh` reads the files of meshes, `load_objects` those of objects.
///
/// # Errors
/// Those of [`build`], and everything that is wrong with these files.
pub fn build_with_files(
    file: &SceneFile,
    load: &mut Load,
    load_mesh: &mut LoadMesh,
    load_objects: &mut LoadObjects,
) -> Result<(Scene, BuildReport), SceneErrors> {
    let mut builder = Builder {
        file,
        errors: Vec::new(),
        report: BuildReport {
            warnings: file.warnings.clone(),
            ..BuildReport::default()
        },
        bodies: Vec::new(),
        known: HashMap::new(),
        selections: selections(file),
        parts: Vec::new(),
    };
    let place = |asset| builder.place(asset, load, load_objects);
    let assets: Vec<_> = file.assets.iter().map(place).collect();
    for spec in &file.objects {
        builder.add(spec, &assets, load_mesh);
    }
    builder.check_names();
    SceneErrors::check(std::mem::take(&mut builder.errors))?;
    builder.report_unselected(&assets);
    let dx = cells::size(file, &builder.parts, &builder.bodies)?;
    let mut scene = builder.assemble(dx);
    let errors = &mut builder.errors;
    scene.colliders = boundaries::build_colliders(file, load_mesh, errors);
    let ids = ObjectIds::new(&scene.objects);
    scene.probes = probes::build(&file.probes, &ids, errors);
    scene.contact = contact::build(&file.contact, &ids, errors);
    scene.conditions = boundaries::build_conditions(&file.conditions, &ids, errors);
    SceneErrors::check(std::mem::take(&mut builder.errors))?;
    let mut report = builder.report;
    let specs: Vec<&ObjectSpec> = builder.parts.iter().map(|p| p.spec).collect();
    solver::choose(&mut scene, file, &specs, &mut report);
    let places: Vec<&At> = specs.iter().map(|spec| &spec.at).collect();
    checks::check(&scene, file, &places, &mut report)?;
    Ok((scene, report))
}

struct Builder<'f> {
    file: &'f SceneFile,
    errors: Vec<Finding>,
    report: BuildReport,
    bodies: Vec<Body>,
    /// Bodies by what makes them.
    known: HashMap<String, usize>,
    /// Per asset what objects select of it.
    selections: Vec<Vec<&'f Select>>,
    parts: Vec<Part<'f>>,
}

/// Bodies with equal keys, printed, are equal: clones are filled once.
#[derive(Debug)]
#[expect(dead_code, reason = "read by being printed")]
struct BodyKey<'f> {
    geometry: &'f Geometry,
    shaping: (Axis, Size, Anchor),
    rest: Option<Rest>,
    /// Number of the part of a split object.
    part: usize,
}

/// What becomes of a body while objects are made of it.
#[derive(Default)]
enum Made {
    /// Nothing needs it any more.
    #[default]
    Used,
    Body(Body),
    /// Sampled, and the rotation of the body's frame.
    Sampled(Sampled, DQuat),
}

/// A placed asset and the rotation that its placement applied.
type PlacedAsset = Option<(Placed, DQuat)>;

impl<'f> Builder<'f> {
    fn error(&mut self, at: &At, message: impl Into<String>) {
        self.errors.push(Finding::new(at, message));
    }

    /// Reads an asset, leaves out what is nearly transparent and applies the asset's own placement.
    fn place(
        &mut self,
        spec: &AssetSpec,
        load: &mut Load,
        load_objects: &mut LoadObjects,
    ) -> PlacedAsset {
        let loaded = match &spec.source {
            AssetSource::Path(path) => load(path).map_err(|e| e.to_string()),
            AssetSource::Builtin(name) => generate::builtin(name)
                .map(|g| (g, ReadReport::default()))
                .map_err(|e| e.to_string()),
        };
        let (all, read) = loaded.map_err(|e| self.error(&spec.at, e)).ok()?;
        if read.dropped.total() > 0 {
            let message = format!(
                "{} of {} Gaussians of the file are bad and left out: {}",
                read.dropped.total(),
                read.count,
                read.dropped
            );
            self.report.warnings.push(Finding::new(&spec.at, message));
        }
        let objects = match (&spec.objects, &spec.source) {
            (Some(file), AssetSource::Path(path)) => match load_objects(file, path, read.count) {
                Ok(objects) => Some(objects.subset(&read.rows())),
                Err(error) => {
                    self.error(&spec.at, error.to_string());
                    return None;
                }
            },
            _ => None,
        };
        let count = all.len();
        let keep = |&i: &usize| f64::from(all.opacity[i]) >= spec.min_opacity;
        let kept: Vec<usize> = (0..count).filter(keep).collect();
        let mut gaussians = Unplaced::new(all, read.exact).subset(&kept);
        let (Some(raw), Some(found)) = (
            bounds_of(gaussians.position.iter().copied()),
            core(&gaussians.position),
        ) else {
            let message = format!(
                "none of its {count} Gaussians reaches `min_opacity`, which is {}",
                spec.min_opacity
            );
            self.error(&spec.at, message);
            return None;
        };
        let suspicious = captures::of_file(&gaussians, &found.0).into_iter();
        let suspicious = suspicious.map(|message| Finding::new(&spec.at, message));
        self.report.warnings.extend(suspicious);
        let is_shaped = spec.placement.depends_on_box();
        self.report_floating(found.1, gaussians.len(), is_shaped, &spec.at);
        let up = self.shape(&spec.placement, &mut gaussians, &found.0, &spec.at)?;
        let rigid = spec.placement.rigid();
        gaussians.transform(rigid.rotation, 1.0, rigid.translation);
        self.report.assets.push(AssetReport {
            name: spec.name.clone(),
            source: spec.source.clone(),
            gaussians: count,
            transparent: count - kept.len(),
            raw_bounds: raw,
            placed_bounds: bounds_of(gaussians.position.iter().copied()).unwrap_or(raw),
        });
        let index = kept.iter().map(|&i| i as u64).collect();
        let placed = Placed {
            gaussians,
            index,
            objects: objects.map(|objects| objects.subset(&kept)),
        };
        Some((placed, rigid.rotation * up))
    }

    /// Warns about Gaussians that float, where that matters.
    fn report_floating(&mut self, floating: usize, count: usize, matters: bool, at: &At) {
        if matters && floating > 0 {
            let message = format!(
                "{floating} of its {count} Gaussians float far outside of the rest: \
                 they count neither for its size and place nor as matter"
            );
            self.report.warnings.push(Finding::new(at, message));
        }
    }

    /// Applies `up`, `scale` or `height`, and `anchor` to Gaussians whose size a box tells; the rotation is that of `up`.
    fn shape(
        &mut self,
        placement: &Placement,
        g: &mut Unplaced,
        size: &Aabb,
        at: &At,
    ) -> Option<DQuat> {
        let factor = placement.factor(size);
        if !(factor.is_finite() && factor > 0.0) {
            self.error(
                at,
                "is flat along its up axis: give `scale` instead of `height`",
            );
            return None;
        }
        let up = placement.up.to_world_up();
        let corners = [size.min, size.max].map(|x| (up * (DVec3::from(x) * factor)).to_array());
        let turned = bounds_of(corners.into_iter())?;
        g.transform(up, factor, -placement.anchor_of(&turned));
        Some(up)
    }

    /// Adds the part or, for split objects, the parts of an object.
    fn add(&mut self, spec: &'f ObjectSpec, assets: &[PlacedAsset], load_mesh: &mut LoadMesh) {
        let rest = match (spec.fidelity, &spec.geometry) {
            (Fidelity::Static, _) => None,
            (_, Geometry::Shape { .. } | Geometry::Mesh { .. }) => Some(Rest::Formed),
            (_, Geometry::Asset { .. }) => Some(match spec.particles {
                ParticleMode::Filled { closed_below } => Rest::Filled { closed_below },
                ParticleMode::PerGaussian => Rest::PerGaussian,
            }),
        };
        let placement = &spec.placement;
        let key = |part| {
            let key = BodyKey {
                geometry: &spec.geometry,
                shaping: (placement.up, placement.size, placement.anchor),
                rest,
                part,
            };
            // Debug prints numbers to the last bit.
            format!("{key:?}")
        };
        let made = match &spec.geometry {
            Geometry::Shape { .. } | Geometry::Mesh { .. } => formed_part(spec, load_mesh),
            // An asset that failed to load has been reported.
            Geometry::Asset { asset, .. } => match &assets[*asset] {
                Some((placed, rotation)) => self.asset_parts(spec, placed, *rotation),
                None => return,
            },
        };
        let made = match made {
            Ok(made) => made,
            Err(finding) => return self.errors.push(finding),
        };
        for (n, part) in made.into_iter().enumerate() {
            let next = self.bodies.len();
            let number = *self.known.entry(key(n)).or_insert(next);
            if number == next {
                let body = part.body;
                self.bodies.push(Body { rest, ..body });
            }
            self.parts.push(Part {
                spec,
                name: part.name,
                body: number,
                world_from_body: part.world_from_body,
                regions: part.regions,
            });
        }
    }

    /// What an object takes of its asset: one part, or those that splitting makes.
    fn asset_parts(
        &mut self,
        spec: &ObjectSpec,
        placed: &Placed,
        rotation: DQuat,
    ) -> Result<Vec<NewPart>, Finding> {
        let Geometry::Asset {
            asset,
            select,
            split,
        } = &spec.geometry
        else {
            return Ok(Vec::new());
        };
        let chosen = match select {
            None => (0..placed.gaussians.len()).collect(),
            Some(select) => placed
                .select(select, &self.selections[*asset])
                .map_err(|why| Finding::new(&spec.geometry_at, why))?,
        };
        let wrong = |why| Finding::new(&spec.at, why);
        let (names, parts): (Vec<String>, Vec<_>) = match split {
            None => (vec![spec.name.clone()], vec![chosen]),
            Some(split) => {
                let parts = placed.split(&chosen, *split).map_err(wrong)?.into_iter();
                let named = |(suffix, part)| (format!("{}_{suffix}", spec.name), part);
                parts.map(named).unzip()
            }
        };
        if let Some(name) = names.iter().find(|name| name.len() > MAX_NAME) {
            let length = name.len();
            return Err(wrong(format!(
                "makes an object `{name}` by splitting, whose name is {length} bytes long, expected at most {MAX_NAME}"
            )));
        }
        let bodies = self.asset_bodies(spec, placed, rotation, &parts);
        let made = names.into_iter().zip(&parts).zip(bodies);
        made.map(|((name, part), (body, world_from_body))| {
            let is_named = |names: &[String]| {
                let all = placed.is_named(names)?;
                Ok(part.iter().map(|&i| all[i]).collect())
            };
            let regions = spec.regions.iter().map(|r| r.resolved(is_named));
            Ok(NewPart {
                name,
                body,
                world_from_body,
                regions: regions.collect::<Result<_, _>>()?,
            })
        })
        .collect()
    }

    /// Bodies of the parts of an asset. All parts of a split object are shaped about their common box, so that
    /// they stay together.
    fn asset_bodies(
        &mut self,
        spec: &ObjectSpec,
        placed: &Placed,
        rotation: DQuat,
        parts: &[Vec<usize>],
    ) -> Vec<(Body, Rigid)> {
        let mut all = placed.gaussians.subset(&parts.concat());
        let Some((size, floating)) = core(&all.position) else {
            return Vec::new();
        };
        let matters = spec.fidelity != Fidelity::Static || spec.placement.depends_on_box();
        self.report_floating(floating, all.len(), matters, &spec.at);
        let Some(up) = self.shape(&spec.placement, &mut all, &size, &spec.at) else {
            return Vec::new();
        };
        let mut first = 0;
        let mut bodies = Vec::new();
        for part in parts {
            let range: Vec<usize> = (first..first + part.len()).collect();
            first += part.len();
            let gaussians = all.subset(&range);
            let Some((bounds, _)) = core(&gaussians.position) else {
                continue;
            };
            if let Some(message) = captures::of_body(&gaussians, &bounds) {
                self.report.warnings.push(Finding::new(&spec.at, message));
            }
            let body = Body {
                looks: Looks::Captured(gaussians.placed()),
                rest: None,
                bounds,
                body_from_asset: up * rotation,
            };
            bodies.push((body, spec.placement.rigid()));
        }
        bodies
    }

    /// Splitting makes names; none of them may be taken.
    fn check_names(&mut self) {
        let mut taken: HashMap<&str, &Part> = HashMap::new();
        for part in &self.parts {
            let Some(other) = taken.get(part.name.as_str()) else {
                taken.insert(&part.name, part);
                continue;
            };
            let message = format!(
                "object `{}` exists already: `{}` of line {} makes it by splitting",
                part.name, other.spec.name, other.spec.at.line
            );
            self.errors.push(Finding::new(&part.spec.at, message));
        }
    }

    /// Warns about Gaussians of an asset that no object shows, and about those that two selections share.
    fn report_unselected(&mut self, assets: &[PlacedAsset]) {
        let mut whole = vec![false; assets.len()];
        for object in &self.file.objects {
            if let Geometry::Asset { asset, select, .. } = &object.geometry
                && !object.is_clone
            {
                whole[*asset] |= select.is_none();
            }
        }
        for (a, placed) in assets.iter().enumerate() {
            let Some((placed, _)) = placed else { continue };
            let mut users = vec![0u32; placed.gaussians.len()];
            let selections = &self.selections[a];
            for select in selections {
                for i in placed.select(select, selections).unwrap_or_default() {
                    users[i] += 1;
                }
            }
            let unused = users.iter().filter(|u| **u == 0).count();
            let shared = users.iter().filter(|u| **u > 1).count();
            let at = &self.file.assets[a].at;
            if !whole[a] && unused > 0 {
                let message = format!(
                    "{unused} of {} Gaussians belong to no object and are not shown: \
                     an object with `select = {{ rest = true }}` and `fidelity = \"static\"` would show them",
                    users.len()
                );
                self.report.warnings.push(Finding::new(at, message));
            }
            if shared > 0 {
                let message = format!(
                    "{shared} of {} Gaussians are selected by more than one object",
                    users.len()
                );
                self.report.warnings.push(Finding::new(at, message));
            }
        }
    }

    fn assemble(&mut self, dx: f64) -> Scene {
        let file = self.file;
        let numerics = sampling::Numerics {
            dx,
            particles_per_cell: file.particles_per_cell,
            jitter: file.jitter,
            seed: file.seed,
        };
        let widths = self.bodies.iter().map(|body| body.looks.widths());
        let (sh_degree, feature_dim) = widths.fold((0, 0), |a, b| (a.0.max(b.0), a.1.max(b.1)));
        let mut scene = Scene {
            name: file.name.clone(),
            gravity: file.gravity,
            dx,
            frame_rate: file.frame_rate,
            cfl: file.cfl,
            tolerance: file.tolerance,
            seed: file.seed,
            domain: Aabb {
                min: [0.0; 3],
                max: [0.0; 3],
            },
            objects: Vec::new(),
            contact: Default::default(),
            colliders: Vec::new(),
            pinned_regions: file.pinned_regions.clone(),
            conditions: Default::default(),
            particles: Default::default(),
            gaussians: Gaussians {
                sh_degree,
                feature_dim,
                ..Gaussians::default()
            },
            binding: Default::default(),
            probes: Vec::new(),
        };
        self.fill(&mut scene, &numerics);
        scene.domain = file.domain.unwrap_or_else(|| default_domain(&scene));
        scene
    }

    /// Samples the bodies and puts the objects that are made of them into the scene.
    fn fill(&mut self, scene: &mut Scene, numerics: &sampling::Numerics) {
        // A body is kept from its first object to its last: one at a time where each has its own.
        let mut left = vec![0usize; self.bodies.len()];
        for part in &self.parts {
            left[part.body] += 1;
        }
        let mut bodies: Vec<_> = self.bodies.drain(..).map(Made::Body).collect();
        for part in &self.parts {
            let made = &mut bodies[part.body];
            let (sampled, body_from_asset) = match std::mem::take(made) {
                Made::Body(body) => {
                    let done = sampling::sample(body.looks, body.rest, numerics);
                    if let Some(warning) = done.as_ref().ok().and_then(|d| d.warning.as_ref()) {
                        let message = format!("object `{}`: {warning}", part.name);
                        let warnings = &mut self.report.warnings;
                        warnings.push(Finding::new(&part.spec.at, message));
                    }
                    let failed = |message| self.errors.push(Finding::new(&part.spec.at, message));
                    (
                        done.map_err(failed).unwrap_or_default(),
                        body.body_from_asset,
                    )
                }
                Made::Sampled(sampled, body_from_asset) => (sampled, body_from_asset),
                Made::Used => continue,
            };
            self.report.fills.push(sampled.fill);
            push(scene, part, &sampled, body_from_asset);
            left[part.body] -= 1;
            if left[part.body] > 0 {
                *made = Made::Sampled(sampled, body_from_asset);
            }
            let errors = regions::arrange(scene, &part.regions, numerics.dx);
            self.errors.extend(errors);
        }
    }
}

/// Per asset the selections that objects make from it; those of clones are their source's.
fn selections(file: &SceneFile) -> Vec<Vec<&Select>> {
    let mut selections = vec![Vec::new(); file.assets.len()];
    for object in file.objects.iter().filter(|object| !object.is_clone) {
        if let Geometry::Asset {
            asset,
            select: Some(select),
            ..
        } = &object.geometry
        {
            selections[*asset].push(select);
        }
    }
    selections
}
