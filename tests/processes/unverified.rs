//! What `verify` cannot compare is not verified, and it says so in the words of `inspect`.

use std::{collections::BTreeMap, fs, path::Path};

use serde_json::Value;

use crate::{
    doctor::{rewrite, rewrite_scene},
    stage::{Process, Stage, wait_for_status, watchdog},
};

/// A recording of six frames.
fn recorded(stage: &Stage) {
    let mut server = stage.serve(&["--paused", "--duration", "0.1", "--pace", "free"]);
    let client = stage.client();
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap"]));
    wait_for_status(&client, |s| s.frame_readers >= 1);
    assert!(stage.ctl(&["resume"]).status.success());
    server.result();
    assert!(recorder.wait().success());
}

/// Exit status, outcome, and what `inspect` says.
fn verify(stage: &Stage, name: &str) -> (Option<i32>, Value, String) {
    let run = |words: &[&str]| stage.cosplat(words).output().expect("it runs");
    let ended = run(&["verify", name, "--json"]);
    let outcome = serde_json::from_slice(&ended.stdout).unwrap_or_default();
    let said = run(&["inspect", name]).stdout;
    let said = String::from_utf8_lossy(&said).into_owned();
    (ended.status.code(), outcome, said)
}

fn nothing(_: &mut BTreeMap<String, String>) {}

#[test]
fn a_recording_without_what_can_be_compared_is_not_verified() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    recorded(&stage);
    let whole = stage.path("run.mcap");
    let (code, outcome, said) = verify(&stage, "run.mcap");
    assert_eq!(
        (code, &outcome["verified"]),
        (Some(0), &true.into()),
        "{outcome}"
    );
    assert_eq!(outcome["runs"][0]["objects_compared"], 6, "{outcome}");
    assert!(said.contains("can be verified"), "{said}");

    // Beginnings of topics that are left out.
    let less: [(&str, &[&str], &str); 4] = [
        ("frames", &["/gaussians", "/places"], "no frame"),
        ("places", &["/places"], "no frame"),
        ("objects", &["/objects"], "none of its 2 objects"),
        ("messages", &["/"], "no frame"),
    ];
    for (what, without, words) in less {
        rewrite(&whole, &stage.path("less.mcap"), nothing, |message| {
            !without
                .iter()
                .any(|start| message.topic.starts_with(*start))
        });
        let (code, outcome, said) = verify(&stage, "less.mcap");
        assert_eq!(code, Some(1), "without {what}: {outcome}");
        let cannot = outcome["runs"][0]["cannot"].as_str().unwrap_or_default();
        assert!(cannot.contains(words), "without {what}: {outcome}");
        // `inspect` says it in the same words.
        assert!(
            said.contains(&format!("cannot be verified: {cannot}")),
            "{what}: {said}"
        );
    }
    // A file that was cut before its first frame.
    let bytes = fs::read(&whole).expect("a recording");
    for part in [8, 4, 2] {
        fs::write(stage.path("cut.mcap"), &bytes[..bytes.len() / 2 / part]).expect("written");
        let words = [
            "recover",
            "cut.mcap",
            "-o",
            "less.mcap",
            "--force",
            "--json",
        ];
        let report = Process::start(stage.cosplat(&words)).result();
        let (code, outcome, said) = verify(&stage, "less.mcap");
        if report["frames"] == 0 {
            assert_eq!(code, Some(1), "{outcome}");
            assert!(!said.contains("  can be verified"), "{said}");
        }
    }
}

#[test]
fn another_scene_at_rest_than_the_text_makes_is_found() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    recorded(&stage);
    let whole = stage.path("run.mcap");
    let found = |of: &str, change: &dyn Fn(&Path)| {
        change(&stage.path("other.mcap"));
        let (code, outcome, _) = verify(&stage, "other.mcap");
        let cannot = outcome["runs"][0]["cannot"].as_str().unwrap_or_default();
        assert!(code == Some(1) && cannot.contains(of), "{of}: {outcome}");
    };
    for block in [
        "scene.ply",
        "scene/gaussians.bin",
        "scene/objects.bin",
        "scene/sh.bin",
    ] {
        found(block, &|to| {
            rewrite_scene(&whole, to, |name, data| {
                if name == block {
                    let last = data.len() - 1;
                    data[last] ^= 1;
                }
            });
        });
    }
    for key in [
        "dx",
        "gravity",
        "frame_rate",
        "particle_count",
        "bounds_max",
    ] {
        found(key, &|to| {
            let change = |metadata: &mut BTreeMap<String, String>| {
                let value = metadata.get_mut(key).expect("it is there");
                let end = value.trim_end_matches(']').len() - 1;
                let digit = if &value[end..=end] == "1" { "2" } else { "1" };
                value.replace_range(end..=end, digit);
            };
            rewrite(&whole, to, change, |_| true);
        });
    }
}
