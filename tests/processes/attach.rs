//! Clients come when they like and take the time they need.

use std::time::Duration;

use crate::stage::{PATIENCE, Stage, next_frame, wait_for_status, watchdog};
use cosplat_ipc::schema::SERVER_PAUSED;

#[test]
fn late_joiner_on_a_paused_server_gets_scene_and_newest_frame() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "free"]);
    let early = stage.client();
    wait_for_status(&early, |s| s.step >= 5);
    assert!(stage.ctl(&["pause"]).status.success());
    let paused = wait_for_status(&early, |s| s.server_state == SERVER_PAUSED);

    let late = stage.client();
    let scene = late
        .scene(PATIENCE)
        .expect("the scene is kept for late joiners");
    assert_eq!(scene.objects().len(), 2);
    assert_eq!(
        scene.gaussians().len(),
        scene.header().gaussian_count as usize
    );
    assert!(scene.source().contains("two blocks"));
    let mut frames = late.frames(1).expect("frames are readable");
    let frame = next_frame(&mut frames);
    assert_eq!(frame.header().step, paused.step);
    assert_eq!(frame.header().state_hash, paused.state_hash);
    assert_eq!(frame.gaussians().len(), scene.gaussians().len());
}

#[test]
fn a_renderer_that_sleeps_never_slows_the_server() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "8", "--paused"]);
    let client = stage.client();
    let mut frames = client.frames(1).expect("frames are readable");
    assert!(stage.ctl(&["resume"]).status.success());
    // Two seconds per frame: a server that waited for this reader would need 800 s for its 400 steps, far
    // beyond the patience of `result`.
    let mut seen = 0;
    while server.is_running() {
        let frame = frames
            .next(Duration::from_millis(100))
            .expect("frames are well-formed");
        if frame.is_some() {
            seen += 1;
            std::thread::sleep(Duration::from_secs(2));
        }
    }
    let result = server.result();
    assert_eq!(result["steps"], 400);
    assert_eq!(result["frames_published"], 401);
    assert_eq!(result["frames_skipped"], 0);
    assert!(seen < 100, "{seen} frames at 2 s each");
}

#[test]
fn the_smallest_objects_reader_follows_every_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "1", "--paused"]);
    let client = stage.client();
    let mut objects = client.objects(64).expect("objects are readable");
    let mut steps = Vec::new();
    assert!(stage.ctl(&["resume"]).status.success());
    while steps.last() != Some(&50) {
        let message = objects
            .next(PATIENCE)
            .expect("objects are well-formed")
            .expect("a message comes in time");
        assert_eq!(message.items().len(), 2);
        steps.push(message.header().step);
    }
    assert_eq!(steps, (0..=50).collect::<Vec<_>>());
    server.result();
}
