//! Same scene, same orders: the same bits, whatever computes them.

use super::super::recorded::{Recorded, record};
use crate::{
    trial::{SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SCENE: SceneText = scene_text!("validate/determinism");

/// The case.
pub const CASE: Case = Case {
    number: 20,
    name: "determinism",
    about: "threads and instruction sets change no bit, and a session played again is the same",
    run,
};

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let duration = if size == Size::Quick { 0.5 } else { 2.0 };
    let hashes = |option: &str| -> anyhow::Result<(Trial, Vec<String>)> {
        let trial = Trial::new(&SCENE, duration).option(option);
        let frames = trial.run()?.frames;
        let hashes = frames.iter().map(|frame| frame["state_hash"].to_string());
        Ok((trial, hashes.collect()))
    };
    let (_, reference) = hashes("--threads=1")?;
    let mut rows = Vec::new();
    for (option, name) in [
        ("--threads=2", "2 threads"),
        ("--threads=4", "4 threads"),
        ("--threads=8", "8 threads"),
        ("--isa=portable", "portable instructions"),
    ] {
        let (trial, other) = hashes(option)?;
        let different = reference.iter().zip(&other).filter(|(a, b)| a != b).count()
            + reference.len().abs_diff(other.len());
        rows.push(Row {
            quantity: format!(
                "{name} against 1 thread: frames of {} that differ",
                reference.len()
            ),
            reference: 0.0,
            source: "same bits",
            measured: different as f64,
            gate: Gate::Absolute(0.0),
            known_failure: None,
            command: trial.command(),
        });
    }
    let order: &[&str] = &["--at-step", "5", "push", "ball", "2", "0", "0"];
    let first = record(&SCENE, duration, 1, &[order])?;
    let again = record(&SCENE, duration, 4, &[order])?;
    rows.push(Row {
        quantity: format!(
            "recorded, played again: frames of {} that differ in any bit",
            first.frames.len()
        ),
        reference: 0.0,
        source: "same bits",
        measured: different(&first, &again) as f64,
        gate: Gate::Absolute(0.0),
        known_failure: None,
        command: format!(
            "cosplat serve {} --paused --lossless --pace free --duration {duration} --threads 4; cosplat record -o run.mcap; \
             cosplat ctl {}; cosplat ctl resume",
            SCENE.path,
            order.join(" ")
        ),
    });
    Ok(rows)
}

fn different(a: &Recorded, b: &Recorded) -> usize {
    let frames = a.frames.iter().zip(&b.frames);
    let unlike = frames.filter(|((h, g), (i, k))| {
        (h.step, h.sim_time, h.state_hash) != (i.step, i.sim_time, i.state_hash) || g != k
    });
    unlike.count() + a.frames.len().abs_diff(b.frames.len()) + a.commands.abs_diff(b.commands)
}
