//! Programs that hold the simulation's hand: every step waits for all of them, and none harms the others.

use std::time::Duration;

use cosplat_ipc::{
    Client, Domain,
    client::{Participant, SendError, StepError, Stepped, Until},
    schema::{
        COMMAND_FORCE, COMMAND_IMPULSE, COMMAND_RESET, COMMAND_RESTORE, COMMAND_SAVE, COMMAND_STEP,
        CONTACT_COLLIDER, Command, FRAME_FLAG_RESTORED, RETURN_COMPLETE, RETURN_CONTACT,
        RETURN_EVENT, RETURN_TERMINATE, RETURN_TIMEOUT, SERVER_PAUSED, SERVER_WAITING,
    },
};

use crate::stage::{PATIENCE, Process, Stage, command, next_frame, wait_for_status, watchdog};

const LOCKSTEP: &[&str] = &["--pace", "lockstep"];
/// Objects of the scene.
const BLOCKS: u32 = 2;

fn serve(stage: &Stage, arguments: &[&str]) -> Process {
    stage.serve(&[LOCKSTEP, arguments].concat())
}

fn join(stage: &Stage, name: &str) -> Participant {
    let client = stage.client();
    client.participate(name, PATIENCE).expect("taken in")
}

fn step(participant: &mut Participant, frames: u32, commands: &[Command]) -> Stepped {
    let stepped = participant.step(frames, commands).expect("an answer");
    assert_eq!(stepped.refusal(), None);
    stepped
}

/// Whether the server was gone before the request reached it.
fn has_ended(error: &StepError) -> bool {
    let StepError::Send(error) = error else {
        return false;
    };
    matches!(
        error,
        SendError::ServerEnded { .. } | SendError::NoServer { .. }
    )
}

/// An impulse on a block that no other sender and no other step gives.
fn push(client: u64, step: u64) -> Command {
    Command {
        kind: COMMAND_IMPULSE,
        object: (client % u64::from(BLOCKS)) as u32,
        vector: [
            0.01 * client as f64,
            0.003 * step as f64,
            -0.007 * client as f64,
        ],
        ..Command::default()
    }
}

/// What a child does that takes part: as many steps as it is told, then its part.
#[test]
fn a_child_takes_part() {
    let variable = |name: &str| std::env::var(format!("COSPLAT_TEST_{name}"));
    let (Ok(domain), Ok(name), Ok(part)) = (
        variable("DOMAIN"),
        variable("PARTICIPANT"),
        variable("PART"),
    ) else {
        let stage = Stage::new();
        let _server = serve(&stage, &[]);
        let mut child = stage.participant("arm", "push 3 3");
        assert!(child.wait().success(), "{}", child.words());
        return;
    };
    let domain = Domain::named(&domain).expect("the stage's domain");
    let client = Client::connect(&domain, "default", "child", PATIENCE).expect("a server");
    let mut participant = client.participate(&name, PATIENCE).expect("taken in");
    println!("> here");
    let mut words = part.split(' ');
    match (
        words.next(),
        words.next().and_then(|n| n.parse().ok()),
        words.next(),
    ) {
        (Some("push"), Some(number), Some(steps)) => {
            participant.set_client_id(number);
            for n in 1..=steps.parse().expect("a number") {
                step(&mut participant, 1, &[push(number, n)]);
            }
        }
        (Some("hang"), ..) => std::thread::sleep(PATIENCE * 10),
        other => panic!("no part {other:?}"),
    }
}

#[test]
fn the_server_freewheels_until_the_first_attaches() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(&stage, &[]);
    let client = stage.client();
    wait_for_status(&client, |s| s.step >= 3);
    let mut arm = join(&stage, "arm");
    let first = step(&mut arm, 1, &[]).done;
    let status = wait_for_status(&client, |s| s.server_state == SERVER_WAITING);
    assert_eq!(status.step, first.step);
    // It stands until it is asked, and then makes what is asked and no more.
    std::thread::sleep(Duration::from_millis(100));
    let second = step(&mut arm, 5, &[]).done;
    assert_eq!((second.step, second.frames), (first.step + 5, 5));
    assert_eq!(second.cause, RETURN_COMPLETE);
    let mut frames = client.frames(1).expect("frames are readable");
    let frame = *next_frame(&mut frames).header();
    assert_eq!(
        (frame.step, frame.state_hash),
        (second.step, second.state_hash)
    );
    // Who leaves is not waited for: nobody is left, and time goes on.
    drop(arm);
    wait_for_status(&client, |s| s.step > second.step + 2);
}

#[test]
fn a_flood_is_answered_while_the_server_freewheels() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = serve(&stage, &[]);
    let mut senders = [stage.sender(), stage.sender()];
    let sent = senders.each_mut().map(|sender| {
        let requests = (1..=16).map(|n| {
            let commands = [push(n, n); 32];
            sender.submit(&commands, PATIENCE).expect("a place")
        });
        requests.collect::<Vec<_>>()
    });
    for (sender, requests) in senders.iter().zip(sent) {
        for request in requests {
            let acks = sender.answers(request, PATIENCE).expect("answers");
            assert!(acks.iter().all(|ack| ack.is_accepted()));
        }
    }
    step(&mut join(&stage, "arm"), 1, &[]);
    assert!(stage.ctl(&["stop"]).status.success());
    server.result();
}

#[test]
fn three_participants_step_together() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(&stage, &["--participants", "arm,camera,planner"]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let stepping: Vec<_> = ["arm", "camera", "planner"]
        .map(|name| {
            let mut participant = join(&stage, name);
            std::thread::spawn(move || -> Vec<(u64, u64)> {
                let done = (0..15).map(|_| step(&mut participant, 1, &[]).done);
                let seen = done.map(|done| (done.step, done.state_hash)).collect();
                // Who leaves early would let the others go on alone.
                step(&mut participant, 1, &[]);
                seen
            })
        })
        .into_iter()
        .collect();
    let seen: Vec<_> = stepping
        .into_iter()
        .map(|t| t.join().expect("stepped"))
        .collect();
    assert_eq!(
        seen[0].iter().map(|s| s.0).collect::<Vec<_>>(),
        (1..=15).collect::<Vec<_>>()
    );
    assert_eq!(seen[0], seen[1]);
    assert_eq!(seen[0], seen[2]);
    // The frames of the steps are those that were answered.
    let mut frame = *next_frame(&mut frames).header();
    while frame.step == 0 {
        frame = *next_frame(&mut frames).header();
    }
    assert_eq!((frame.step, frame.state_hash), seen[0][0]);
}

#[test]
fn a_killed_participant_is_treated_by_the_policy() {
    let _watchdog = watchdog();
    for policy in ["wait", "drop", "stop"] {
        let stage = Stage::new();
        let mut server = serve(&stage, &["--on-timeout", policy]);
        let mut arm = join(&stage, "arm");
        let mut camera = stage.participant("camera", "hang");
        camera.wait_for_output("> here");
        camera.kill();
        match policy {
            "wait" => {
                let until = Until::default().timeout(Duration::from_millis(300));
                let late = arm.step_until(1, &[], until).expect("an answer").done;
                assert_eq!((late.cause, late.frames), (RETURN_TIMEOUT, 0));
                assert_eq!(late.reason(), Ok("waited for camera"));
                // It comes back under its name, and the step is made.
                let mut again = loop {
                    match stage.client().participate("camera", PATIENCE) {
                        Ok(again) => break again,
                        Err(StepError::Refused { .. }) => std::thread::yield_now(),
                        Err(error) => panic!("{error}"),
                    }
                };
                let waiting = std::thread::spawn(move || {
                    step(&mut again, 1, &[]);
                    again
                });
                assert_eq!(step(&mut arm, 1, &[]).done.frames, 1);
                waiting.join().expect("stepped");
            }
            "drop" => assert_eq!(step(&mut arm, 3, &[]).done.frames, 3),
            _ => {
                match arm.step(1_000, &[]) {
                    Ok(last) => {
                        assert_eq!(last.done.cause, RETURN_TERMINATE);
                        let said = last.done.reason().expect("text");
                        assert!(said.contains("camera"), "{said}");
                    }
                    Err(error) => assert!(has_ended(&error), "{error}"),
                }
                server.result();
            }
        }
    }
}

#[test]
fn a_participant_that_is_late_is_dropped_and_told_so() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(
        &stage,
        &["--participant-timeout", "3", "--on-timeout", "drop"],
    );
    let mut camera = join(&stage, "camera");
    let mut arm = join(&stage, "arm");
    assert_eq!(step(&mut arm, 2, &[]).done.frames, 2);
    let error = camera.step(1, &[]).expect_err("dropped");
    let said = error.to_string();
    assert!(
        said.contains("dropped") && said.contains("camera"),
        "{said}"
    );
}

#[test]
fn a_pause_holds_the_participants() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(&stage, &[]);
    let client = stage.client();
    let mut arm = join(&stage, "arm");
    let before = step(&mut arm, 1, &[]).done.step;
    assert!(stage.ctl(&["pause"]).status.success());
    wait_for_status(&client, |s| s.server_state == SERVER_PAUSED);
    let stepping = std::thread::spawn(move || {
        let done = step(&mut arm, 2, &[]).done;
        (arm, done)
    });
    // One step while paused needs the participant as well.
    let made = stage.ctl(&["step", "--timeout", "60"]);
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
    let said = String::from_utf8_lossy(&made.stdout).into_owned();
    assert!(
        said.contains(&format!("step {} is made", before + 1)),
        "{said}"
    );
    assert!(stage.ctl(&["resume"]).status.success());
    let (mut arm, done) = stepping.join().expect("stepped");
    assert_eq!(done.step, before + 2);
    // A reset is a command like any other, and an event.
    let reset = Command {
        kind: COMMAND_RESET,
        ..Command::default()
    };
    let until = Until::default().event();
    let back = arm.step_until(5, &[reset], until).expect("an answer").done;
    assert_eq!((back.cause, back.frames), (RETURN_EVENT, 1));
    assert!((back.sim_time - 0.02).abs() < 1e-12, "{}", back.sim_time);
    // And so is a stop.
    let stopped = stage.ctl(&["stop"]);
    assert!(
        stopped.status.success(),
        "{}",
        String::from_utf8_lossy(&stopped.stderr)
    );
    match arm.step(1, &[]) {
        Ok(stepped) => assert_eq!(stepped.done.cause, RETURN_TERMINATE),
        Err(error) => assert!(has_ended(&error), "{error}"),
    }
}

#[test]
fn steps_are_made_one_by_one_while_paused() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    assert_eq!(next_frame(&mut frames).header().step, 0);
    let made = stage.ctl(&["step", "3", "--json", "--timeout", "60"]);
    let answer: serde_json::Value = serde_json::from_slice(&made.stdout).expect("JSON");
    assert_eq!(answer["applied_at_step"][0], 3);
    // The answer comes when the last frame is out.
    let mut last = *next_frame(&mut frames).header();
    while let Some(frame) = frames.next(Duration::ZERO).expect("readable") {
        last = *frame.header();
    }
    assert_eq!(last.step, 3);
    assert_eq!(
        wait_for_status(&client, |s| s.server_state == SERVER_PAUSED).step,
        3
    );
    let refused = |arguments: &[&str]| {
        let output = stage.ctl(arguments);
        assert!(!output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(refused(&["step", "0"]).contains("expected 1 to 1000000"));
    assert!(refused(&["step", "--at-step", "9"]).contains("expected at most 4"));
    assert!(stage.ctl(&["resume"]).status.success());
    wait_for_status(&client, |s| s.step > 3);
    assert!(refused(&["step"]).contains("expected a paused one"));
}

#[test]
fn a_step_returns_when_the_named_pair_touches() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(&stage, &["--participants", "arm"]);
    let client = stage.client();
    let mut contacts = client.contacts(64).expect("contacts are readable");
    let mut arm = join(&stage, "arm");
    let until = Until::default().contact_with_collider(0, 0);
    let done = arm.step_until(500, &[], until).expect("an answer").done;
    assert_eq!(done.cause, RETURN_CONTACT, "{:?}", done.reason());
    assert_eq!(
        (done.contact, done.contact_kind),
        ([0, 0], CONTACT_COLLIDER)
    );
    assert_eq!(done.reason(), Ok("left touches floor"));
    // It falls 0.2 m to the floor, in 0.2 s; matter is felt within a cell.
    assert!((0.15..0.25).contains(&done.sim_time), "{}", done.sim_time);
    let (mut touching, mut last) = (0, 0);
    while let Some(message) = contacts.next(Duration::ZERO).expect("readable") {
        last = message.header().step;
        for contact in message.items() {
            touching += 1;
            assert_eq!(contact.kind, CONTACT_COLLIDER);
            assert!(
                contact.normal[1] > 0.99 && contact.impulse[1] > 0.0,
                "{contact:?}"
            );
            assert!(contact.point[1].abs() < 0.01, "{contact:?}");
        }
    }
    assert_eq!(last, done.step);
    // Both blocks fall from the same height.
    assert!((1..=2).contains(&touching), "{touching}");
    // A pair that never touches lets all steps be made.
    let until = Until::default().contact(0, 1);
    let done = arm.step_until(3, &[], until).expect("an answer").done;
    assert_eq!((done.cause, done.frames), (RETURN_COMPLETE, 3));
}

#[test]
fn a_planner_rolls_back_and_tries_again() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(&stage, &["--participants", "planner"]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let mut planner = join(&stage, "planner");
    step(&mut planner, 8, &[]);
    let numbered = |kind, object| Command {
        kind,
        object,
        ..Command::default()
    };
    let force = |size: f64| Command {
        kind: COMMAND_FORCE,
        vector: [size, 0.0, 0.0],
        point: [0.0, 0.02, 0.0],
        ..Command::default()
    };
    let mut attempt = |first: Command, size: f64| -> Vec<u64> {
        let mut hashes = vec![step(&mut planner, 1, &[first, force(size)]).done.state_hash];
        for _ in 0..6 {
            hashes.push(step(&mut planner, 1, &[force(size)]).done.state_hash);
        }
        hashes
    };
    let one = attempt(numbered(COMMAND_SAVE, 4), 20.0);
    let other = attempt(numbered(COMMAND_RESTORE, 4), 30.0);
    let again = attempt(numbered(COMMAND_RESTORE, 4), 20.0);
    assert_eq!(one, again);
    assert_ne!(one[0], other[0]);
    // Steps count on, and the frames of a return say so.
    let mut restored = vec![];
    while let Some(frame) = frames.next(Duration::ZERO).expect("readable") {
        if frame.header().flags & FRAME_FLAG_RESTORED != 0 {
            restored.push(frame.header().step);
        }
    }
    assert_eq!(restored, [8 + 7 + 1, 8 + 14 + 1]);
    let missing = planner
        .step(1, &[numbered(COMMAND_RESTORE, 5)])
        .expect("an answer");
    let (index, reason) = missing.refusal().expect("no snapshot 5");
    assert!(
        index == 0 && reason.contains("snapshot 5") && reason.contains("4"),
        "{reason}"
    );
    assert_eq!(
        missing.done.frames, 1,
        "a refused command keeps no step from being made"
    );
    let late = planner
        .step(1, &[numbered(COMMAND_STEP, 1)])
        .expect("an answer");
    assert!(
        late.refusal()
            .expect("refused")
            .1
            .contains("service command")
    );
}

#[test]
fn a_renderer_takes_part_and_draws_every_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = serve(&stage, &["--participants", "arm,camera"]);
    let pictures = stage.path("pictures");
    let folder = pictures.to_str().expect("a plain path");
    let size = ["--size", "64x48", "--json"];
    let camera = [
        "view",
        "--participant",
        "camera",
        "--png",
        folder,
        "--frames",
        "6",
    ];
    let mut camera = Process::start(stage.cosplat(&[&camera[..], &size].concat()));
    let mut arm = join(&stage, "arm");
    // When a step is answered, the picture of the one before is drawn.
    for n in 1..=5 {
        assert_eq!(step(&mut arm, 1, &[]).done.step, n);
        let picture = pictures.join(format!("frame_{:08}.png", n - 1));
        assert!(picture.exists(), "{}", picture.display());
    }
    let summary = camera.result();
    assert_eq!(summary["frames_rendered"], 6);
    assert_eq!(
        (&summary["frames_missed"], &summary["last_step"]),
        (&0.into(), &5.into())
    );
    assert_eq!(summary["pictures"], 6);
    // It has left, and the arm goes on alone.
    assert_eq!(step(&mut arm, 3, &[]).done.step, 8);
}

/// Hashes of a run's frames by step, from 1 to `last`.
fn hashes(stage: &Stage, last: u64, run: impl FnOnce(&Client)) -> Vec<u64> {
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    wait_for_status(&client, |s| s.frame_readers >= 1);
    run(&client);
    let mut found = vec![];
    while found.len() < last as usize {
        let frame = next_frame(&mut frames);
        assert_eq!(frame.missed(), 0);
        if frame.header().step > 0 {
            found.push(frame.header().state_hash);
        }
    }
    found
}

#[test]
fn one_process_or_five_lead_to_the_same_hashes() {
    let _watchdog = watchdog();
    const LAST: u64 = 12;
    let at = |client: u64, step: u64| Command {
        apply_at_step: step,
        ..push(client, step)
    };
    let ordered = |commands: &mut dyn FnMut(u64) -> Vec<(u64, Vec<Command>)>, threads: &str| {
        let stage = Stage::new();
        let _server = stage.serve(&[
            "--paused",
            "--pace",
            "free",
            "--lossless",
            "--threads",
            threads,
        ]);
        hashes(&stage, LAST, |client| {
            for (number, commands) in commands(LAST) {
                let mut sender = client.commands_as(number).expect("a sender");
                for chunk in commands.chunks(20) {
                    let acks = sender.send(chunk, PATIENCE).expect("answers");
                    assert!(acks.iter().all(|ack| ack.is_accepted()));
                }
            }
            assert!(stage.ctl(&["resume"]).status.success());
        })
    };
    let one = ordered(
        &mut |last| {
            let all = (1..=last).flat_map(|step| (1..=5).map(move |client| at(client, step)));
            vec![(1, all.collect())]
        },
        "2",
    );
    let five = ordered(
        &mut |last| {
            // The last comes first: the order of arrival does not matter.
            let of = |client| (client, (1..=last).map(|step| at(client, step)).collect());
            (1..=5).rev().map(of).collect()
        },
        "1",
    );
    assert_eq!(one, five);
    let stage = Stage::new();
    let names = "p5,p4,p3,p2,p1";
    let _server = serve(&stage, &["--participants", names, "--lossless"]);
    let mut children = vec![];
    let locked = hashes(&stage, LAST, |_| {
        let part = |n: u64| stage.participant(&format!("p{n}"), &format!("push {n} {LAST}"));
        children = (1..=5).map(part).collect();
    });
    assert_eq!(one, locked);
    for child in &mut children {
        assert!(child.wait().success(), "{}", child.words());
    }
}

#[test]
fn the_example_of_a_closed_loop_holds_its_object() {
    let _watchdog = watchdog();
    let exe = std::env::current_exe().expect("this binary");
    let profile = exe.ancestors().nth(2).expect("the profile's folder");
    let mut build = command(env!("CARGO"));
    build.args(["build", "--quiet", "--package", "cosplat-ipc"]);
    build.args(["--example", "closed_loop"]);
    if profile.ends_with("release") {
        build.arg("--release");
    }
    assert!(build.status().expect("cargo").success());
    let stage = Stage::new();
    let _server = serve(&stage, &["--participants", "robot"]);
    let mut example = command(profile.join("examples/closed_loop"));
    example.env("COSPLAT_DOMAIN", stage.domain.root());
    let mut example = Process::start(example);
    assert!(example.wait().success(), "{}", example.words());
    let output = example.output();
    let heights = output
        .lines()
        .map(|line| line.rsplit(' ').nth(1).expect("a height"));
    let heights: Vec<f64> = heights.map(|h| h.parse().expect("a number")).collect();
    assert!(heights.len() >= 90, "{output}");
    // Free fall would take it to the floor, 0.2 m below, in 0.2 s. The loop catches it within a step of falling.
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(lowest > heights[0] - 0.02, "{heights:?}");
}

#[test]
fn other_paces_take_no_participants_and_say_so() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&[]);
    let refused = stage.client().participate("arm", PATIENCE).err();
    let said = refused.expect("refused").to_string();
    assert!(said.contains("--pace lockstep"), "{said}");
    let output = stage
        .cosplat(&["serve", "scene.toml", "--participants", "arm"])
        .output()
        .expect("cosplat can be run");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains("--pace lockstep alone"), "{words}");
}
