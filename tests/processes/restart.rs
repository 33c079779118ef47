//! The server dies and comes back under the same name; clients carry on by themselves.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use cosplat_ipc::schema::FRAME_FLAG_LAST;

use crate::stage::{
    PATIENCE, Process, SMALL_SCENE, Stage, has_bytes, next_frame, wait_for_readers, watchdog,
};

/// What the renderer has drawn; not what it is writing just now, which has another name.
fn pictures(stage: &Stage) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(stage.path("pictures"));
    let paths = entries.into_iter().flatten().flatten().map(|e| e.path());
    paths
        .filter(|path| path.extension().is_some_and(|e| e == "png"))
        .collect()
}

/// Whether a picture is of step 0.
fn is_first(picture: &Path) -> bool {
    let name = picture.file_stem().unwrap_or_default().to_string_lossy();
    let step = name.trim_start_matches(|c: char| !c.is_ascii_digit());
    step.parse() == Ok(0)
}

/// Waits until the renderer has drawn the first frame of a run: on a busy machine that may take longer than the run.
/// A later one may be of the run before, which it was still drawing.
fn wait_for_picture(stage: &Stage, renderer: &mut Process) {
    while !pictures(stage).iter().any(|path| is_first(path)) {
        assert!(renderer.is_running(), "{}", renderer.words());
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn clients_carry_on_after_the_server_was_killed_and_restarted() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut first = stage.serve(&["--paused"]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--json"]));
    let mut renderer = Process::start(stage.cosplat(&[
        "view", "--mp4", "run.mp4", "--png", "pictures", "--size", "160x120", "--json",
    ]));
    wait_for_readers(&client, 3, &mut [&mut recorder, &mut renderer]);
    wait_for_picture(&stage, &mut renderer);
    // The recorder makes its file when it has the scene.
    while !stage.path("run.mcap").exists() {
        assert!(recorder.is_running(), "{}", recorder.words());
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(stage.ctl(&["resume"]).status.success());
    while next_frame(&mut frames).header().step < 10 {}
    first.kill();
    for picture in pictures(&stage) {
        std::fs::remove_file(picture).expect("removed");
    }

    let mut second = stage.serve_scene(
        &SMALL_SCENE.replace("two blocks", "two blocks again"),
        &["--paused", "--duration", "0.5"],
    );
    let observer = stage.client();
    wait_for_readers(&observer, 3, &mut [&mut recorder, &mut renderer]);
    while !next_frame(&mut frames).is_new_run() {}
    let scene = client.scene(PATIENCE).expect("the new scene is readable");
    assert!(scene.source().contains("two blocks again"));
    wait_for_picture(&stage, &mut renderer);
    assert!(stage.ctl(&["resume"]).status.success());
    while next_frame(&mut frames).header().flags & FRAME_FLAG_LAST == 0 {}
    assert_eq!(frames.runs(), 2);

    second.result();
    let recorded = recorder.result();
    let viewed = renderer.result();
    assert!(
        recorded["frames_recorded"].as_u64() >= Some(11 + 26),
        "{recorded}"
    );
    assert!(viewed["frames_rendered"].as_u64() >= Some(2), "{viewed}");
    assert!(has_bytes(&stage.path("run.mcap")) && has_bytes(&stage.path("run.mp4")));
}
