//! The JSON configuration of a PhysGaussian scene: every key of the original, its misspellings, and those of forks.

use serde_json::Value;

use crate::{
    boundary::{self, Boundary},
    fields::{Fields, suggestion},
    filling::{self, Filling},
    notes::{NoteKind, Notes},
};

/// A configuration, defaults filled in.
#[derive(Clone, Debug)]
pub(super) struct Config {
    pub material: Material,
    /// Boxes of other stiffness and density, in the order in which they are applied.
    pub regions: Vec<Region>,
    /// The domain is `[0, grid_lim]^3`.
    pub grid_lim: f64,
    /// Cells per axis.
    pub n_grid: u64,
    pub gravity: [f64; 3],
    pub rpic_damping: f64,
    pub grid_v_damping_scale: f64,
    pub substep_dt: f64,
    pub frame_dt: f64,
    pub frame_num: u64,
    pub opacity_threshold: f64,
    /// Degrees and axis (0 x, 1 y, 2 z), in the order in which they are applied.
    pub rotations: Vec<(f64, usize)>,
    /// xmin, xmax, ymin, ymax, zmin, zmax after the rotations, before scaling.
    pub sim_area: Option<[f64; 6]>,
    /// Longest side of the simulated part.
    pub scale: f64,
    pub filling: Option<Filling>,
    pub boundaries: Vec<Boundary>,
}

/// What `material` names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Jelly,
    Metal,
    Sand,
    Foam,
    Snow,
    Plasticine,
    Fluid,
    /// Of the fork pixie: does not move.
    Stationary,
}

/// Material of the whole object.
#[derive(Clone, Debug)]
pub(super) struct Material {
    pub kind: Kind,
    pub youngs_modulus: f64,
    pub nu: f64,
    pub density: f64,
    pub yield_stress: f64,
    /// Whether `hardening` is 1.
    pub hardens: bool,
    pub xi: f64,
    pub softening: f64,
    pub friction_angle: f64,
    pub plastic_viscosity: f64,
    pub bulk_modulus: f64,
}

/// One entry of `additional_material_params`.
#[derive(Clone, Debug)]
pub(super) struct Region {
    pub key: String,
    pub center: [f64; 3],
    pub half_size: [f64; 3],
    pub youngs_modulus: f64,
    pub nu: f64,
    pub density: f64,
    /// Of the fork pixie; the object's kind when absent.
    pub kind: Option<Kind>,
}

/// Names of materials, in the numbering of the original and of warp-mpm.
const KINDS: [(&str, Kind); 7] = [
    ("jelly", Kind::Jelly),
    ("metal", Kind::Metal),
    ("sand", Kind::Sand),
    ("foam", Kind::Foam),
    ("snow", Kind::Snow),
    ("plasticine", Kind::Plasticine),
    ("fluid", Kind::Fluid),
];

/// Further names that the forks use.
const MORE_KINDS: [(&str, Kind); 4] = [
    ("visplas", Kind::Foam),
    ("water", Kind::Fluid),
    ("stationary", Kind::Stationary),
    ("rigid", Kind::Stationary),
];

/// Numbering of the fork pixie, whose snow is the plasticine of the original.
const PIXIE_KINDS: [Kind; 7] = [
    Kind::Jelly,
    Kind::Metal,
    Kind::Sand,
    Kind::Foam,
    Kind::Fluid,
    Kind::Plasticine,
    Kind::Stationary,
];

/// Keys of the fork pixie without effect here; one of them also says that numbers of materials are pixie's.
const PIXIE_KEYS: [&str; 9] = [
    "nn_distance_threshold",
    "to_original_coord",
    "z_shift_value",
    "only_handle_largest_cluster",
    "k_smoothing_neighbors",
    "out_of_bound_check_freq",
    "fix_ground",
    "init_roll",
    "delta_roll",
];

const PHYSFLOW_KEYS: [&str; 5] = ["opt_frame_dt", "lr", "line", "bbox_2d", "reduction"];
const VISCOELASTIC_KEYS: [&str; 3] = ["mu_N", "lam_N", "viscosity"];
const CAMERA_KEYS: [&str; 11] = [
    "mpm_space_viewpoint_center",
    "default_camera_index",
    "show_hint",
    "init_azimuthm",
    "init_azimuth",
    "init_elevation",
    "init_radius",
    "move_camera",
    "delta_a",
    "delta_e",
    "delta_r",
];

/// Smallest and largest value of a length, a time or a modulus: what fits the scene format.
const LENGTH: (f64, f64) = (1e-5, 1e4);
const TIME: (f64, f64) = (1e-9, 1e6);
const DENSITY: (f64, f64) = (1e-3, 1e6);
/// Beyond any real modulus; kept apart from zero so that ratios of them are finite.
const MODULUS: (f64, f64) = (1e-9, 1e13);

impl Config {
    /// Reads a parsed configuration; what is wrong with it is noted, and then there is none.
    pub fn read(json: &Value, notes: &mut Notes) -> Option<Self> {
        let mut top = Fields::new("", json, notes)?;
        let pixie = PIXIE_KEYS.iter().any(|k| top.has(k));
        let material = material(&mut top, pixie, notes);
        let regions = regions(&mut top, &material, notes);
        let grid_lim = top.bounded("grid_lim", LENGTH, notes).unwrap_or(2.0);
        let n_grid = top.count("n_grid", (4, 4096), notes).unwrap_or(50);
        let up = top.vector("mpm_space_vertical_upward_axis", notes);
        let config = Self {
            material,
            regions,
            grid_lim,
            n_grid,
            gravity: gravity(&mut top, up, notes),
            rpic_damping: top
                .bounded("rpic_damping", (-1.0, 1.0), notes)
                .unwrap_or(0.0),
            grid_v_damping_scale: top
                .bounded("grid_v_damping_scale", (0.0, 1e6), notes)
                .unwrap_or(1.1),
            substep_dt: top.bounded("substep_dt", TIME, notes).unwrap_or(1e-4),
            frame_dt: top.bounded("frame_dt", TIME, notes).unwrap_or(1e-2),
            frame_num: top.count("frame_num", (1, 1 << 32), notes).unwrap_or(100),
            opacity_threshold: top
                .bounded("opacity_threshold", (0.0, 1.0), notes)
                .unwrap_or(0.02),
            rotations: rotations(&mut top, notes),
            sim_area: sim_area(&mut top, notes),
            scale: top.bounded("scale", LENGTH, notes).unwrap_or(1.0),
            filling: filling::read(&mut top, n_grid, notes),
            boundaries: boundary::read(&mut top, notes),
        };
        top.ignore(
            &["pic_damping"],
            "the original reads it and never uses it",
            notes,
        );
        top.ignore(
            &CAMERA_KEYS,
            "a scene has no camera: `cosplat view` takes --azimuth, --elevation, --distance and --target",
            notes,
        );
        top.ignore(
            &VISCOELASTIC_KEYS,
            "the viscous branch of Physics3D is not modelled: the material is the elastic part alone",
            notes,
        );
        top.ignore(
            &PHYSFLOW_KEYS,
            "of PhysFlow's optimisation, not of the scene",
            notes,
        );
        top.ignore(
            &PIXIE_KEYS,
            "of pixie's material fields, not of the scene",
            notes,
        );
        top.finish(notes);
        notes.errors.is_empty().then_some(config)
    }

    /// Grid cell size.
    pub fn dx(&self) -> f64 {
        self.grid_lim / self.n_grid as f64
    }

    /// Substeps of a frame as the original counts them: the quotient in `f64`, cut off.
    pub fn substeps_per_frame(&self) -> u64 {
        (self.frame_dt / self.substep_dt) as u64
    }
}

fn material(top: &mut Fields, pixie: bool, notes: &mut Notes) -> Material {
    let kind = kind(top, pixie, notes).unwrap_or(Kind::Jelly);
    let hardening = top.number("hardening", notes);
    if let Some(value) = hardening
        && value != 0.0
        && value != 1.0
    {
        notes.warn(
            "hardening",
            value,
            "only 1 switches hardening on: any other number leaves it off",
        );
    }
    Material {
        kind,
        youngs_modulus: top.bounded("E", MODULUS, notes).unwrap_or(1e5),
        nu: nu(top, notes).unwrap_or(0.4),
        density: top.bounded("density", DENSITY, notes).unwrap_or(200.0),
        yield_stress: top
            .bounded("yield_stress", (0.0, 1e13), notes)
            .unwrap_or(0.0),
        hardens: hardening == Some(1.0),
        xi: top.number("xi", notes).unwrap_or(0.0),
        softening: top.bounded("softening", (0.0, 1e13), notes).unwrap_or(0.1),
        friction_angle: top
            .bounded("friction_angle", (0.0, 89.0), notes)
            .unwrap_or(25.0),
        plastic_viscosity: top
            .bounded("plastic_viscosity", (0.0, 1e13), notes)
            .unwrap_or(0.0),
        bulk_modulus: top
            .bounded("bulk_modulus", (0.0, 1e13), notes)
            .unwrap_or(0.0),
    }
}

/// Poisson's ratio. One half, which the original lets pass and then divides by zero, is taken as nearly one half.
fn nu(fields: &mut Fields, notes: &mut Notes) -> Option<f64> {
    const LARGEST: f64 = 0.4999;
    let nu = fields.bounded("nu", (0.0, 0.5), notes)?;
    if nu > LARGEST {
        notes.add(
            NoteKind::Corrected,
            fields.path("nu"),
            nu,
            LARGEST,
            "at one half the modulus of compression is infinite, and the original divides by zero",
        );
    } else if nu > 0.45 {
        notes.warn(
            fields.path("nu"),
            nu,
            "nearly incompressible: such materials look stiffer than they are on any grid",
        );
    }
    Some(nu.min(LARGEST))
}

/// `material`, a name or a number. A name that is not known is an error: no material could stand for it.
fn kind(fields: &mut Fields, pixie: bool, notes: &mut Notes) -> Option<Kind> {
    let path = fields.path("material");
    let value = fields.get("material")?;
    if let Some(name) = value.as_str() {
        let all = KINDS.iter().chain(&MORE_KINDS);
        let found = all.clone().find(|(n, _)| *n == name.to_ascii_lowercase());
        if let Some((_, kind)) = found {
            return Some(*kind);
        }
        let names: Vec<&str> = KINDS.iter().map(|k| k.0).collect();
        let hint = suggestion(name, &names);
        let names = names.join(", ");
        notes.error(
            &path,
            format!("is \"{name}\", expected one of {names}{hint}"),
        );
        return None;
    }
    let number = value.as_u64().and_then(|n| usize::try_from(n).ok());
    let kind = number.and_then(|n| {
        if pixie {
            PIXIE_KINDS.get(n).copied()
        } else {
            KINDS.get(n).map(|k| k.1)
        }
    });
    let Some(kind) = kind else {
        notes.error(&path, format!("is {value}, expected a name or 0 to 6"));
        return None;
    };
    if pixie {
        let name = format!("{kind:?}").to_lowercase();
        notes.add(
            NoteKind::Changed,
            &path,
            value.clone(),
            name,
            "pixie numbers materials its own way: 0 jelly, 1 metal, 2 sand, 3 visco-plastic, 4 fluid, 5 snow (the \
             damage law that the original calls plasticine), 6 stationary",
        );
    }
    if kind == Kind::Stationary {
        notes.warn(
            &path,
            value.clone(),
            "pixie's own files disagree on number 6; taken as stationary",
        );
    }
    Some(kind)
}

fn regions(top: &mut Fields, material: &Material, notes: &mut Notes) -> Vec<Region> {
    let list = top.list("additional_material_params", notes);
    let mut regions = Vec::new();
    for (i, entry) in list.into_iter().flatten().enumerate() {
        let key = format!("additional_material_params[{i}]");
        let Some(mut fields) = Fields::new(&key, entry, notes) else {
            continue;
        };
        let center = fields.vector("point", notes);
        let half_size = fields.vector("size", notes);
        let youngs_modulus = fields.bounded("E", MODULUS, notes);
        let nu = nu(&mut fields, notes);
        let density = fields.bounded("density", DENSITY, notes);
        let kind = kind(&mut fields, true, notes);
        let center = fields.required("point", center, notes);
        let half_size = fields.required("size", half_size, notes);
        let youngs_modulus = fields.required("E", youngs_modulus, notes);
        let nu = fields.required("nu", nu, notes);
        fields.finish(notes);
        if let (Some(center), Some(half_size), Some(youngs_modulus), Some(nu)) =
            (center, half_size, youngs_modulus, nu)
        {
            regions.push(Region {
                key,
                center,
                half_size,
                youngs_modulus,
                nu,
                density: density.unwrap_or(material.density),
                kind,
            });
        }
    }
    regions
}

/// Gravity. A single number, which is also the default, would fail in the original: it acts downwards here.
fn gravity(top: &mut Fields, up: Option<[f64; 3]>, notes: &mut Notes) -> [f64; 3] {
    let value = top.get("g");
    if value.is_some_and(Value::is_array) {
        return top.vector("g", notes).unwrap_or_default();
    }
    let strength = match value {
        Some(_) => top.number("g", notes).unwrap_or(0.0),
        None => 9.8,
    };
    let up = up.unwrap_or([0.0, 0.0, 1.0]);
    let length = up.iter().map(|u| u * u).sum::<f64>().sqrt();
    let up = if length > 0.0 {
        up.map(|u| u / length)
    } else {
        [0.0, 0.0, 1.0]
    };
    // Adding zero turns -0 to 0.
    let gravity = up.map(|u| -strength * u + 0.0);
    notes.add(
        NoteKind::Corrected,
        "g",
        value.cloned().unwrap_or_default(),
        gravity.to_vec(),
        "the original needs a vector and fails on its own default of 9.8; taken as acting against \
         `mpm_space_vertical_upward_axis`",
    );
    gravity
}

fn rotations(top: &mut Fields, notes: &mut Notes) -> Vec<(f64, usize)> {
    let degrees = top.numbers("rotation_degree", notes).unwrap_or_default();
    let axes = top.numbers("rotation_axis", notes).unwrap_or_default();
    if degrees.len() != axes.len() {
        notes.error(
            "rotation_degree",
            format!(
                "has {} angles, and `rotation_axis` has {} axes",
                degrees.len(),
                axes.len()
            ),
        );
    }
    if let Some(axis) = axes.iter().find(|a| ![0.0, 1.0, 2.0].contains(*a)) {
        notes.error(
            "rotation_axis",
            format!("has {axis}, expected 0 (x), 1 (y) or 2 (z)"),
        );
        return Vec::new();
    }
    let axes = axes.into_iter().map(|a| a as usize);
    degrees.into_iter().zip(axes).collect()
}

fn sim_area(top: &mut Fields, notes: &mut Notes) -> Option<[f64; 6]> {
    let area: [f64; 6] = top.vector("sim_area", notes)?;
    for axis in 0..3 {
        if area[2 * axis] >= area[2 * axis + 1] {
            notes.error(
                "sim_area",
                format!(
                    "{} to {} along axis {axis} is empty",
                    area[2 * axis],
                    area[2 * axis + 1]
                ),
            );
        }
    }
    Some(area)
}
