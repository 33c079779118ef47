//! `cosplat explain`: what a scene file means, in scene units, and a picture of what cannot be seen.

use std::{
    fmt::{self, Write},
    path::PathBuf,
};

use anyhow::Context;
use cosplat_files::keep_apart;
use cosplat_scene::{
    assets::ply,
    diagram::diagram,
    load::LoadedScene,
    scene_file::{AssetReport, AssetSource},
    summary::{BodySummary, Extent, ObjectSummary, SceneSummary, turned, vector},
};
use cosplat_semantics::show;
use cosplat_sim_core::World;
use serde::Serialize;

use crate::{say, scene_args::SceneArgs};

/// Print what a scene file means: boxes, masses, materials, time step, cost.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Draw the scene's objects in colours, with their names.
    #[arg(long, value_name = "OUT.png")]
    picture: Option<PathBuf>,
    /// Write the scene's Gaussians with boxes, pinned regions, domain and colliders drawn in.
    #[arg(long, value_name = "OUT.ply")]
    ply: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When the scene cannot be used or the PLY cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let loaded = args.scene.load()?;
    for output in args.ply.iter().chain(&args.picture) {
        keep_apart(output, loaded.files(&args.scene.path))?;
    }
    let explanation = Explanation::new(&loaded);
    if let Some(path) = &args.ply {
        let bytes = ply::write(&diagram(&loaded.scene));
        cosplat_files::write(path, bytes)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    if let Some(path) = &args.picture {
        show::scene(&loaded).write(path)?;
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
    assets: Vec<Asset>,
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

impl Explanation {
    fn new(loaded: &LoadedScene) -> Self {
        let LoadedScene { scene, report, .. } = loaded;
        let mut summary = SceneSummary::new(scene);
        for (object, why) in summary.objects.iter_mut().zip(&report.why_spatial) {
            object.why_spatial.clone_from(why);
        }
        let refusal = World::check_scene(scene).err();
        let refusal = refusal.map(|error| format!("this scene cannot be simulated: {error}"));
        Self {
            summary,
            assets: report.assets.iter().map(asset).collect(),
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
                "cost       {:.2} million particle-substeps per simulated second at rest, about {:.1} MB",
                s.particle_updates_per_second / 1e6,
                s.memory_bytes as f64 / 1e6
            )?;
        }
        if let Some(hint) = &s.precision {
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
        for c in &s.colliders {
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
        for region in &s.pinned_regions {
            let (place, turn) = (extent(&region.extent), turned(region.rotation));
            writeln!(f, "pinned     {place}{turn}")?;
        }
        for probe in &s.probes {
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
    let _ = writeln!(text, "           {}", material_text(o, b));
    let on = match (o.solver, &o.why_spatial) {
        (Some("lagrangian"), _) => {
            format!("on a grid of its own with {} quadrature points", b.points)
        }
        (Some(_), Some(why)) => format!("on the spatial grid: {why}"),
        (Some(_), None) => "on the spatial grid".to_owned(),
        (None, _) => "a rigid body: its stiffness limits no substep".to_owned(),
    };
    let _ = writeln!(text, "           {on}");
    text
}

/// What an object is made of, as far as that matters for how it moves.
fn material_text(o: &ObjectSummary, b: &BodySummary) -> String {
    if o.solver.is_none() {
        return format!("{}: rho = {} kg/m^3", b.material, b.density_kg_m3);
    }
    let dt = b.dt.map(|dt| format!(", dt <= {dt:.3e} s"));
    let loss = (b.loss > 0.0).then(|| format!(", loss {}", b.loss));
    format!(
        "{} ({}): E = {:.3e} Pa, nu = {}, rho = {} kg/m^3{}, sound {:.2} m/s{}",
        b.material,
        b.law,
        b.youngs_modulus_pa,
        b.poisson_ratio,
        b.density_kg_m3,
        loss.unwrap_or_default(),
        b.sound_speed,
        dt.unwrap_or_default()
    )
}
