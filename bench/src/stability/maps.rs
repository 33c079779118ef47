//! The maps: which samples, materials and transfers are tried at which time steps.

use cosplat_sim_core::{Scene, materials::Law};
use rayon::prelude::*;

use super::{
    samples::{FOAM, MISES, OBJECTS, PLASTICINE, block, cluster, conditions, object, solid},
    trial::{Fate, limit, unguarded},
};

/// What is tried at time steps.
pub trait Sample: Send + Sync {
    /// Time step [s] that those of the maps are over.
    fn limit(&self) -> f64;

    /// Where a formula puts the limit, over that.
    fn predicted(&self) -> f64;

    /// What becomes of a small strain in so many substeps of `dt` [s].
    fn fate(&self, dt: f64, steps: usize) -> Fate;
}

impl Sample for Scene {
    fn limit(&self) -> f64 {
        limit(self)
    }

    fn predicted(&self) -> f64 {
        let fluid = self.objects[0].material.law.is_fluid();
        self.conditions.time_step_kept(fluid)
    }

    fn fate(&self, dt: f64, steps: usize) -> Fate {
        unguarded(self, dt, steps)
    }
}

/// Samples one by one.
fn boxed(scenes: impl IntoIterator<Item = Scene>) -> Vec<Box<dyn Sample>> {
    let boxed = |scene| -> Box<dyn Sample> { Box::new(scene) };
    scenes.into_iter().map(boxed).collect()
}

/// Poisson's ratios of the maps.
pub const NU: [f64; 5] = [0.0, 0.2, 0.3, 0.45, 0.49];
/// Transfers of the maps; `rpic` is `apic` with `rpic_damping = 1`.
pub const TRANSFERS: [&str; 3] = ["apic", "rpic", "pic"];
/// Time steps over the critical one of a lone particle.
pub const RATIOS: [f64; 13] = [
    0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.4,
];
/// The same for a few checks.
pub const FEW: [f64; 5] = [0.65, 0.75, 0.95, 1.05, 1.4];
/// Random clusters per row.
const CLUSTERS: usize = 8;

/// What time steps of a map are over, and what they are held against.
pub struct Scale {
    /// The horizontal axis.
    pub x: &'static str,
    /// The line: where a formula puts the limit.
    pub line: &'static str,
    /// How it was tried.
    pub caption: &'static str,
    /// Names of both in files.
    pub keys: [&'static str; 2],
}

/// Of the spatial grid.
const SPATIAL: Scale = Scale {
    x: "dt / dt_crit, dt_crit = dx sqrt(rho0 / (3 lambda + 2 mu)) or the law's tangent at rest",
    line: "limit of a lone particle in closed form",
    caption: "Double-precision reference solver, which has no guard; fixed dt; strain of 1e-6 at the start. Damped: less than a third of it \
              is left at the end.",
    keys: ["dt_over_dt_crit", "closed_form"],
};

/// A picture of panels.
pub struct Map {
    /// Name of its files.
    pub name: &'static str,
    /// Heading.
    pub title: &'static str,
    /// What the columns and the line over them are.
    pub scale: &'static Scale,
    /// What the rows are.
    pub y: &'static str,
    /// Row by row.
    pub panels: Vec<Panel>,
    /// Panels beside each other.
    pub columns: usize,
}

/// One map of time step against rows.
pub struct Panel {
    /// Heading.
    pub title: String,
    /// Time steps over the critical one.
    pub ratios: Vec<f64>,
    /// From the lowest.
    pub rows: Vec<Row>,
}

/// Samples that are tried at all time steps.
pub struct Row {
    /// What it is.
    pub name: String,
    /// Blown up when one of them does, damped when most of them are.
    pub samples: Vec<Box<dyn Sample>>,
    /// Substeps of a run.
    pub steps: usize,
}

impl Row {
    /// Where a formula puts the limit, over the time step that ratios are over.
    pub fn predicted(&self) -> f64 {
        self.samples[0].predicted()
    }

    /// What happens at a time step.
    pub fn fate(&self, ratio: f64) -> Fate {
        let mut fates: Vec<Fate> = self
            .samples
            .par_iter()
            .map(|sample| sample.fate(ratio * sample.limit(), self.steps))
            .collect();
        fates.sort_unstable();
        match fates.last() {
            Some(Fate::BlownUp) => Fate::BlownUp,
            _ => fates[fates.len() / 2],
        }
    }

    /// The largest stable time step over the critical one, to one per cent, by bisection between a half and two.
    pub fn measured_limit(&self) -> f64 {
        let (mut stable, mut unstable) = (0.5, 2.0);
        while unstable - stable > 0.01 {
            let middle = 0.5 * (stable + unstable);
            match self.fate(middle) {
                Fate::BlownUp => unstable = middle,
                Fate::Passed | Fate::Damped => stable = middle,
            }
        }
        stable
    }
}

fn ratios(quick: bool) -> Vec<f64> {
    match quick {
        true => FEW.to_vec(),
        false => RATIOS.to_vec(),
    }
}

fn with(mut scene: Scene, transfer: &str) -> Scene {
    scene.conditions = conditions(transfer);
    scene
}

/// Lone particles and clusters of 2 to 5, neo-Hookean.
pub fn clusters(quick: bool) -> Map {
    let panel = |transfer: &str, lone: bool| {
        let nu = if quick { &NU[2..3] } else { &NU[..] };
        let row = |nu: &f64| {
            let scene = |n: usize| {
                let count = if lone { 1 } else { 2 + n % 4 };
                let material = solid(Law::NeoHookean, *nu);
                with(cluster(material, count, n as u64), transfer)
            };
            let count = match (lone, quick) {
                (true, _) => 1,
                (false, true) => 4,
                (false, false) => CLUSTERS,
            };
            Row {
                name: format!("{nu}"),
                samples: boxed((0..count).map(scene)),
                steps: 400,
            }
        };
        let who = if lone {
            "one particle"
        } else {
            "2 to 5 particles"
        };
        Panel {
            title: format!("{who}, {transfer}"),
            ratios: ratios(quick),
            rows: nu.iter().map(row).collect(),
        }
    };
    let panels = [true, false]
        .into_iter()
        .flat_map(|lone| TRANSFERS.map(|transfer| panel(transfer, lone)));
    Map {
        name: "clusters",
        title: "Few particles: what becomes of a small strain without guard",
        scale: &SPATIAL,
        y: "Poisson's ratio",
        panels: panels.collect(),
        columns: 3,
    }
}

/// Cubes of 27 cells with 1, 8 and 27 particles per cell, neo-Hookean.
pub fn blocks(quick: bool) -> Map {
    let panel = |transfer: &str, per_axis: usize| {
        let nu = if quick { &NU[2..3] } else { &NU[..] };
        let row = |nu: &f64| Row {
            name: format!("{nu}"),
            samples: boxed([with(
                block(solid(Law::NeoHookean, *nu), 3, per_axis),
                transfer,
            )]),
            steps: if quick { 100 } else { 300 / per_axis },
        };
        Panel {
            title: format!("{} per cell, {transfer}", per_axis.pow(3)),
            ratios: ratios(quick),
            rows: nu.iter().map(row).collect(),
        }
    };
    let per_axis: &[usize] = if quick { &[2] } else { &[1, 2, 3] };
    let panels = ["apic", "pic"]
        .into_iter()
        .flat_map(|transfer| per_axis.iter().map(move |n| panel(transfer, *n)));
    Map {
        name: "blocks",
        title: "Blocks of 3 x 3 x 3 cells: what becomes of a small strain without guard",
        scale: &SPATIAL,
        y: "Poisson's ratio",
        panels: panels.collect(),
        columns: per_axis.len(),
    }
}

/// Every law with stress, as it is stated in materials of 0.1 MPa.
const LAWS: [(&str, Law); 8] = [
    ("corot.", Law::FixedCorotated),
    ("neo-H.", Law::NeoHookean),
    ("Mises", MISES),
    (
        "sand",
        Law::DruckerPrager {
            friction_angle: 30.0,
            cohesion: 0.0,
        },
    ),
    (
        "snow",
        Law::Snow {
            critical_compression: 0.025,
            critical_stretch: 0.0075,
            hardening: 10.0,
        },
    ),
    ("foam", FOAM),
    ("plastic.", PLASTICINE),
    (
        "fluid",
        Law::Fluid {
            bulk_modulus: 1e5,
            viscosity: 0.1,
        },
    ),
];

/// All laws, as clusters and as a block.
pub fn materials(quick: bool) -> Map {
    let laws = if quick { &LAWS[..1] } else { &LAWS[..] };
    let panel = |transfer: &str, whole: bool| {
        let row = |(name, law): &(&str, Law)| {
            let material = solid(*law, if law.is_fluid() { 0.0 } else { 0.3 });
            let scene = |n: usize| {
                let scene = match whole {
                    true => block(material.clone(), 3, 2),
                    false => cluster(material.clone(), 1 + n % 5, n as u64),
                };
                with(scene, transfer)
            };
            Row {
                name: (*name).into(),
                samples: boxed((0..if whole { 1 } else { CLUSTERS }).map(scene)),
                steps: if whole { 150 } else { 400 },
            }
        };
        let who = if whole {
            "block, 8 per cell"
        } else {
            "1 to 5 particles"
        };
        Panel {
            title: format!("{who}, {transfer}"),
            ratios: ratios(quick),
            rows: laws.iter().map(row).collect(),
        }
    };
    let panels = ["apic", "pic"]
        .into_iter()
        .flat_map(|transfer| [false, true].map(|whole| panel(transfer, whole)));
    Map {
        name: "materials",
        title: "Materials: what becomes of a small strain without guard",
        scale: &SPATIAL,
        y: "law",
        panels: panels.collect(),
        columns: 2,
    }
}

/// Objects as scene files make them.
///
/// # Errors
/// When one cannot be built.
pub fn objects(quick: bool) -> anyhow::Result<Map> {
    let objects = if quick { &OBJECTS[..1] } else { &OBJECTS[..] };
    let panel = |transfer: &str| -> anyhow::Result<Panel> {
        let row = |(name, text): &(&str, &str)| -> anyhow::Result<Row> {
            let short = name.split(',').next().unwrap_or(name);
            Ok(Row {
                name: short.into(),
                samples: boxed([with(object(text, 0.3)?, transfer)]),
                steps: if quick { 50 } else { 70 },
            })
        };
        Ok(Panel {
            title: transfer.into(),
            ratios: ratios(quick),
            rows: objects.iter().map(row).collect::<anyhow::Result<_>>()?,
        })
    };
    Ok(Map {
        name: "objects",
        title: "Objects of scene files: what becomes of a small strain without guard",
        scale: &SPATIAL,
        y: "object",
        panels: vec![panel("apic")?, panel("pic")?],
        columns: 2,
    })
}

/// Clusters of 1 to 5 particles.
pub fn lone_and_few(transfer: &str, nu: f64, quick: bool) -> Row {
    let scene = |n: usize| {
        let material = solid(Law::NeoHookean, nu);
        with(cluster(material, 1 + n % 5, n as u64), transfer)
    };
    Row {
        name: format!("{nu}"),
        samples: boxed((0..if quick { 3 } else { CLUSTERS }).map(scene)),
        steps: 400,
    }
}
