//! Writes the scene file for "any splat dropped onto a floor".

use cosplat_sim_core::{Scene, cost::SceneCost};

use super::{
    build::build,
    error::{Finding, SceneErrors},
    spec::{Axis, SceneFile},
};
use crate::{
    assets::{Gaussians, ReadReport},
    floaters::{core, inner_range},
};

/// What may be chosen about the drop.
#[derive(Clone, Debug, PartialEq)]
pub struct DropOptions {
    /// Up axis of the asset; guessed when absent, see [`guess_up`].
    pub up: Option<Axis>,
    /// Height of the object [m], 0.01..=100.
    pub height: f64,
    /// Height of the fall, as a fraction of the object's, 0..=10.
    pub fall: f64,
    /// One object per connected component instead of one of everything.
    pub split: bool,
    /// Particles to stay below: what sets the cell size.
    pub max_particles: usize,
}

impl Default for DropOptions {
    fn default() -> Self {
        Self {
            up: None,
            height: 1.0,
            fall: 0.15,
            split: false,
            max_particles: 10_000,
        }
    }
}

/// Density of the solid that everything becomes [kg/m^3].
const DENSITY: f64 = 1000.0;
const POISSON_RATIO: f64 = 0.3;
/// Young's modulus with which the cost is found out [Pa].
const TRIED: f64 = 1e6;
/// Fraction of the stability limit: the solver notices and repeats what goes wrong.
const CFL: f64 = 0.8;
/// Substeps times quadrature points per simulated second to spend, so that a small machine keeps up beside its clients [1/s].
/// What the points do not need goes into stiffness: leaves and arms of a capture are thin, and hang or tear
/// when they are soft.
const BUDGET: f64 = 1e7;
/// Softest and stiffest material, as the part by which a column of the object's height is compressed at its foot
/// by its own weight.
const SAG: (f64, f64) = (0.05, 0.001);
/// How much larger than the object the box is that leaves floaters out, over its height.
const RIM: f64 = 1e-3;

/// The text of a scene in which the asset, named by `path` as the scene file will find it, falls onto a floor as
/// one elastic object.
///
/// The cell size is chosen by filling the asset a few times, so that the scene runs in real time.
///
/// # Errors
/// When no object can be made of the asset.
pub fn drop_scene(
    gaussians: &Gaussians,
    path: &str,
    options: &DropOptions,
) -> Result<String, SceneErrors> {
    let failed = |message: &str| SceneErrors(vec![Finding::new(&Default::default(), message)]);
    if gaussians.is_empty() {
        return Err(failed("the asset has no Gaussians"));
    }
    let up = options.up.unwrap_or_else(|| guess_up(gaussians));
    let place = Place::new(gaussians, up, options)
        .ok_or_else(|| failed("the asset is flat along its up axis"))?;
    // Coarse cells: they carry thin parts better than soft material on a fine grid does.
    let mut dx = options.height / 20.0;
    let mut stiffness = TRIED;
    // The particle count grows with resolution between the powers of surface (2) and volume (3): a few steps
    // settle it.
    for _ in 0..4 {
        let text = place.text(gaussians, path, dx, TRIED, options);
        let file = SceneFile::parse(&text)?;
        let mut load = |_: &str| Ok((gaussians.clone(), ReadReport::default()));
        let (scene, _) = build(&file, &mut load)?;
        stiffness = youngs_modulus(&scene, options.height);
        let ratio = scene.particles.position.len() as f64 / options.max_particles as f64;
        if (0.25..=1.0).contains(&ratio) {
            break;
        }
        dx *= (ratio / 0.6).powf(0.4).clamp(0.25, 4.0);
    }
    Ok(place.text(gaussians, path, dx, stiffness, options))
}

/// Young's modulus [Pa] with which a scene, built with that of [`TRIED`], takes what may be spent, within the range of [`SAG`].
fn youngs_modulus(scene: &Scene, height: f64) -> f64 {
    let cost = SceneCost::at_rest(scene);
    let objects = || cost.objects.iter().flatten();
    let points: f64 = objects().map(|object| object.points as f64).sum();
    let tried = objects()
        .map(|object| object.dt)
        .fold(f64::INFINITY, f64::min);
    // Substeps are whole parts of a frame.
    let substeps = (BUDGET / points / scene.frame_rate).floor().max(1.0);
    // A little longer, as the modulus is written in whole pascals.
    let wanted = 1.001 / (substeps * scene.frame_rate);
    let weight = DENSITY * 9.81 * height;
    // A substep is proportional to one over the speed of sound.
    (TRIED * (tried / wanted).powi(2)).clamp(weight / SAG.0, weight / SAG.1)
}

/// Guesses which axis of a capture points up.
///
/// A capture that stands on its ground has many Gaussians in a thin layer at one end. Where no end stands out
/// clearly, up is -y, as the cameras of structure-from-motion have it.
pub fn guess_up(gaussians: &Gaussians) -> Axis {
    let axes = [
        (Axis::X, 0, 1.0),
        (Axis::NegX, 0, -1.0),
        (Axis::Y, 1, 1.0),
        (Axis::NegY, 1, -1.0),
        (Axis::Z, 2, 1.0),
        (Axis::NegZ, 2, -1.0),
    ];
    // Part of the Gaussians in the lowest twentieth.
    let layer = |(axis, a, sign): (Axis, usize, f32)| {
        let heights: Vec<f64> = gaussians
            .position
            .iter()
            .map(|p| f64::from(sign * p[a]))
            .collect();
        let [low, high] = inner_range(&heights);
        let limit = low + 0.05 * (high - low);
        let count = heights.iter().filter(|h| **h <= limit).count();
        (count as f64 / heights.len().max(1) as f64, axis)
    };
    let mut layers = axes.map(layer);
    layers.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [(first, axis), (second, _), ..] = layers;
    if first > 0.2 && first > 1.5 * second {
        axis
    } else {
        Axis::NegY
    }
}

/// Where the asset goes, measured without its floaters.
struct Place {
    up: Axis,
    scale: f64,
    translation: [f64; 3],
    /// Box to keep, when there are floaters far outside.
    crop: Option<([f64; 3], [f64; 3])>,
}

impl Place {
    fn new(gaussians: &Gaussians, up: Axis, options: &DropOptions) -> Option<Self> {
        let rotation = up.to_world_up();
        let turned: Vec<[f64; 3]> = gaussians
            .position
            .iter()
            .map(|p| (rotation * glam::DVec3::from(p.map(f64::from))).to_array())
            .collect();
        let (size, floating) = core(&turned)?;
        let extent = size.max[1] - size.min[1];
        let scale = options.height / extent;
        if !(1e-6..=1e6).contains(&scale) {
            return None;
        }
        let bottom = options.fall * options.height;
        let center = |a: usize| -0.5 * scale * (size.min[a] + size.max[a]);
        let translation = [center(0), bottom - scale * size.min[1], center(2)];
        // A little more, as places are rounded.
        let rim = RIM * options.height;
        let world = |a: usize, x: f64| scale * x + translation[a];
        let crop = (floating > 0).then(|| {
            (
                std::array::from_fn(|a| world(a, size.min[a]) - rim),
                std::array::from_fn(|a| world(a, size.max[a]) + rim),
            )
        });
        Some(Self {
            up,
            scale,
            translation,
            crop,
        })
    }

    fn text(
        &self,
        gaussians: &Gaussians,
        path: &str,
        dx: f64,
        youngs_modulus: f64,
        options: &DropOptions,
    ) -> String {
        let quoted = toml::Value::String(path.into());
        let up = match self.up {
            Axis::X => "x",
            Axis::Y => "y",
            Axis::Z => "z",
            Axis::NegX => "-x",
            Axis::NegY => "-y",
            Axis::NegZ => "-z",
        };
        let guessed = if options.up.is_some() {
            ""
        } else {
            " # guessed"
        };
        let [x, y, z] = self.translation;
        let select = self.crop.map_or(String::new(), |(min, max)| {
            format!(
                "# Leaves out what floats far around the object.\n\
                 select = {{ boxes = [{{ min = {min:?}, max = {max:?} }}] }}\n"
            )
        });
        let split = if options.split {
            "split = \"components\"\n"
        } else {
            ""
        };
        let probe = if options.split {
            String::new()
        } else {
            "\n[[probes]]\nname = \"object box\"\nkind = \"extent\"\nobject = \"object\"\n".into()
        };
        let count = gaussians.len();
        format!(
            r#"# {count} Gaussians dropped onto a floor as one elastic solid.
version = 1
name = "drop"
dx = {dx:?}
cfl = {CFL:?}

[[assets]]
name = "capture"
path = {quoted}
up = "{up}"{guessed}
scale = {scale:?}
translation = [{x:?}, {y:?}, {z:?}]

[[objects]]
name = "object"
asset = "capture"
{select}{split}particles = "filled"

[objects.material]
law = "fixed_corotated"
youngs_modulus_pa = {youngs_modulus:.0}
poisson_ratio = {POISSON_RATIO:?}
density_kg_m3 = {DENSITY:?}

[[objects]]
name = "ground"
builtin = "ground"
fidelity = "static"

[[colliders]]
name = "floor"
point = [0, 0, 0]
normal = [0, 1, 0]
surface = "separate"
friction = 0.5
{probe}"#,
            scale = self.scale,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{assets::generate, summary::SceneSummary};

    /// A vase as a capture would have it: upside down, in other units, with a floater.
    fn capture() -> Gaussians {
        let mut g = generate::builtin("vase").expect("known");
        for p in &mut g.position {
            *p = p.map(|x| 7.0 * x);
            p[1] = 3.0 - p[1];
            p[2] = -p[2];
        }
        for s in &mut g.scale {
            *s = s.map(|s| 7.0 * s);
        }
        g.position[0] = [90.0, 50.0, 0.0];
        g
    }

    /// And runs in real time.
    #[test]
    fn a_dropped_splat_is_one_metre_high_above_a_floor() {
        let g = capture();
        let text = drop_scene(&g, "my \"vase\".ply", &DropOptions::default())
            .unwrap_or_else(|e| panic!("{e}"));
        let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let mut paths = Vec::new();
        let (scene, report) = build(&file, &mut |path| {
            paths.push(path.to_owned());
            Ok((g.clone(), ReadReport::default()))
        })
        .unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(paths, ["my \"vase\".ply"]);
        let summary = SceneSummary::new(&scene);
        let object = &summary.objects[0];
        let seen = object.gaussian_box.expect("visible");
        assert!((seen.size[1] - 1.0).abs() < 0.03, "{seen:?}");
        assert!((seen.min[1] - 0.15).abs() < 0.02, "{seen:?}");
        let body = object.body.as_ref().expect("simulated");
        assert!(
            (2_500..=10_000).contains(&body.particles),
            "{}",
            body.particles
        );
        // Substeps are whole parts of a frame.
        let cost = summary.particle_updates_per_second;
        assert!(cost < 1.1 * BUDGET, "{cost}");
        assert_eq!(
            scene.gaussians.len() - 1,
            g.len() - 1 + summary.objects[1].gaussians - 1
        );
        let left_out = |w: &&Finding| w.message.contains("belong to no object");
        assert!(
            report.warnings.iter().any(|w| left_out(&w)),
            "{:?}",
            report.warnings
        );
    }

    #[test]
    fn the_ground_of_a_capture_tells_where_up_is() {
        let mut g = generate::builtin("vase").expect("known");
        assert_eq!(guess_up(&g), Axis::NegY);
        let ground = generate::builtin("ground").expect("known");
        crate::scene_file::append(&mut g, &ground);
        assert_eq!(guess_up(&g), Axis::Y);
        for p in &mut g.position {
            *p = [p[0], -p[2], p[1]];
        }
        assert_eq!(guess_up(&g), Axis::Z);
    }

    #[test]
    fn an_asset_without_height_or_content_is_refused() {
        let options = DropOptions::default();
        assert!(drop_scene(&Gaussians::default(), "x", &options).is_err());
        let flat = generate::builtin("ground").expect("known");
        let error = drop_scene(
            &flat,
            "x",
            &DropOptions {
                up: Some(Axis::Y),
                ..options
            },
        );
        assert!(error.expect_err("flat").to_string().contains("flat"));
    }
}
