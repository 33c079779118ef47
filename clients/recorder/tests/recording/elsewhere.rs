//! A recording in an independent reader: the Python packages `mcap` and `mcap-protobuf-support`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use cosplat_recorder::recover::recover;
use cosplat_recorder::topics::*;
use cosplat_recorder::writer::{Compression, WriterOptions};
use serde_json::{Value, json};

use super::synthetic::{Run, SCENE_SOURCE};

const RUN: Run = Run {
    steps: 40,
    gaussians: 300,
    epoch: 5,
};

/// The interpreter of an environment with the packages; `None`, said aloud, when it cannot be had.
fn python(test: &str) -> Option<&'static Path> {
    // Made once: tests run side by side.
    static PYTHON: OnceLock<Option<PathBuf>> = OnceLock::new();
    let python = PYTHON.get_or_init(environment).as_deref();
    if python.is_none() {
        let why = format!("needs python3 with venv and the packages {PACKAGES:?}");
        assert!(
            std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(),
            "{test}: {why}"
        );
        eprintln!("SKIPPED: {test}: {why}");
    }
    python
}

const PACKAGES: [&str; 2] = ["mcap==1.6.0", "mcap-protobuf-support==0.6.0"];

/// A Python environment below the target folder.
fn environment() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-mcap");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output();
        output.is_ok_and(|output| output.status.success())
    };
    let install = ["-m", "pip", "install", "--quiet", PACKAGES[0], PACKAGES[1]];
    let is_ready = run(&python, &["-c", "import mcap, mcap_protobuf"])
        || (run(
            Path::new("python3"),
            &["-m", "venv", &folder.to_string_lossy()],
        ) && run(&python, &install));
    is_ready.then_some(python)
}

/// What the reference reader says about `recording`.
fn read_elsewhere(python: &Path, recording: &Path) -> Result<Value, String> {
    let mut published = Vec::new();
    for step in 0..RUN.steps {
        published.extend_from_slice(&step.to_le_bytes());
        published.extend_from_slice(&(RUN.gaussians as u64).to_le_bytes());
        for gaussian in RUN.frame(step) {
            published.extend_from_slice(bytemuck::cast_slice(&gaussian.position));
        }
    }
    let side_file = recording.with_extension("published");
    std::fs::write(&side_file, published).unwrap();
    let output = Command::new(python)
        .args(["-c", include_str!("check.py")])
        .args([recording, &side_file])
        .output()
        .unwrap();
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    Ok(serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn the_reference_reader_finds_every_step_once_and_bit_for_bit() {
    let Some(python) = python("the_reference_reader_finds_every_step_once_and_bit_for_bit") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let options = WriterOptions {
            compression,
            chunk_bytes: 100_000,
            ..Default::default()
        };
        RUN.write(&path, &options);
        let report = read_elsewhere(python, &path).unwrap();
        assert_eq!(report["steps"], json!((0..RUN.steps).collect::<Vec<_>>()));
        assert_eq!(report["wrong"], json!([]));
        let steps = RUN.steps;
        let commands: Vec<u64> = (0..steps)
            .filter_map(|s| RUN.command(s))
            .map(|c| c.step)
            .collect();
        assert_eq!(
            report["counts"],
            json!({
                GAUSSIANS_TOPIC: steps, STATUS_TOPIC: steps, OBJECTS_TOPIC: steps, TRANSFORMS_TOPIC: steps,
                JOURNAL_TOPIC: commands.len(),
            })
        );
        assert_eq!(report["journal"], json!(commands));
        assert_eq!(
            report["schemas"][GAUSSIANS_TOPIC],
            json!(["foxglove.PointCloud", "protobuf"])
        );
        assert_eq!(
            report["schemas"][TRANSFORMS_TOPIC],
            json!(["foxglove.FrameTransforms", "protobuf"])
        );
        assert_eq!(
            report["schemas"][OBJECTS_TOPIC],
            json!(["cosplat.Objects", "jsonschema"])
        );
        let (_, objects) = RUN.objects(7);
        assert_eq!(
            report["frames_of"]["7"][2],
            json!(["object/2", objects[2].com[0], objects[2].rotation[3]])
        );
        assert_eq!(report["ply"], "ply\nformat binary_little_endian 1.0\n");
        assert_eq!(report["toml"], SCENE_SOURCE);
        assert_eq!(report["metadata"][0]["session"], "test");
        assert_eq!(report["message_count"], 4 * steps + commands.len() as u64);
    }
}

/// And refuses what is damaged.
#[test]
fn the_reference_reader_takes_what_was_recovered() {
    let Some(python) = python("the_reference_reader_takes_what_was_recovered") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let options = WriterOptions {
        chunk_bytes: 100_000,
        ..Default::default()
    };
    RUN.write(&path, &options);
    let mut bytes = std::fs::read(&path).unwrap();
    // Damage in the middle, and the end cut off.
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    bytes.truncate(bytes.len() * 9 / 10);
    std::fs::write(&path, bytes).unwrap();
    assert!(read_elsewhere(python, &path).is_err());

    let recovered = folder.path().join("recovered.mcap");
    let outcome = recover(&path, &recovered, false).unwrap();
    let report = read_elsewhere(python, &recovered).unwrap();
    let steps = RUN.checked_steps(&recovered);
    assert_eq!(report["steps"], json!(steps));
    assert_eq!(report["wrong"], json!([]));
    assert_eq!(
        report["counts"][GAPS_TOPIC],
        json!(outcome.lost_steps.len())
    );
    assert_eq!(outcome.lost_steps.len(), 1);
    assert!(steps.len() as u64 > RUN.steps / 2, "{steps:?}");
}
