//! PhysGaussian scenes to `scene.toml`: a JSON configuration and a model become a text and a list of everything that
//! was changed on the way.
//!
//! [`import`] is pure; [`files`] finds and reads what it needs. `docs/physgaussian.md` maps every key.

mod boundary;
mod conditions;
mod config;
mod fields;
pub mod files;
mod filling;
mod materials;
mod notes;
mod place;
mod scene;
#[cfg(test)]
mod tests;

use cosplat_scene::{
    assets::Gaussians,
    fill::{FillOptions, fill},
    scene_file::SceneFile,
};

pub use notes::{Note, NoteKind};

use config::Config;
use notes::Notes;
use place::Place;
use scene::{Parts, schedule};

/// Largest damping that a scene file takes [1/s].
const LARGEST_DAMPING: f64 = 1e6;

/// What may be chosen about an import.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Name of the scene.
    pub name: String,
    /// Path of the model as the scene file will find it.
    pub asset: String,
    /// Repeats the defects of the original where the solver can.
    pub compat: bool,
    /// Factor on every Young's modulus.
    pub e_multiplier: Option<f64>,
}

/// A converted scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// Text of the scene file.
    pub scene: String,
    /// Everything that was changed, corrected, ignored or doubted, in the order of its discovery.
    pub notes: Vec<Note>,
    /// Length of the run that the configuration asks for [s].
    pub duration: f64,
    /// Frames of that run.
    pub frames: u64,
    /// Substeps that the original takes for it.
    pub fixed_substeps: u64,
    /// Gaussians that are simulated.
    pub simulated: usize,
    /// Gaussians that are visible and at rest.
    pub at_rest: usize,
    /// Gaussians left out for their opacity.
    pub transparent: usize,
}

/// Why a configuration cannot be converted: everything that is wrong with it, each with its key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct ImportErrors(pub Vec<String>);

/// Converts a configuration and the Gaussians of its model.
///
/// # Errors
/// When the text is no JSON, a known key has a value of the wrong kind or range, a required key of a boundary
/// condition is missing, no Gaussian is left to simulate, or the scene that comes of it is none. Keys that are not known are no error.
pub fn import(
    config: &str,
    model: &Gaussians,
    options: &Options,
) -> Result<Imported, ImportErrors> {
    let json = serde_json::from_str(config).map_err(|e| ImportErrors(vec![e.to_string()]))?;
    let mut notes = Notes::default();
    let config = Config::read(&json, &mut notes);
    let Some(mut config) = config else {
        return Err(ImportErrors(notes.errors));
    };
    materials::check_stiffness(&mut config, options.e_multiplier, &mut notes);
    let damping = damping(&config, options.compat, &mut notes);
    let schedule = schedule(&config, options.compat, &mut notes);
    let Some(place) = Place::new(&config, model, &mut notes) else {
        return Err(ImportErrors(notes.errors));
    };
    let parts = Parts {
        config: &config,
        place: &place,
        schedule,
        damping,
        options,
        inside: inside(&config, model, &place),
    };
    let scene = scene::text(parts, &mut notes);
    // Ranges of scene files are theirs: a box without width, say, is in JSON as good as any.
    if let Err(errors) = SceneFile::parse(&scene) {
        let found = errors.0.into_iter().map(|finding| finding.to_string());
        return Err(ImportErrors(found.collect()));
    }
    Ok(Imported {
        scene,
        notes: notes.notes,
        duration: schedule.duration,
        frames: config.frame_num,
        fixed_substeps: schedule.substeps,
        simulated: place.simulated.len(),
        at_rest: place.static_count,
        transparent: place.transparent,
    })
}

/// What stands for the random points that the original puts inside; empty when nobody asks.
fn inside(config: &Config, model: &Gaussians, place: &Place) -> Vec<([f64; 3], f64)> {
    let counted = config
        .boundaries
        .iter()
        .any(|b| matches!(b.what, boundary::What::Impulse { .. }));
    if !counted || config.filling.is_none() {
        return Vec::new();
    }
    let filled = fill(
        &place.simulated_gaussians(model),
        &FillOptions {
            dx: config.dx(),
            particles_per_cell: 8.0,
            seed: 0,
            closed_below: true,
        },
    );
    filled.position.into_iter().zip(filled.volume).collect()
}

/// Rate of the original's damping per substep [1/s].
fn damping(config: &Config, compat: bool, notes: &mut Notes) -> f64 {
    let dt = config.substep_dt;
    let scale = config.grid_v_damping_scale;
    if scale >= 1.0 {
        return 0.0;
    }
    let rate = (-scale.ln() / dt).min(LARGEST_DAMPING);
    let repeated = if compat {
        ". So with --compat as well: substeps have no fixed length here"
    } else {
        ""
    };
    notes.add(
        NoteKind::Corrected,
        "grid_v_damping_scale",
        scale,
        rate,
        format!(
            "the original multiplies all velocities by it every {dt} s; as a rate [1/s] it does not depend on the \
             substep{repeated}"
        ),
    );
    rate
}
