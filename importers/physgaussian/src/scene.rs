//! Puts the text of the scene file together.

use std::fmt::Write as _;

use crate::{
    Options,
    boundary::corners,
    conditions::Conditions,
    config::{Config, Kind},
    materials::{self, Elastic, Lines},
    notes::{NoteKind, Notes},
    place::{Part, Place},
};

/// Fraction of the stability limit: the solver notices and repeats what goes wrong.
const CFL: f64 = 0.8;
/// Particles per cell where the original's number is not kept.
const PARTICLES_PER_CELL: f64 = 8.0;
/// Range of particles per cell that a scene file takes.
const PARTICLES_RANGE: (f64, f64) = (1.0, 64.0);

/// When and how long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Schedule {
    /// Frames per second [1/s].
    pub frame_rate: f64,
    /// Length of the run [s].
    pub duration: f64,
    /// Substeps of the original.
    pub substeps: u64,
}

/// Frames, and what the original loses of them by cutting off.
pub(super) fn schedule(config: &Config, compat: bool, notes: &mut Notes) -> Schedule {
    let per_frame = config.substeps_per_frame();
    let taken = per_frame as f64 * config.substep_dt;
    let lost = (config.frame_dt - taken) / config.frame_dt;
    let repeat = compat && per_frame > 0;
    if per_frame == 0 {
        notes.warn(
            "substep_dt",
            config.substep_dt,
            format!(
                "longer than frame_dt, {} s: the original takes no substep at all",
                config.frame_dt
            ),
        );
    } else if lost.abs() > 1e-9 {
        let message = format!(
            "the original takes {per_frame} substeps per frame because it cuts the quotient off: its frames are \
             {taken} s long"
        );
        let (kind, new) = if repeat {
            (NoteKind::Reproduced, taken)
        } else {
            (NoteKind::Corrected, config.frame_dt)
        };
        notes.add(kind, "frame_dt", config.frame_dt, new, message);
    }
    let frame = if repeat { taken } else { config.frame_dt };
    Schedule {
        frame_rate: 1.0 / frame,
        duration: frame * config.frame_num as f64,
        substeps: per_frame * config.frame_num,
    }
}

/// What the text is made of.
pub(super) struct Parts<'p> {
    pub config: &'p Config,
    pub place: &'p Place,
    pub schedule: Schedule,
    /// Rate at which velocities decay [1/s].
    pub damping: f64,
    pub options: &'p Options,
    /// Positions and volumes that stand for the filled inside; empty without filling.
    pub inside: Vec<([f64; 3], f64)>,
}

/// The text of the scene file.
pub(super) fn text(parts: Parts, notes: &mut Notes) -> String {
    let mut text = head(&parts, notes);
    text += &domain(&parts, notes);
    text += &asset(&parts);
    text += &object(&parts, notes);
    let Parts {
        config,
        place,
        schedule,
        options,
        inside,
        ..
    } = parts;
    if place.static_count > 0 {
        text += "\n# Outside of sim_area: visible, at rest.\n[[objects]]\nname = \"surroundings\"\nasset = \"model\"\n\
                 select = { rest = true }\nfidelity = \"static\"\n";
    }
    text +=
        &Conditions::new(config, place, options.compat, schedule.duration, inside).convert(notes);
    text
}

fn head(parts: &Parts, notes: &mut Notes) -> String {
    let Parts {
        config,
        schedule,
        damping,
        options,
        ..
    } = parts;
    let damping = if *damping > 0.0 {
        format!("damping = {damping:?} # -ln(grid_v_damping_scale) / substep_dt\n")
    } else {
        String::new()
    };
    let rpic = match config.rpic_damping {
        pic if pic < -0.001 => "transfer = \"pic\" # rpic_damping is negative\n".into(),
        none if none <= 0.0 => String::new(),
        rpic => format!("rpic_damping = {rpic:?} # per substep, as in the original\n"),
    };
    let per_cell = particles_per_cell(config, options.compat, notes);
    let quoted = toml::Value::String(options.name.clone());
    let compat = if options.compat {
        ", defects of the original repeated where possible"
    } else {
        ""
    };
    format!(
        "# A PhysGaussian scene, imported by cosplat{compat}.\n\
         # {frames} frames of the configuration: cosplat simulate scene.toml --duration {duration}\n\
         # Its fixed step takes {substeps} substeps for that.\n\
         # The world is the original's simulation space: the simulated part is centred at (1, 1, 1).\n\
         version = 1\n\
         name = {quoted}\n\
         gravity = {gravity:?} # g\n\
         dx = {dx:?} # grid_lim / n_grid = {grid_lim} / {n_grid}\n\
         particles_per_cell = {per_cell:?}\n\
         frame_rate = {frame_rate:?} # frame_dt\n\
         cfl = {CFL:?} # the step is chosen; substep_dt was {substep_dt:?} s\n\
         {damping}{rpic}",
        frames = config.frame_num,
        duration = schedule.duration,
        substeps = schedule.substeps,
        gravity = config.gravity,
        dx = config.dx(),
        grid_lim = config.grid_lim,
        n_grid = config.n_grid,
        frame_rate = schedule.frame_rate,
        substep_dt = config.substep_dt,
    )
}

fn particles_per_cell(config: &Config, compat: bool, notes: &mut Notes) -> f64 {
    let Some(filling) = &config.filling else {
        return PARTICLES_PER_CELL;
    };
    let theirs = filling.per_simulation_cell(config.dx(), config.grid_lim);
    let ours = if compat {
        theirs.clamp(PARTICLES_RANGE.0, PARTICLES_RANGE.1)
    } else {
        PARTICLES_PER_CELL
    };
    notes.add(
        NoteKind::Changed,
        "particle_filling.max_partciels_per_cell",
        filling.per_cell,
        ours,
        format!(
            "particles per cell of the simulation grid inside, on a lattice; the original puts {theirs:.2} there at \
             random, and one more at every Gaussian"
        ),
    );
    ours
}

fn domain(parts: &Parts, notes: &mut Notes) -> String {
    let Parts { config, place, .. } = parts;
    let dx = config.dx();
    let lim = config.grid_lim;
    let reach = 1.5 * dx;
    let inside = (0..3).all(|a| place.min[a] >= reach && place.max[a] <= lim - reach);
    let (mut min, mut max) = ([0.0; 3], [lim; 3]);
    if !inside {
        min = std::array::from_fn(|a| (place.min[a] - lim).min(0.0));
        max = std::array::from_fn(|a| (place.max[a] + lim).max(lim));
        notes.add(
            NoteKind::Corrected,
            "grid_lim",
            lim,
            max.to_vec(),
            format!(
                "the simulated part, {:.4} to {:.4}, reaches out of the grid from 0 to {lim}, where the original \
                 accesses memory that is not its own; the domain is larger",
                place.min, place.max
            ),
        );
    }
    format!(
        "\n# [0, grid_lim]^3. A particle that leaves is taken out and reported; it crashes the original.\n[domain]\n\
         min = {min:?}\nmax = {max:?}\n"
    )
}

fn asset(parts: &Parts) -> String {
    let Parts {
        config,
        place,
        options,
        ..
    } = parts;
    let path = toml::Value::String(options.asset.clone());
    let steps: Vec<String> = config
        .rotations
        .iter()
        .map(|(degrees, axis)| format!("{degrees} about {}", ["x", "y", "z"][*axis]))
        .collect();
    let steps = if steps.is_empty() {
        "none".into()
    } else {
        steps.join(", then ")
    };
    format!(
        "\n[[assets]]\n\
         name = \"model\"\n\
         path = {path}\n\
         min_opacity = {opacity:?} # opacity_threshold\n\
         scale = {scale:?} # {side} / longest side of the simulated part\n\
         rotation_xyzw = {rotation:?} # rotation_degree, rotation_axis: {steps}\n\
         translation = {translation:?} # its middle goes to (1, 1, 1)\n",
        opacity = place.min_opacity,
        scale = place.scale,
        side = config.scale,
        rotation = place.rotation.to_array(),
        translation = place.translation.to_array(),
    )
}

fn object(parts: &Parts, notes: &mut Notes) -> String {
    let Parts {
        config,
        place,
        options,
        ..
    } = parts;
    let mut text = "\n[[objects]]\nname = \"object\"\nasset = \"model\"\n".to_owned();
    match &place.part {
        Part::All => {}
        Part::Box(min, max) => {
            let _ = writeln!(
                text,
                "select = {{ boxes = [{{ min = {min:?}, max = {max:?} }}] }} # sim_area"
            );
        }
        Part::Ranges(ranges) => {
            let _ = writeln!(
                text,
                "select = {{ ranges = {ranges:?} }} # sim_area, to the last Gaussian"
            );
        }
    }
    let base = &config.material;
    if base.kind == Kind::Stationary {
        text += "fidelity = \"static\" # stationary\n";
        notes.add(
            NoteKind::Changed,
            "material",
            "stationary",
            "static",
            "visible, not simulated",
        );
        return text;
    }
    text += &particles(config, notes);
    text += "solver = \"spatial\" # as the original: its conditions are those of grid nodes, and its matter tears\n";
    let elastic = Elastic {
        youngs_modulus: base.youngs_modulus,
        nu: base.nu,
        density: base.density,
    };
    text += "\n[objects.material]\n";
    text += &table(&materials::lines(
        base.kind,
        elastic,
        base,
        options.compat,
        Some(notes),
    ));
    for region in &config.regions {
        text += &self::region(parts, region, notes);
    }
    text
}

fn particles(config: &Config, notes: &mut Notes) -> String {
    if config.filling.is_some() {
        notes.add(
            NoteKind::Changed,
            "particle_filling",
            "Gaussians and random points",
            "filled",
            "particles stand for the volume, with equal shares of it; the Gaussians follow the particles near them \
             instead of being particles themselves",
        );
        return "particles = \"filled\" # particle_filling\n".into();
    }
    if config.material.kind == Kind::Sand {
        notes.add(
            NoteKind::Changed,
            "particle_filling",
            "mean volume",
            "volume by cell",
            "for sand the original gives all particles the mean of the volumes; here each has its share of its cell",
        );
    }
    "particles = \"per_gaussian\" # no particle_filling\n".into()
}

fn table(lines: &Lines) -> String {
    lines.0.iter().map(|line| format!("{line}\n")).collect()
}

fn region(parts: &Parts, region: &super::config::Region, notes: &mut Notes) -> String {
    let Parts {
        config, options, ..
    } = parts;
    let (min, max) = corners(region.center, region.half_size);
    if min.iter().zip(&max).any(|(low, high)| low >= high) {
        notes.ignore(
            format!("{}.size", region.key),
            region.half_size.to_vec(),
            "the box is empty",
        );
        return String::new();
    }
    let kind = region.kind.unwrap_or(config.material.kind);
    if kind == Kind::Stationary {
        return format!(
            "\n# {}: stationary\n[[prescribed]]\nbox = {{ min = {min:?}, max = {max:?} }}\n",
            region.key
        );
    }
    let elastic = Elastic {
        youngs_modulus: region.youngs_modulus,
        nu: region.nu,
        density: region.density,
    };
    let lines = materials::lines(kind, elastic, &config.material, options.compat, None);
    format!(
        "\n# {}\n[[objects.regions]]\nbox = {{ min = {min:?}, max = {max:?} }} # point -+ size\n\
         [objects.regions.material]\n{}",
        region.key,
        table(&lines)
    )
}
