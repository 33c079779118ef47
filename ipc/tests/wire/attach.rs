//! Attaching to a server: early, late, deep, shallow.

use std::time::Duration;

use cosplat_ipc::{
    Client, ServerPorts,
    client::{ConnectError, ReadError, SceneReader},
    schema::{ObjectState, ObjectsHeader, Status},
    server::PoolPlan,
};

use super::support::{COUNT, PATIENCE, SOURCE, TestDomain, TestScene, send_frame, serve};

/// Though the server is idle.
#[test]
fn a_late_joiner_gets_the_scene_and_the_newest_frame() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "late");
    for step in 1..=5 {
        send_frame(&ports, step);
    }
    // From here on the server's thread does nothing at all.
    let client = Client::connect(&domain, "late", "test", PATIENCE).expect("attached");
    let scene = client.scene(PATIENCE).expect("a scene");
    assert_eq!(scene.gaussians().len(), COUNT);
    assert_eq!(scene.sh()[7], 7.0);
    assert_eq!(scene.features()[3], -3.0);
    assert_eq!(scene.objects()[0].name(), Ok("vase"));
    assert_eq!(scene.source(), SOURCE);
    assert_eq!(scene.files()[0].name(), Ok("vase.ply"));
    assert_eq!((scene.files()[0].length, scene.files()[0].hash), (5, 9));
    assert_eq!(scene.header().scene_hash, 7);
    assert_eq!(scene.header().epoch, ports.epoch());

    let mut reader = client.frames(1).expect("a reader");
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!(frame.header().step, 5);
    assert_eq!(frame.header().epoch, ports.epoch());
    assert_eq!(frame.gaussians().len(), COUNT);
    assert_eq!(frame.gaussians()[9].position, [5.0, 9.0, 5.0]);
    assert_eq!(frame.gaussians().as_ptr() as usize % 64, 0);
}

#[test]
fn a_deep_reader_sees_every_step_and_a_shallow_one_the_newest() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "depth");
    let client = Client::connect(&domain, "depth", "test", PATIENCE).expect("attached");
    let mut deep = client.frames(64).expect("a reader");
    let mut newest = client.frames(1).expect("a reader");
    let mut expected = 1;
    for step in 1..=640 {
        send_frame(&ports, step);
        if step % 64 == 0 {
            while let Some(frame) = deep.next(Duration::ZERO).expect("readable") {
                assert_eq!(frame.header().step, expected);
                assert_eq!(frame.missed(), 0);
                assert_eq!(frame.gaussians()[0].position[0], expected as f32);
                expected += 1;
            }
            assert_eq!(expected, step + 1);
            let frame = newest.next(PATIENCE).expect("readable").expect("a frame");
            assert_eq!(frame.header().step, step);
            assert_eq!(frame.missed(), if step == 64 { 0 } else { 63 });
            assert!(newest.next(Duration::ZERO).expect("readable").is_none());
        }
    }
    assert_eq!(deep.missed(), 0);
    assert_eq!(newest.missed(), 9 * 63);
    assert_eq!(deep.runs(), 1);
}

#[test]
fn an_overrun_queue_keeps_the_newest_and_counts_what_it_lost() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "overrun");
    let client = Client::connect(&domain, "overrun", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(8).expect("a reader");
    send_frame(&ports, 1);
    assert!(reader.next(PATIENCE).expect("readable").is_some());
    for step in 2..=101 {
        send_frame(&ports, step);
    }
    let steps: Vec<u64> = std::iter::from_fn(|| reader.next(Duration::ZERO).expect("readable"))
        .map(|frame| frame.header().step)
        .collect();
    assert_eq!(steps, (94..=101).collect::<Vec<u64>>());
    assert_eq!(reader.missed(), 92);
}

#[test]
fn a_reader_that_holds_too_many_frames_is_told_and_can_go_on() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "greedy");
    let client = Client::connect(&domain, "greedy", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(64).expect("a reader");
    for step in 1..=20 {
        send_frame(&ports, step);
    }
    let mut held = Vec::new();
    let error = loop {
        match reader.next(PATIENCE) {
            Ok(frame) => held.push(frame.expect("a frame")),
            Err(error) => break error,
        }
    };
    let stream = "frame";
    assert_eq!(error, ReadError::TooManyHeld { stream, max: 8 });
    assert_eq!(held.len(), 8);
    drop(held.remove(0));
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!((frame.header().step, frame.missed()), (9, 0));
    // What is held does not change under the reader's eyes.
    for step in 21..=400 {
        send_frame(&ports, step);
    }
    assert_eq!(held[0].gaussians()[3].position, [2.0, 3.0, 2.0]);
}

#[test]
fn a_frame_stays_as_it_is_when_its_reader_goes() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "left");
    let client = Client::connect(&domain, "left", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(1).expect("a reader");
    send_frame(&ports, 1);
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    drop((reader, client));
    // Many times as many as the pool has.
    for step in 2..=400 {
        send_frame(&ports, step);
    }
    assert_eq!(frame.gaussians()[3].position, [1.0, 3.0, 1.0]);
}

#[test]
fn a_client_may_come_before_its_server() {
    let domain = TestDomain::new();
    let early = std::thread::spawn({
        let domain = domain.clone();
        move || Client::connect(&domain, "soon", "test", PATIENCE).map(|client| client.hello().pid)
    });
    std::thread::sleep(Duration::from_millis(50));
    let _ports = serve(&domain, "soon");
    let pid = early.join().expect("thread").expect("attached");
    assert_eq!(pid, std::process::id());
}

#[test]
fn two_sessions_do_not_mix() {
    let domain = TestDomain::new();
    let a = serve(&domain, "a");
    let b = serve(&domain, "b");
    send_frame(&a, 11);
    send_frame(&b, 22);
    for (name, step) in [("a", 11), ("b", 22)] {
        let client = Client::connect(&domain, name, "test", PATIENCE).expect("attached");
        let mut reader = client.frames(1).expect("a reader");
        let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
        assert_eq!(frame.header().step, step);
    }
}

#[test]
fn objects_and_status_arrive_as_sent() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "objects");
    let client = Client::connect(&domain, "objects", "test", PATIENCE).expect("attached");
    let mut objects = client.objects(4).expect("a reader");
    let mut status = client.status().expect("a reader");
    assert_eq!(status.newest().expect("readable"), None);
    assert!(!status.is_server_alive().expect("readable"));
    let state = ObjectState {
        id: 0,
        mass: 2.5,
        ..ObjectState::default()
    };
    let header = ObjectsHeader {
        step: 4,
        ..ObjectsHeader::default()
    };
    ports.publish_objects(&header, &[state]).expect("published");
    let message = objects.next(PATIENCE).expect("readable").expect("objects");
    assert_eq!(message.items(), [state]);
    assert_eq!(
        (message.header().step, message.header().epoch),
        (4, ports.epoch())
    );
    let error = ports
        .publish_objects(&header, &[state; 2])
        .expect_err("too many");
    assert_eq!(
        error.to_string(),
        "2 elements on \"objects\", expected at most 1"
    );

    let sent = Status {
        step: 4,
        kinetic_energy: 1.5,
        ..Status::default()
    };
    ports.update_status(&sent).expect("published");
    let first = status.next(PATIENCE).expect("readable").expect("a status");
    assert_eq!((first.step, first.kinetic_energy), (4, 1.5));
    assert_eq!(
        (first.pid, first.epoch),
        (std::process::id(), ports.epoch())
    );
    // A paused server's heart goes on.
    let beat = loop {
        ports.maintain();
        ports.wait(Duration::from_millis(20));
        if let Some(beat) = status.next(Duration::ZERO).expect("readable") {
            break beat;
        }
    };
    assert!(beat.heartbeat_ns > first.heartbeat_ns);
    assert_eq!(beat.step, 4);
    assert!(status.is_server_alive().expect("readable"));
}

#[test]
fn the_heart_beats_while_the_server_does_something_else() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "busy");
    let client = Client::connect(&domain, "busy", "test", PATIENCE).expect("attached");
    let mut reader = client.status().expect("a status reader");
    let sent = Status {
        step: 7,
        ..Status::default()
    };
    ports.update_status(&sent).expect("published");
    // From here on the server's own thread calls nothing, as in a long step.
    let mut newest = reader.next(PATIENCE).expect("readable").expect("a status");
    for _ in 0..5 {
        let beat = reader.next(PATIENCE).expect("readable").expect("a beat");
        assert_eq!((beat.step, beat.epoch), (7, ports.epoch()));
        assert!(beat.heartbeat_ns > newest.heartbeat_ns);
        newest = beat;
    }
}

#[test]
fn a_scene_is_found_in_tries_that_are_each_too_short() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "bits");
    let client = Client::connect(&domain, "bits", "test", PATIENCE).expect("attached");
    let mut scenes = SceneReader::default();
    // The server's monitor answers a new subscriber within 20 ms: a try without patience never waits for that, and if every
    // try began anew none would ever succeed.
    let mut tries = 0;
    let scene = loop {
        tries += 1;
        match scenes.of(&client, ports.epoch(), Duration::ZERO) {
            Err(ConnectError::Timeout { seconds, .. }) if seconds < PATIENCE.as_secs_f64() => {
                std::thread::sleep(Duration::from_millis(1));
            }
            settled => break settled.expect("readable").expect("of this run"),
        }
    };
    assert!(tries > 1, "no try was too short");
    assert_eq!(scene.gaussians().len(), COUNT);
    assert_eq!(scene.features()[3], -3.0);
    assert_eq!(scene.source(), SOURCE);
}

#[test]
fn a_missing_scene_is_named_and_a_newer_one_ends_the_wait() {
    let domain = TestDomain::new();
    let scene = TestScene::new();
    let plan = PoolPlan::new(&scene.blocks());
    let mut first = ServerPorts::create(&domain, "anew", &plan).expect("a server");
    let client = Client::connect(&domain, "anew", "test", PATIENCE).expect("attached");
    let mut scenes = SceneReader::default();
    let short = Duration::from_millis(20);
    let error = scenes.of(&client, first.epoch(), short).expect_err("none");
    assert!(error.may_pass());
    let words = error.to_string();
    assert!(words.contains("but its scene did not come"), "{words}");
    first.publish_scene(&scene.blocks()).expect("a scene");
    let old = first.epoch();
    // The one that is there is not that of the next run.
    let error = scenes.of(&client, old + 1, PATIENCE / 20).expect_err("old");
    let words = error.to_string();
    assert!(words.contains("the scene of its newest run"), "{words}");
    drop(first);
    let second = serve(&domain, "anew");
    assert!(second.epoch() > old);
    let newer = scenes
        .of(&client, second.epoch(), PATIENCE)
        .expect("readable");
    assert_eq!(newer.expect("the newer").header().epoch, second.epoch());
    let leftover = scenes.of(&client, old, PATIENCE).expect("readable");
    assert!(leftover.is_none(), "frames of the old run have no scene");
}
