//! The main job in one go.

use std::{path::Path, time::Duration};

use crate::stage::{Process, Stage, has_bytes, watchdog};
use crate::web::Page;

/// Processes that a process has started and that still run.
fn children(pid: u32) -> Vec<u32> {
    let list = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
    let list = list.unwrap_or_default();
    let pids = list.split_whitespace().filter_map(|pid| pid.parse().ok());
    pids.filter(|&pid| runs(pid)).collect()
}

/// Whether a process is there and no mere entry of one that has ended.
fn runs(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat
        .rsplit(") ")
        .next()
        .and_then(|rest| rest.chars().next());
    state.is_some_and(|state| !"ZX".contains(state))
}

/// Runs a short demo and checks what every demo promises.
fn demo(stage: &Stage, arguments: &[&str]) -> serde_json::Value {
    let mut all = vec!["demo", "--json", "--size", "160x120", "--out", "out"];
    all.extend(arguments);
    let mut demo = Process::start(stage.cosplat(&all));
    let outcome = demo.result();
    let published = outcome["frames_published"].as_u64().expect("a count");
    assert_eq!(
        outcome["frames_recorded"].as_u64(),
        Some(published),
        "{outcome}"
    );
    assert_eq!(outcome["frames_dropped"], 0);
    assert!(outcome["frames_rendered"].as_u64() > Some(0), "{outcome}");
    assert!(
        outcome["commands_acknowledged"].as_u64() >= Some(2),
        "{outcome}"
    );
    assert!(outcome["latency_us"]["p99"].as_f64() >= outcome["latency_us"]["p50"].as_f64());
    for file in ["recording", "picture", "video"] {
        let path = Path::new(outcome[file].as_str().expect("a path"));
        assert!(has_bytes(path), "{file}: {}", path.display());
    }
    assert_eq!(outcome["state_hash"].as_str().map(str::len), Some(16));
    outcome
}

#[test]
fn the_demo_simulates_records_renders_and_pushes() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let outcome = demo(&stage, &["--duration", "0.5", "--free"]);
    assert!(outcome["gaussians"].as_u64() > Some(10_000), "{outcome}");
    let again = demo(&Stage::new(), &["--duration", "0.5", "--free"]);
    assert_eq!(
        again["state_hash"], outcome["state_hash"],
        "the demo is deterministic"
    );
}

#[test]
fn a_demo_in_the_browser_prints_one_link_that_works() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut demo = Process::start(stage.cosplat(&["demo", "--web", "--out", "out"]));
    let line = demo.wait_for_output("\n");
    let words: Vec<&str> = line.split_whitespace().collect();
    let links: Vec<_> = words.iter().filter(|word| word.contains("://")).collect();
    let [link] = links.as_slice() else {
        panic!("expected one link: {line}");
    };
    let page = Page::at(stage, link);
    // Who has the link gets the page, the scene, and frames of a run that begins then.
    assert_eq!(page.status_of("/"), 200);
    let first = page.step_of_news(0);
    assert!(page.step_of_news(first) > first);
    let started = children(demo.id());
    assert!(started.len() >= 2, "{started:?}");
    demo.signal("INT");
    assert!(demo.wait().success(), "{}", demo.words());
    assert_eq!(demo.output(), "", "one line is all that it says");
    while started.iter().any(|&pid| runs(pid)) {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_killed_demo_leaves_no_process() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut demo = Process::start(stage.cosplat(&["demo", "--duration", "600", "--out", "out"]));
    // Server, recorder, viewer at least; the watchdog ends this if they never come.
    let started = loop {
        let started = children(demo.id());
        if started.len() >= 3 {
            break started;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    demo.kill();
    while started.iter().any(|&pid| runs(pid)) {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn the_demo_drops_any_splat() {
    let _watchdog = watchdog();
    let Some(splat) = crate::stage::test_data("spot_10k.splat") else {
        return;
    };
    let stage = Stage::new();
    let path = splat.to_str().expect("a plain path");
    let outcome = demo(&stage, &["--duration", "0.3", "--free", "--splat", path]);
    assert!(outcome["gaussians"].as_u64() > Some(9_000), "{outcome}");
    assert!(outcome["particles"].as_u64() > Some(100), "{outcome}");
}

#[test]
fn a_missing_splat_is_a_sentence_and_leaves_no_process() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let output = stage
        .cosplat(&["demo", "--splat", "nowhere.ply", "--out", "out"])
        .output()
        .expect("cosplat can be run");
    assert!(!output.status.success());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains("nowhere.ply"), "{words}");
    assert!(cosplat_ipc::list_sessions(&stage.domain).is_empty());
}

/// Without captures all is generated: the command works from a clean checkout.
#[test]
fn pictures_of_a_splat_end_in_a_collision_of_two_words() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let arguments = [
        "demo",
        "--semantic",
        "--draft",
        "--json",
        "--size",
        "200x150",
    ];
    let more = ["--out", "out", "--duration", "0.05"];
    let mut line = stage.cosplat(&[&arguments[..], &more].concat());
    line.env("COSPLAT_TEST_DATA", "nowhere");
    let mut demo = Process::start(line);
    // The whole line, however long it takes on a busy machine.
    let told = demo.wait_for_output("}\n");
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    assert!(demo.wait().success(), "{}", demo.words());
    assert_eq!(told["captured"], false, "{told}");
    assert_eq!(told["absent_means"], false, "{told}");
    // Small pictures whose masks are off by 4 pixels cost small things; the two that are asked for are found.
    assert!(told["lifted"]["iou"].as_f64() > Some(0.7), "{told}");
    let moved = told["collision"]["objects"].as_array().expect("objects");
    let material = |name: &str| {
        let found = moved.iter().find(|o| o["name"] == name);
        found.and_then(|o| o["material"].as_str())
    };
    assert_eq!(moved.len(), 2, "{told}");
    assert_eq!(
        [material("ball"), material("cushion")],
        [Some("rubber"), Some("foam")]
    );
    assert_eq!(told["commands"].as_array().map(Vec::len), Some(7), "{told}");
    let kept = [
        "sheet.png",
        "collision.mp4",
        "collision.toml",
        "scene.toml",
        "materials.txt",
        "splat.ply",
        "refined.ply",
        "objects_lifted.png",
        "objects_refined.png",
        "objects_asked.png",
        "words.safetensors",
    ];
    for file in kept {
        assert!(has_bytes(&stage.path("out").join(file)), "{file}");
    }
}
