//! The scenes of the demo and the pushes that go with them.

use std::path::Path;

use anyhow::Context;
use cosplat_files::reading;
use cosplat_scene::{
    assets,
    load::load_text,
    scene_file::{Axis, DropOptions, SceneFile, View, drop_scene},
};
use cosplat_sim_core::{Scene, scene::Fidelity};

use crate::run::Files;

/// Two vases on a table, generated; the left one is pushed into the right one.
const TWO_VASES: &str = include_str!("../../scenes/two_vases.toml");
/// The pushes of that scene.
const TWO_VASES_PUSH: &str = include_str!("../../scenes/two_vases_push.toml");
/// A script that only starts the simulation.
const START: &str = "[[order]]\naction = \"resume\"\n";
/// Speed that a push gives to what was dropped [m/s].
const PUSH_SPEED: f64 = 0.7;

/// Writes the scene file and the controller's script; returns how the scene is shown, where it says so.
pub fn write(
    files: &Files,
    splat: Option<&Path>,
    up: Option<&str>,
) -> anyhow::Result<Option<View>> {
    let (scene, script) = match splat {
        None => (TWO_VASES.to_owned(), TWO_VASES_PUSH.to_owned()),
        Some(path) => dropped(path, up, &files.scene)?,
    };
    write_both(files, &scene, &script)?;
    Ok(SceneFile::parse(&scene)?.view)
}

/// Writes a scene in which everything happens by itself, and the script that starts it.
pub fn write_known(files: &Files, scene: &str) -> anyhow::Result<()> {
    write_both(files, scene, START)
}

fn write_both(files: &Files, scene: &str, script: &str) -> anyhow::Result<()> {
    for (path, text) in [(&files.scene, scene), (&files.script, script)] {
        cosplat_files::write(path, text)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// A splat dropped onto a floor, and pushes to either side once it lies there.
fn dropped(splat: &Path, up: Option<&str>, scene: &Path) -> anyhow::Result<(String, String)> {
    let splat = splat
        .canonicalize()
        .with_context(|| format!("cannot find {}", splat.display()))?;
    let name = splat
        .to_str()
        .with_context(|| format!("{} is not UTF-8, rename it", splat.display()))?;
    let content = reading::read(&splat, reading::LARGEST_DATA);
    let bytes = content.with_context(|| format!("cannot read {name}"))?;
    let (gaussians, _) = assets::read(name, &bytes)?;
    let options = DropOptions {
        up: up.map(axis).transpose()?,
        ..DropOptions::default()
    };
    let text =
        drop_scene(&gaussians, name, &options).map_err(|e| anyhow::anyhow!("{name}: {e}"))?;
    let built = load_text(text.clone(), scene)?.scene;
    Ok((text, pushes(&built)))
}

fn axis(text: &str) -> anyhow::Result<Axis> {
    Ok(match text.to_ascii_lowercase().as_str() {
        "+x" | "x" => Axis::X,
        "+y" | "y" => Axis::Y,
        "+z" | "z" => Axis::Z,
        "-x" => Axis::NegX,
        "-y" => Axis::NegY,
        "-z" => Axis::NegZ,
        _ => anyhow::bail!("--up is \"{text}\", expected one of +x -x +y -y +z -z"),
    })
}

/// Pushes the whole of every moving object, first one way, then back.
fn pushes(scene: &Scene) -> String {
    let mut script = START.to_owned();
    for (id, object) in scene.objects.iter().enumerate() {
        if object.fidelity == Fidelity::Static {
            continue;
        }
        let volume: f64 = scene.particles.volume[object.particles.clone()]
            .iter()
            .sum();
        let impulse = PUSH_SPEED * object.material.density * volume;
        for (time, direction) in [(1.2, 1.0), (2.4, -1.0)] {
            let along = direction * impulse;
            script.push_str(&format!(
                "\n[[order]]\ntime = {time}\naction = \"push\"\nobject = {id}\nimpulse = [{along:?}, 0, 0]\n"
            ));
        }
    }
    script
}
