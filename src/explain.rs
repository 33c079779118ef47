//! `cosplat explain`: what a scene file means, in scene units, and a picture of what cannot be seen.

mod precision;

use std::{
    fmt::{self, Write},
    fs,
    path::PathBuf,
};

use anyhow::Context;
use cosplat_scene::{
    assets::ply,
    diagram::diagram,
    load::{LoadedScene, load_scene_with},
    scene_file::{AssetReport, AssetSource},
    summary::{Extent, ObjectSummary, SceneSummary},
};
use cosplat_sim_core::{
    World,
    scene::{ColliderShape, ProbeKind, Scene, Surface},
};
use precision::PrecisionHint;
use serde::Serialize;

use crate::say;

/// Print what a scene file means: boxes, masses, materials, time step, cost.
#[derive(clap::Args)]
pub struct Args {
    /// The scene file.
    scene: PathBuf,
    /// Replace or add a value of the file, like dx=0.01, objects.0.friction=0.2 or 'colliders.0={name="floor", normal=[0, 1, 0]}';
    /// may be given several times.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Write the scene's Gaussians with boxes, pinned regions, domain and colliders drawn in.
    #[arg(long, value_name = "OUT.ply")]
    ply: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When the scene cannot be used or the PLY cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let loaded = load_scene_with(&args.scene, &args.settings)?;
    let explanation = Explanation::new(&loaded);
    if let Some(path) = &args.ply {
        let bytes = ply::write(&diagram(&loaded.scene));
        fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if args.json {
        say!("{}", serde_json::to_string(&explanation)?)?;
    } else {
        say!("{explanation}")?;
    }
    Ok(())
}

#[derive(Serialize)]
struct Explanation {
    #[serde(flatten)]
    summary: SceneSummary,
    precision: Option<PrecisionHint>,
    assets: Vec<Asset>,
    colliders: Vec<Collider>,
    pinned_regions: Vec<Pinned>,
    probes: Vec<String>,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct Asset {
    name: String,
    source: String,
    gaussians: usize,
    transparent: usize,
    raw_box: Extent,
    placed_box: Extent,
}

#[derive(Serialize)]
struct Pinned {
    /// Before it is turned.
    #[serde(flatten)]
    extent: Extent,
    /// About its middle.
    rotation: [f64; 4],
}

#[derive(Serialize)]
struct Collider {
    name: String,
    shape: &'static str,
    /// Where its origin is; a point of the surface of a half-space.
    point: [f64; 3],
    /// Of a half-space.
    #[serde(skip_serializing_if = "Option::is_none")]
    normal: Option<[f64; 3]>,
    surface: &'static str,
    /// That of what meets it when absent.
    friction: Option<f64>,
    restitution: f64,
}

impl Explanation {
    fn new(loaded: &LoadedScene) -> Self {
        let LoadedScene { scene, report, .. } = loaded;
        let summary = SceneSummary::new(scene);
        let refusal = World::check_scene(scene).err();
        let refusal = refusal.map(|error| format!("this scene cannot be simulated: {error}"));
        Self {
            precision: PrecisionHint::new(&summary),
            summary,
            assets: report.assets.iter().map(asset).collect(),
            colliders: colliders(scene),
            pinned_regions: scene
                .pinned_regions
                .iter()
                .map(|r| Pinned {
                    extent: r.bounds.bounds.into(),
                    rotation: r.bounds.rotation,
                })
                .collect(),
            probes: probes(scene),
            warnings: (report.warnings.iter().map(ToString::to_string))
                .chain(refusal)
                .collect(),
        }
    }
}

fn asset(report: &AssetReport) -> Asset {
    Asset {
        name: report.name.clone(),
        source: match &report.source {
            AssetSource::Path(path) => path.clone(),
            AssetSource::Builtin(name) => format!("builtin {name}"),
        },
        gaussians: report.gaussians,
        transparent: report.transparent,
        raw_box: report.raw_bounds.into(),
        placed_box: report.placed_bounds.into(),
    }
}

fn colliders(scene: &Scene) -> Vec<Collider> {
    let collider = |c: &cosplat_sim_core::scene::Collider| {
        let normal = match c.shape {
            ColliderShape::HalfSpace { normal } => Some(normal),
            _ => None,
        };
        Collider {
            name: c.name.clone(),
            shape: match c.shape {
                ColliderShape::HalfSpace { .. } => "half-space",
                ColliderShape::Box { .. } => "box",
                ColliderShape::Sphere { .. } => "sphere",
                ColliderShape::Cylinder { .. } => "cylinder",
                ColliderShape::Capsule { .. } => "capsule",
                ColliderShape::Mesh(_) => "mesh",
            },
            point: c.pose.translation,
            normal,
            surface: match c.surface {
                Surface::Sticky => "sticky",
                Surface::Slip => "slip",
                Surface::Separate => "separate",
            },
            friction: c.friction,
            restitution: c.restitution,
        }
    };
    scene.colliders.iter().map(collider).collect()
}

fn probes(scene: &Scene) -> Vec<String> {
    let name = |object: usize| scene.objects.get(object).map_or("?", |o| o.name.as_str());
    let probe = |p: &cosplat_sim_core::scene::Probe| {
        let what = match p.kind {
            ProbeKind::Extent { object, share } if share < 1.0 => {
                format!("extent of {share} of {}", name(object))
            }
            ProbeKind::Extent { object, .. } => format!("extent of {}", name(object)),
            ProbeKind::Point { position } => format!("point {}", vector(position)),
            ProbeKind::Deviation { object, bounds, .. } => match bounds {
                Some(b) => format!(
                    "deviation of {} between {} and {}{}",
                    name(object),
                    vector(b.bounds.min),
                    vector(b.bounds.max),
                    turned(b.rotation)
                ),
                None => format!("deviation of {}", name(object)),
            },
            ProbeKind::MaterialPoint { object, position } => {
                format!("material point of {} at {}", name(object), vector(position))
            }
        };
        format!("{}: {what}", p.name)
    };
    scene.probes.iter().map(probe).collect()
}

/// A vector with five significant digits or so, without the dust of rounding.
fn vector(v: [f64; 3]) -> String {
    let number = |x: f64| {
        let rounded = (x * 1e5).round() / 1e5;
        // Also turns -0 to 0.
        format!("{}", rounded + 0.0)
    };
    format!("({})", v.map(number).join(", "))
}

/// How a box is turned about its middle; nothing where it is not.
fn turned(rotation: [f64; 4]) -> String {
    let [x, y, z, w] = rotation;
    let sine = (x * x + y * y + z * z).sqrt();
    if sine == 0.0 {
        return String::new();
    }
    let angle = 2.0 * sine.atan2(w).to_degrees();
    let axis = [x, y, z].map(|n| n / sine);
    format!(", turned by {angle:.1} degrees about {}", vector(axis))
}

fn extent(e: &Extent) -> String {
    format!("{} to {} m", vector(e.min), vector(e.max))
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = &self.summary;
        writeln!(f, "scene      {}", s.name)?;
        writeln!(f, "gravity    {} m/s^2", vector(s.gravity))?;
        writeln!(
            f,
            "grid       dx = {:.5} m, {} particles, {} Gaussians",
            s.dx, s.particles, s.gaussians
        )?;
        writeln!(f, "frames     {} per second", s.frame_rate)?;
        if let Some(dt) = s.dt {
            let why = match &s.dt_object {
                Some(object) => format!(" limited by `{object}` (cfl {})", s.cfl),
                None => ", the whole frame".into(),
            };
            let count = s.substeps_per_frame;
            writeln!(f, "substeps   {count} per frame, dt = {dt:.3e} s{why}")?;
            writeln!(
                f,
                "cost       {:.2} million particle-substeps per simulated second, about {:.1} MB",
                s.particle_updates_per_second / 1e6,
                s.memory_bytes as f64 / 1e6
            )?;
        }
        if let Some(hint) = &self.precision {
            write!(f, "{hint}")?;
        }
        writeln!(f, "domain     {}", extent(&s.domain))?;
        for asset in &self.assets {
            let name = if asset.name.is_empty() {
                &asset.source
            } else {
                &asset.name
            };
            writeln!(f, "asset      {name} ({})", asset.source)?;
            writeln!(
                f,
                "           {} Gaussians, {} of them too transparent",
                asset.gaussians, asset.transparent
            )?;
            writeln!(
                f,
                "           in the file {}",
                extent(&asset.raw_box).replace(" m", " units")
            )?;
            writeln!(f, "           placed      {}", extent(&asset.placed_box))?;
        }
        for object in &s.objects {
            f.write_str(&object_text(object))?;
        }
        for c in &self.colliders {
            let normal = c.normal.map(|n| format!(", normal {}", vector(n)));
            let friction = c.friction.map(|friction| friction.to_string());
            writeln!(
                f,
                "collider   {}: {} at {} m{}, {}, friction {}, restitution {}",
                c.name,
                c.shape,
                vector(c.point),
                normal.unwrap_or_default(),
                c.surface,
                friction.as_deref().unwrap_or("of what meets it"),
                c.restitution
            )?;
        }
        for region in &self.pinned_regions {
            let (place, turn) = (extent(&region.extent), turned(region.rotation));
            writeln!(f, "pinned     {place}{turn}")?;
        }
        for probe in &self.probes {
            writeln!(f, "probe      {probe}")?;
        }
        for warning in &self.warnings {
            writeln!(f, "warning    {warning}")?;
        }
        Ok(())
    }
}

fn object_text(o: &ObjectSummary) -> String {
    let mut text = format!("object     {} ({})\n", o.name, o.fidelity);
    if let Some(b) = &o.gaussian_box {
        let _ = writeln!(
            text,
            "           {} Gaussians in {}",
            o.gaussians,
            extent(b)
        );
    }
    let Some(b) = &o.body else { return text };
    let [x, y, z] = b.cells;
    let _ = writeln!(
        text,
        "           {} particles in {}, {x:.1} x {y:.1} x {z:.1} cells",
        b.particles,
        extent(&b.particle_box)
    );
    let _ = writeln!(
        text,
        "           volume {:.4e} m^3, mass {:.4} kg, centre of mass {} m",
        b.volume,
        b.mass,
        vector(b.com)
    );
    let _ = writeln!(
        text,
        "           {} ({}): E = {:.3e} Pa, nu = {}, rho = {} kg/m^3, sound {:.2} m/s, dt <= {:.3e} s",
        b.material,
        b.law,
        b.youngs_modulus_pa,
        b.poisson_ratio,
        b.density_kg_m3,
        b.sound_speed,
        b.dt
    );
    text
}
