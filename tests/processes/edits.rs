//! Objects are put elsewhere, taken away, brought in, recast, and all of it taken back, while processes watch and record.

use std::fs;

use cosplat_ipc::{
    client::{FrameReader, ObjectsReader},
    schema::{FRAME_FLAG_RESTORED, ObjectState, Status},
};

use crate::stage::{PATIENCE, Process, SMALL_SCENE, Stage, next_frame, wait_for_status, watchdog};

/// The two blocks, and a copy of the left one that waits.
pub fn scene() -> String {
    let spare = "\n[[objects]]\nname = \"spare\"\nclone = \"left\"\npresent = false\n";
    format!("{SMALL_SCENE}{spare}")
}

/// What an order says that is refused.
fn refusal(stage: &Stage, order: &[&str]) -> String {
    let output = stage.ctl(order);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{order:?} is not refused");
    words
}

fn obeyed(stage: &Stage, order: &[&str]) {
    let output = stage.ctl(&[&["--timeout", "60"], order].concat());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{order:?}: {words}");
}

/// Who looks at a session.
struct Viewer {
    objects: ObjectsReader,
    frames: FrameReader,
}

/// A step as it was published.
struct Seen {
    rows: Vec<ObjectState>,
    /// Per object its Gaussians, and those of them that are not transparent.
    gaussians: Vec<[usize; 2]>,
    flags: u32,
}

impl Viewer {
    /// Looks at a step.
    fn at(&mut self, step: u64) -> Seen {
        let rows = loop {
            let message = self.objects.next(PATIENCE);
            let message = message.expect("well-formed").expect("it comes in time");
            if message.header().step == step {
                break message.items().to_vec();
            }
        };
        let frame = loop {
            let frame = next_frame(&mut self.frames);
            if frame.header().step == step {
                break frame;
            }
        };
        let count = |object: &ObjectState| {
            let all = frame.gaussians().iter();
            let own = all.filter(|g| g.object == object.id);
            [own.clone().count(), own.filter(|g| g.color[3] > 0).count()]
        };
        Seen {
            gaussians: rows.iter().map(count).collect(),
            flags: frame.header().flags,
            rows,
        }
    }
}

#[test]
fn objects_are_edited_by_words_and_every_reader_sees_it() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve_scene(&scene(), &["--pace", "free", "--paused"]);
    let client = stage.client();
    let mut viewer = Viewer {
        objects: client.objects(64).expect("objects are readable"),
        frames: client.frames(64).expect("frames are readable"),
    };
    let start = viewer.at(0);
    assert_eq!((start.rows[2].fidelity, start.rows[2].mass), (7, 0.0));
    assert!(start.gaussians[2][0] > 0 && start.gaussians[2][1] == 0);

    for (order, said) in [
        (
            &["set-pose", "left", "--at", "0.25", "0.3", "0"][..],
            "overlap object 1 by",
        ),
        (
            &["set-pose", "left", "--at", "0", "0.02", "0"],
            "overlap collider 0 by",
        ),
        (&["set-pose", "left", "--at", "0", "1e5", "0"], "the domain"),
        (&["push", "spare", "1", "0", "0"], "object 2 is not there"),
        (&["bring-in", "spare"], "overlap object 0 by"),
        (&["bring-in", "left"], "object 0 is there already"),
        (&["set-fidelity", "left", "liquid"], "expected static, mpm"),
        (&["set-fidelity", "spare", "rigid"], "object 2 is not there"),
        (&["undo"], "no edit to undo"),
        (&["redo"], "nothing to redo"),
    ] {
        let words = refusal(&stage, order);
        assert!(words.contains(said), "{order:?}: {words}");
    }

    obeyed(&stage, &["set-pose", "left", "--at", "-0.3", "0.8", "0.1"]);
    let turned = ["--at", "0", "0.3", "0", "--rotation-deg", "0", "45", "0"];
    obeyed(&stage, &[&["bring-in", "spare"], &turned[..]].concat());
    obeyed(&stage, &["step"]);
    let edited = viewer.at(1);
    let left = edited.rows[0];
    assert!((left.com[1] - 0.8).abs() < 0.01 && (left.com[2] - 0.1).abs() < 1e-3);
    let spare = edited.rows[2];
    assert!(spare.mass > 0.0 && spare.fidelity == 2, "{spare:?}");
    assert!((spare.rotation[1] - 0.3827).abs() < 1e-3, "{spare:?}");
    assert_eq!(edited.gaussians[2], [start.gaussians[2][0]; 2]);

    obeyed(&stage, &["set-fidelity", "spare", "static"]);
    obeyed(&stage, &["step"]);
    let frozen = viewer.at(2).rows[2];
    assert_eq!(frozen.fidelity, 1);
    obeyed(&stage, &["remove", "right"]);
    obeyed(&stage, &["step", "4"]);
    let later = viewer.at(6);
    assert_eq!(later.rows[2].com, frozen.com, "it stands");
    assert_eq!((later.rows[1].fidelity, later.gaussians[1][1]), (7, 0));

    // One by one.
    obeyed(&stage, &["undo"]);
    obeyed(&stage, &["step"]);
    let back = viewer.at(7);
    assert_eq!(back.gaussians[1], start.gaussians[1]);
    assert!(back.flags & FRAME_FLAG_RESTORED != 0, "{}", back.flags);
    assert_eq!(back.rows[2].fidelity, 1);
    obeyed(&stage, &["undo"]);
    obeyed(&stage, &["step"]);
    assert_eq!(viewer.at(8).rows[2].fidelity, 2);
    obeyed(&stage, &["redo"]);
    obeyed(&stage, &["step"]);
    assert_eq!(viewer.at(9).rows[2].fidelity, 1);
}

#[test]
fn a_recording_of_edits_verifies_on_any_threads() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let rest = [
        "--paused",
        "--pace",
        "free",
        "--lossless",
        "--duration",
        "1.2",
    ];
    let folder = stage.path("states");
    fs::create_dir(&folder).expect("a folder");
    let states = ["--checkpoints", folder.to_str().expect("a plain path")];
    let all = [&rest[..], &["--threads", "2"], &states].concat();
    let mut server = stage.serve_scene(&scene(), &all);
    let client = stage.client();
    let often = ["--checkpoint-every", "0.25"];
    let record = [&["record", "-o", "run.mcap", "--json"][..], &often].concat();
    let mut recorder = Process::start(stage.cosplat(&record));
    wait_for_status(&client, |s: &Status| s.frame_readers >= 1);
    let orders = [
        (
            0.1,
            "action = \"set-pose\"\nobject = \"left\"\nposition = [-0.3, 0.9, 0.0]",
        ),
        (
            0.2,
            "action = \"bring-in\"\nobject = \"spare\"\nposition = [0.0, 0.5, 0.3]",
        ),
        (
            0.3,
            "action = \"set-fidelity\"\nobject = \"spare\"\nfidelity = \"rigid\"",
        ),
        (0.4, "action = \"remove\"\nobject = \"right\""),
        (0.5, "action = \"undo\""),
        (0.56, "action = \"undo\""),
        (0.6, "action = \"redo\""),
        (
            0.7,
            "action = \"set-fidelity\"\nobject = \"left\"\nfidelity = \"static\"",
        ),
        (0.8, "action = \"gravity\"\ngravity = [0.5, -5.0, 0.0]"),
        (0.9, "action = \"remove\"\nobject = \"left\""),
        (
            1.0,
            "action = \"bring-in\"\nobject = \"left\"\nposition = [-0.6, 0.6, 0.0]",
        ),
    ];
    let tables = orders.map(|(time, order)| format!("[[order]]\ntime = {time}\n{order}\n\n"));
    fs::write(stage.path("edits.toml"), tables.concat()).expect("written");
    let answer = stage.ctl(&["--json", "script", "edits.toml"]);
    let line = String::from_utf8_lossy(&answer.stdout).into_owned();
    let answer: serde_json::Value = serde_json::from_str(&line).expect("JSON");
    assert_eq!(answer["acknowledged"], orders.len(), "{answer}");
    assert!(stage.ctl(&["resume"]).status.success());
    assert_eq!(server.result()["steps"], 60);
    recorder.result();
    for threads in ["1", "3"] {
        let arguments = ["verify", "run.mcap", "--threads", threads, "--json"];
        let output = stage.cosplat(&arguments).output().expect("cosplat runs");
        let line = String::from_utf8_lossy(&output.stdout).into_owned();
        let outcome: serde_json::Value = serde_json::from_str(&line).expect("JSON");
        assert!(output.status.success(), "{threads} threads: {outcome}");
        let run = &outcome["runs"][0];
        assert_eq!(run["commands"], orders.len(), "{outcome}");
        assert_eq!(run["frames_compared"], 61, "{outcome}");
    }
    // What is undone at 0.5 s was done before the checkpoint of that time, which holds no states before edits: the run is taken
    // up farther back.
    let branch: Vec<_> = "branch run.mcap --at 29 --session other --pace free --duration 0.04"
        .split(' ')
        .collect();
    let output = stage.cosplat(&branch).output().expect("cosplat runs");
    assert!(output.status.success(), "{output:?}");
}
