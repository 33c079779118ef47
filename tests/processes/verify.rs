//! What was recorded can be simulated again from the recording alone, and whatever was changed in it is found.

use std::{fmt::Write, fs, path::Path};

use cosplat_ipc::schema::Status;
use cosplat_recorder::reader::{Event, Recording};
use cosplat_scene::assets::{generate, ply};
use serde_json::Value;

use crate::{
    doctor::rewrite,
    stage::{Process, SMALL_SCENE, Stage, wait_for_status, watchdog},
};

/// Ten scenes: what they add to or replace in [`SMALL_SCENE`].
const SCENES: [(&str, &[[&str; 2]]); 10] = [
    ("rubber", &[]),
    (
        "metal and plasticine",
        &[
            [
                "left_material",
                r#"{ law = "von_mises", youngs_modulus_pa = 2e6, poisson_ratio = 0.3, density_kg_m3 = 2700, yield_stress_pa = 8e3, hardening_pa = 2e4 }"#,
            ],
            [
                "right_material",
                r#"{ preset = "plasticine", youngs_modulus_pa = 1e6 }"#,
            ],
        ],
    ),
    (
        "sand and water",
        &[
            [
                "left_material",
                r#"{ preset = "dry_sand", youngs_modulus_pa = 1e6 }"#,
            ],
            ["right_material", r#""water""#],
        ],
    ),
    (
        "snow and foam",
        &[
            [
                "left_material",
                r#"{ preset = "packed_snow", youngs_modulus_pa = 1.4e5 }"#,
            ],
            ["right_material", r#""toothpaste""#],
        ],
    ),
    ("a rigid body", &[["left_material", r#""rigid""#]]),
    ("automatic fidelity", &[["fidelity", "auto"]]),
    ("contact of spheres", &[["top", "contact = \"com_sphere\""]]),
    (
        "a domain that deletes",
        &[[
            "top",
            "contact = \"multi_field\"\ngravity = [2.0, -5.0, 0.0]\ndomain = { min = [-0.6, -0.2, -0.4], max = [0.6, 0.6, 0.4], policy = \"delete\" }",
        ]],
    ),
    (
        "files",
        &[[
            "end",
            "[[objects]]\nname = \"table\"\npath = \"assets/table.ply\"\nfidelity = \"static\"\ntranslation = [0, -0.05, 0]\n\n[[colliders]]\nname = \"ramp\"\nshape = \"mesh\"\npath = \"assets/ramp.obj\"\n",
        ]],
    ),
    (
        "settled, coherent, bouncing",
        &[
            ["top", "settle = 0.1\nseed = 5"],
            [
                "left_keys",
                "coherence = 20\nlinear_velocity = [1, 0, 0]\nrestitution = 0.6",
            ],
        ],
    ),
];

/// The scene file of one of [`SCENES`].
fn scene_text(changes: &[[&str; 2]]) -> String {
    let value = |key: &str, default: &str| {
        let found = changes.iter().find(|[k, _]| *k == key);
        found.map_or(default, |[_, value]| value).to_owned()
    };
    let mut text = SMALL_SCENE.replacen(
        "version = 1",
        &format!("version = 1\n{}", value("top", "")),
        1,
    );
    let soft = r#""soft_rubber""#;
    for (name, key) in [("left", "left_material"), ("right", "right_material")] {
        let head = format!("name = \"{name}\"\n");
        let at = text.find(&head).expect("the object") + head.len();
        let place = at + text[at..].find(soft).expect("its material");
        let keys = if name == "left" {
            value("left_keys", "")
        } else {
            String::new()
        };
        let fidelity = value("fidelity", "mpm");
        let new = format!("{}\nfidelity = \"{fidelity}\"\n{keys}", value(key, soft));
        text.replace_range(place..place + soft.len(), &new);
    }
    text + "\n" + &value("end", "")
}

/// Puts the files that the scene of that name reads beside it.
fn write_assets(stage: &Stage) {
    let folder = stage.path("assets");
    fs::create_dir_all(&folder).expect("a folder");
    let table = generate::builtin("table").expect("known");
    fs::write(folder.join("table.ply"), ply::write(&table)).expect("written");
    let ramp = "v -0.6 0 0.4\nv -0.6 0 -0.4\nv -0.2 0.1 0\nf 1 2 3\n";
    fs::write(folder.join("ramp.obj"), ramp).expect("written");
}

/// Orders by chance, the same for the same seed.
fn random_script(seed: u64) -> String {
    let mut state = seed;
    // Knuth's MMIX generator; its high bits are good enough for pushes.
    let mut next = |below: u64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    let mut text = String::new();
    for _ in 0..8 {
        let (time, object) = (next(40) as f64 * 0.02, ["left", "right"][next(2) as usize]);
        let [x, y, z] = [0; 3].map(|_| next(2001) as f64 / 1000.0 - 1.0);
        let action = match next(8) {
            0..3 => format!("action = \"push\"\nobject = \"{object}\"\nimpulse = [{x}, {y}, {z}]"),
            3 => format!(
                "action = \"set-velocity\"\nobject = \"{object}\"\nlinear = [{x}, {y}, {z}]\nangular = [{y}, {z}, {x}]"
            ),
            4 => format!("action = \"gravity\"\ngravity = [{x}, -9.81, {z}]"),
            5 => format!(
                "action = \"move-collider\"\ncollider = \"floor\"\ntranslation = [0, {}, 0]",
                0.02 * y
            ),
            6 => format!(
                "action = \"pin\"\nobject = \"{object}\"\npoint = [{x}, {y}, {z}]\nradius = 0.1"
            ),
            _ => {
                // All of it, or a patch.
                let patch = format!(
                    "\npoint = [{}, {}, {z}]\nradius = 0.1",
                    0.4 * x,
                    0.2 + 0.2 * y
                );
                let patch = if z < 0.2 { &patch } else { "" };
                format!(
                    "action = \"set-material\"\nobject = \"{object}\"{patch}\nmaterial = {{ preset = \"soft_rubber\", youngs_modulus_pa = {} }}",
                    1e5 * (1.5 + x)
                )
            }
        };
        write!(text, "[[order]]\ntime = {time}\n{action}\n\n").expect("text");
    }
    text
}

/// Records a scene served on two threads while three processes order something by chance.
pub fn record(stage: &Stage, scene: &str, seed: u64, arguments: &[&str]) -> Value {
    record_as(stage, scene, seed, arguments, &[])
}

/// The same with options of the recorder.
fn record_as(
    stage: &Stage,
    scene: &str,
    seed: u64,
    arguments: &[&str],
    recording: &[&str],
) -> Value {
    let mut all = vec![
        "--paused",
        "--pace",
        "free",
        "--lossless",
        "--threads",
        "2",
        "--duration",
        "0.8",
    ];
    all.extend(arguments);
    let mut server = stage.serve_scene(scene, &all);
    let client = stage.client();
    let words = ["record", "-o", "run.mcap", "--json", "--force"];
    let mut recorder = Process::start(stage.cosplat(&[&words, recording].concat()));
    wait_for_status(&client, |s: &Status| s.frame_readers >= 1);
    let mut clients: Vec<_> = (0..3)
        .map(|n| {
            let script = stage.path(&format!("orders{n}.toml"));
            fs::write(&script, random_script(3 * seed + n)).expect("written");
            let script = script.to_str().expect("a plain path").to_owned();
            Process::start(stage.cosplat(&["ctl", "script", &script, "--json"]))
        })
        .collect();
    // What a scene refuses, such as another material for a body, is refused; the rest is taken.
    for client in &mut clients {
        client.wait();
    }
    assert!(stage.ctl(&["resume"]).status.success());
    server.result();
    recorder.result()
}

/// Outcome of `cosplat verify` and its exit status.
pub fn verify(stage: &Stage, recording: &Path, threads: &str) -> (bool, Value) {
    let recording = recording.to_str().expect("a plain path");
    let arguments = ["verify", recording, "--threads", threads, "--json"];
    let output = stage.cosplat(&arguments).output().expect("cosplat runs");
    let line = String::from_utf8_lossy(&output.stdout).into_owned();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    let outcome = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line} {words}"));
    (output.status.success(), outcome)
}

/// Records scenes and verifies each on one, three and eight threads.
fn scenes_verify(range: std::ops::Range<usize>) {
    let _watchdog = watchdog();
    for n in range {
        let (name, changes) = SCENES[n];
        let stage = Stage::new();
        write_assets(&stage);
        let summary = record(&stage, &scene_text(changes), n as u64, &[]);
        assert_eq!(summary["frames_recorded"], 41, "{name}: {summary}");
        for threads in ["1", "3", "8"] {
            let (success, outcome) = verify(&stage, &stage.path("run.mcap"), threads);
            assert!(success, "{name} on {threads} threads: {outcome}");
            let run = &outcome["runs"][0];
            assert_eq!(
                run["steps"],
                serde_json::json!([0, 40]),
                "{name}: {outcome}"
            );
            assert_eq!(run["frames_compared"], 41, "{name}: {outcome}");
            let commands = run["commands"].as_u64().expect("a number");
            assert!(commands >= 8, "{name}: {commands} commands took effect");
        }
    }
}

#[test]
fn recordings_of_solids_verify_on_any_threads() {
    scenes_verify(0..3);
}

#[test]
fn recordings_of_soft_matter_and_bodies_verify() {
    scenes_verify(3..7);
}

#[test]
fn recordings_of_scenes_with_files_and_edges_verify() {
    scenes_verify(7..10);
}

#[test]
fn a_moved_recording_verifies_when_its_files_are_gone() {
    let _watchdog = watchdog();
    let (stage, elsewhere) = (Stage::new(), Stage::new());
    write_assets(&stage);
    let scene = scene_text(SCENES[8].1);
    // A run that goes on from a checkpoint: that is a file, too.
    let mut server =
        stage.serve_scene(&scene, &["--paused", "--duration", "0.1", "--pace", "free"]);
    let ordered = Process::start(stage.cosplat(&["ctl", "--at-step", "4", "checkpoint", "--json"]));
    wait_for_status(&stage.client(), |s| s.commands_accepted > 0);
    assert!(stage.ctl(&["resume"]).status.success());
    server.result();
    let mut ordered = ordered;
    let file = ordered.result()["files"][0]
        .as_str()
        .expect("a path")
        .to_owned();
    record(&stage, &scene, 9, &["--restore", &file]);

    fs::remove_file(&file).expect("the checkpoint goes");
    fs::remove_dir_all(stage.path("assets")).expect("the files go");
    fs::remove_file(stage.path("scene.toml")).expect("the scene goes");
    let moved = elsewhere.path("elsewhere.mcap");
    fs::rename(stage.path("run.mcap"), &moved).expect("moved");
    let (success, outcome) = verify(&elsewhere, &moved, "1");
    assert!(success, "{outcome}");
    assert_eq!(
        outcome["runs"][0]["steps"],
        serde_json::json!([3, 43]),
        "{outcome}"
    );

    let output = elsewhere
        .cosplat(&["inspect", "elsewhere.mcap"])
        .output()
        .expect("it runs");
    let words = String::from_utf8_lossy(&output.stdout).into_owned();
    for expected in [
        "3 objects: left, right, table",
        "steps 3 to 43",
        "began with a checkpoint",
        "assets/table.ply, assets/ramp.obj",
        "can be verified",
    ] {
        assert!(words.contains(expected), "{expected:?} not in {words}");
    }
}

#[test]
fn a_recording_that_ends_leaves_no_checkpoint_behind() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let folder = stage.path("states");
    fs::create_dir(&folder).expect("a folder");
    let to = ["--checkpoints", folder.to_str().expect("a plain path")];
    let _server = stage.serve_scene(SMALL_SCENE, &to);
    for _ in 0..4 {
        // Each frame makes one due: an order is under way whenever the recording ends.
        let arguments = ["record", "-o", "run.mcap", "--json", "--force"];
        let often = ["--duration", "0.3", "--checkpoint-every", "1e-6"];
        let summary = Process::start(stage.cosplat(&[&arguments[..], &often].concat())).result();
        assert!(summary["checkpoints"].as_u64() > Some(0), "{summary}");
        let left = fs::read_dir(&folder).expect("a folder").count();
        assert_eq!(left, 0, "{summary}");
    }
}

#[test]
fn parts_verify_from_checkpoints_and_can_be_branched() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let options = ["--split-duration", "0.2", "--checkpoint-every", "0.1"];
    let folder = stage.path("states");
    fs::create_dir(&folder).expect("a folder");
    let to = ["--checkpoints", folder.to_str().expect("a plain path")];
    let summary = record_as(&stage, SMALL_SCENE, 12, &to, &options);
    let checkpoints = summary["checkpoints"].as_u64().expect("a number");
    let (mut steps, mut compared, mut parts) = (0, 0, Vec::new());
    for part in 1.. {
        let name = format!("run-{part:04}.mcap");
        if !stage.path(&name).exists() {
            break;
        }
        let (success, outcome) = verify(&stage, &stage.path(&name), "2");
        let run = &outcome["runs"][0];
        // Of a last part that ended before its first frame nothing can be compared.
        assert_eq!(success, !run["steps"].is_null(), "{name}: {outcome}");
        assert_eq!(run["steps_before"], 0, "{name}: {outcome}");
        assert_eq!(
            run["from_checkpoint"].is_null(),
            part == 1,
            "{name}: {outcome}"
        );
        steps += run["frames_compared"].as_u64().expect("a number");
        compared += run["checkpoints_compared"].as_u64().expect("a number");
        parts.push((name, run["steps"].clone()));
    }
    assert_eq!(steps, 41, "each step is in one part: {parts:?}");
    assert!(parts.len() > 2, "{parts:?}");
    // Those that a part is taken up from are not compared.
    assert!(
        compared > 0 && compared < checkpoints,
        "{compared} of {checkpoints}"
    );
    let left = fs::read_dir(folder).expect("a folder").count();
    assert_eq!(left, 0, "what is in the recording stays not in the folder");

    let (name, steps) = &parts[1];
    let last = steps[1].to_string();
    let branch = |at: &str| {
        let words = [
            "branch",
            name,
            "--at",
            at,
            "--session",
            "other",
            "--duration",
            "0.04",
        ];
        let paced = ["--pace", "free"];
        stage
            .cosplat(&[&words[..], &paced].concat())
            .output()
            .expect("it runs")
    };
    let output = branch(&last);
    assert!(output.status.success(), "{output:?}");
    let output = branch("1");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && words.contains("step 1"),
        "{words}"
    );
}

#[test]
fn a_run_joined_late_verifies_from_its_checkpoint() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let summary = record_as(&stage, SMALL_SCENE, 13, &[], &["--checkpoint-every", "0.2"]);
    assert!(summary["checkpoints"].as_u64() > Some(1), "{summary}");
    // As if the recorder had come after the first commands, and the server kept them no longer.
    let mut commands = 0;
    rewrite(
        &stage.path("run.mcap"),
        &stage.path("late.mcap"),
        |_| {},
        |message| {
            commands += u32::from(message.topic == "/journal");
            message.topic != "/journal" || commands > 1
        },
    );
    let (success, outcome) = verify(&stage, &stage.path("late.mcap"), "2");
    let run = &outcome["runs"][0];
    assert!(success && run["from_checkpoint"].is_u64(), "{outcome}");
    let from = run["from_checkpoint"].as_u64().expect("a step");
    assert!((1..40).contains(&from), "{outcome}");
    assert_eq!(run["steps_before"], from + 1, "{outcome}");
    assert_eq!(run["steps"], serde_json::json!([from + 1, 40]), "{outcome}");

    let inspect = ["inspect", "run.mcap", "--json"];
    let output = stage.cosplat(&inspect).output().expect("it runs");
    let survey: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(survey["runs"][0]["checkpoints"][1].is_u64(), "{survey}");
}

/// The first difference that `cosplat verify` finds: step and words.
fn first_difference(stage: &Stage, name: &str) -> (u64, String) {
    let (success, outcome) = verify(stage, &stage.path(name), "2");
    assert!(!success, "{name}: {outcome}");
    assert_eq!(outcome["verified"], false, "{name}: {outcome}");
    let found = &outcome["runs"][0]["differs"];
    let step = found["step"]
        .as_u64()
        .unwrap_or_else(|| panic!("{name}: {outcome}"));
    (step, found["what"].to_string())
}

#[test]
fn whatever_was_changed_is_found_at_its_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    record(&stage, SMALL_SCENE, 7, &[]);
    let run = stage.path("run.mcap");
    assert!(verify(&stage, &run, "2").0);

    // One byte, where a Gaussian of step 20 is; its checksum does not know.
    let mut bytes = fs::read(&run).expect("the recording");
    let frames = Recording::open(&run)
        .expect("readable")
        .filter_map(|event| match event {
            Ok(Event::Frame(frame)) if frame.header.step == 20 => Some(frame.gaussians),
            _ => None,
        });
    let gaussian = frames.flatten().nth(7).expect("a Gaussian");
    let pattern = bytemuck::bytes_of(&gaussian);
    let at = bytes
        .windows(64)
        .position(|window| window == pattern)
        .expect("in the file");
    bytes[at + 5] ^= 4;
    fs::write(stage.path("flipped.mcap"), &bytes).expect("written");
    let (step, what) = first_difference(&stage, "flipped.mcap");
    assert_eq!(step, 20, "{what}");
    assert!(
        what.contains("1 of") && what.contains("Gaussians differ"),
        "{what}"
    );
    assert!(!what.contains("state hash"), "{what}");

    // One number of one command.
    let mut altered = None;
    rewrite(
        &run,
        &stage.path("altered.mcap"),
        |_| {},
        |message| {
            let mut entry: Value = serde_json::from_slice(&message.data).unwrap_or_default();
            if entry["name"] == "impulse" && altered.is_none() {
                altered = entry["step"].as_u64();
                entry["vector"][1] = serde_json::json!(0.123);
                message.data = entry.to_string().into_bytes();
            }
            true
        },
    );
    let (step, what) = first_difference(&stage, "altered.mcap");
    assert_eq!(Some(step), altered, "{what}");
    for words in ["state hash", "its com is", "a command took effect: impulse"] {
        assert!(what.contains(words), "{words:?} not in {what}");
    }

    // One step left out.
    rewrite(
        &run,
        &stage.path("dropped.mcap"),
        |_| {},
        |message| message.step != 30 || message.topic == "/journal",
    );
    let (step, what) = first_difference(&stage, "dropped.mcap");
    assert_eq!(step, 30, "{what}");
    assert!(what.contains("/gaps does not say so"), "{what}");

    // One hash.
    rewrite(
        &run,
        &stage.path("hash.mcap"),
        |_| {},
        |message| {
            if message.topic == "/status" && message.step == 11 {
                let mut status: Value = serde_json::from_slice(&message.data).expect("JSON");
                status["state_hash"] = "0123456789abcdef".into();
                message.data = status.to_string().into_bytes();
            }
            true
        },
    );
    let (step, what) = first_difference(&stage, "hash.mcap");
    assert_eq!(step, 11, "{what}");
}

#[test]
fn a_recording_that_lacks_something_is_told_what() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    record(&stage, SMALL_SCENE, 8, &[]);
    let run = stage.path("run.mcap");
    let reason = |name: &str| {
        let (success, outcome) = verify(&stage, &stage.path(name), "2");
        assert!(!success, "{name}: {outcome}");
        let reason = outcome["runs"][0]["cannot"].as_str().map(str::to_owned);
        reason.unwrap_or_else(|| panic!("{name}: {outcome}"))
    };
    // All up to the first command, as if the recorder had come when the server kept it no longer.
    let mut first = None;
    rewrite(
        &run,
        &stage.path("late.mcap"),
        |_| {},
        |message| {
            if message.topic == "/journal" {
                first.get_or_insert(message.step);
            }
            first.is_some_and(|first| message.step > first)
        },
    );
    let words = reason("late.mcap");
    assert!(words.contains("commands before step"), "{words}");
    rewrite(
        &run,
        &stage.path("old.mcap"),
        |values| drop(values.remove("file_count")),
        |_| true,
    );
    let words = reason("old.mcap");
    assert!(words.contains("an older recorder"), "{words}");

    // A gap that is told is crossed: the commands in it are there. A whole frame follows, as a recorder writes one then:
    // here it comes after sixteen in which everything moved.
    let gap = serde_json::json!({ "epoch": "0000000000000001", "from_step": 12, "to_step": 16, "reason": "missed" });
    rewrite(
        &run,
        &stage.path("gap.mcap"),
        |_| {},
        |message| {
            if message.topic == "/objects/tf" && message.step == 16 {
                message.topic = "/gaps".into();
                message.data = gap.to_string().into_bytes();
            }
            !(12..=16).contains(&message.step)
                || ["/journal", "/gaps"].contains(&message.topic.as_str())
        },
    );
    let (success, outcome) = verify(&stage, &stage.path("gap.mcap"), "2");
    assert!(success, "{outcome}");
    assert_eq!(outcome["runs"][0]["frames_compared"], 36, "{outcome}");

    let output = stage
        .cosplat(&["verify", "nothing.mcap"])
        .output()
        .expect("it runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains("nothing.mcap"), "{words}");
}
