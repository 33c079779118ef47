//! Orders from outside: obeyed when good, refused with a reason and without a trace when bad.

use std::sync::atomic::{AtomicBool, Ordering};

use cosplat_ipc::schema::{self as wire, ACK_ACCEPTED, ACK_REFUSED, str_from_padded};

use crate::stage::{PATIENCE, Stage, next_frame, wait_for_status, watchdog};

/// Every way a command can be wrong, by name.
fn malformed() -> Vec<(&'static str, wire::Command)> {
    let push = wire::Command {
        kind: wire::COMMAND_IMPULSE,
        vector: [1.0, 0.0, 0.0],
        ..Default::default()
    };
    let at = wire::Command {
        kind: wire::COMMAND_IMPULSE_AT,
        point: [-0.3, 0.3, 0.0],
        radius: 0.1,
        ..push
    };
    let material = wire::MaterialSpec {
        law: 1,
        youngs_modulus: 1e5,
        poisson_ratio: 0.3,
        ..Default::default()
    };
    let set_material = wire::Command {
        kind: wire::COMMAND_SET_MATERIAL,
        material,
        ..Default::default()
    };
    let velocity = wire::Command {
        kind: wire::COMMAND_SET_VELOCITY,
        ..Default::default()
    };
    let gravity = wire::Command {
        kind: wire::COMMAND_SET_GRAVITY,
        ..Default::default()
    };
    let collider = wire::Command {
        kind: wire::COMMAND_MOVE_COLLIDER,
        ..Default::default()
    };
    let pin = wire::Command {
        kind: wire::COMMAND_PIN,
        radius: 0.1,
        ..Default::default()
    };
    vec![
        (
            "unknown collider",
            wire::Command {
                object: 1,
                ..collider
            },
        ),
        (
            "NaN pose",
            wire::Command {
                vector: [f64::NAN; 3],
                ..collider
            },
        ),
        (
            "infinite turn",
            wire::Command {
                point: [f64::INFINITY, 0.0, 0.0],
                ..collider
            },
        ),
        (
            "collider too fast",
            wire::Command {
                vector: [9e5, 0.0, 0.0],
                ..collider
            },
        ),
        ("pin of nothing", wire::Command { object: 2, ..pin }),
        (
            "NaN pin radius",
            wire::Command {
                radius: f64::NAN,
                ..pin
            },
        ),
        (
            "NaN pin point",
            wire::Command {
                point: [f64::NAN; 3],
                ..pin
            },
        ),
        (
            "release of nothing",
            wire::Command {
                kind: wire::COMMAND_RELEASE,
                object: 7,
                ..Default::default()
            },
        ),
        ("kind 0", wire::Command { kind: 0, ..push }),
        ("kind 4711", wire::Command { kind: 4711, ..push }),
        ("unknown object", wire::Command { object: 2, ..push }),
        (
            "object u32::MAX",
            wire::Command {
                object: u32::MAX,
                ..push
            },
        ),
        (
            "NaN impulse",
            wire::Command {
                vector: [f64::NAN, 0.0, 0.0],
                ..push
            },
        ),
        (
            "infinite impulse",
            wire::Command {
                vector: [0.0, f64::INFINITY, 0.0],
                ..push
            },
        ),
        (
            "absurd impulse",
            wire::Command {
                vector: [0.0, 1e300, 0.0],
                ..push
            },
        ),
        (
            "NaN point",
            wire::Command {
                point: [0.0, f64::NAN, 0.0],
                ..at
            },
        ),
        (
            "NaN radius",
            wire::Command {
                radius: f64::NAN,
                ..at
            },
        ),
        ("zero radius", wire::Command { radius: 0.0, ..at }),
        ("negative radius", wire::Command { radius: -1.0, ..at }),
        (
            "NaN velocity",
            wire::Command {
                vector: [f64::NAN; 3],
                ..velocity
            },
        ),
        (
            "absurd velocity",
            wire::Command {
                vector: [1e30, 0.0, 0.0],
                ..velocity
            },
        ),
        (
            "infinite spin",
            wire::Command {
                point: [f64::NEG_INFINITY; 3],
                ..velocity
            },
        ),
        (
            "unknown law",
            wire::Command {
                material: wire::MaterialSpec {
                    law: 99,
                    ..material
                },
                ..set_material
            },
        ),
        (
            "NaN stiffness",
            wire::Command {
                material: wire::MaterialSpec {
                    youngs_modulus: f64::NAN,
                    ..material
                },
                ..set_material
            },
        ),
        (
            "zero stiffness",
            wire::Command {
                material: wire::MaterialSpec {
                    youngs_modulus: 0.0,
                    ..material
                },
                ..set_material
            },
        ),
        (
            "absurd stiffness",
            wire::Command {
                material: wire::MaterialSpec {
                    youngs_modulus: 1e30,
                    ..material
                },
                ..set_material
            },
        ),
        (
            "nu of one half",
            wire::Command {
                material: wire::MaterialSpec {
                    poisson_ratio: 0.5,
                    ..material
                },
                ..set_material
            },
        ),
        (
            "unknown region",
            wire::Command {
                material: wire::MaterialSpec {
                    region: 5,
                    ..material
                },
                ..set_material
            },
        ),
        (
            "metal without strength for a number",
            wire::Command {
                material: wire::MaterialSpec {
                    law: 3,
                    parameters: [f64::NAN, 0.0, 0.0, 0.0],
                    ..material
                },
                ..set_material
            },
        ),
        (
            "sand steeper than a wall",
            wire::Command {
                material: wire::MaterialSpec {
                    law: 4,
                    parameters: [90.0, 0.0, 0.0, 0.0],
                    ..material
                },
                ..set_material
            },
        ),
        (
            "fluid of absurd viscosity",
            wire::Command {
                material: wire::MaterialSpec {
                    law: 8,
                    parameters: [1e5, 1e8, 0.0, 0.0],
                    ..material
                },
                ..set_material
            },
        ),
        (
            "NaN gravity",
            wire::Command {
                vector: [0.0, f64::NAN, 0.0],
                ..gravity
            },
        ),
        (
            "absurd gravity",
            wire::Command {
                vector: [0.0, -1e20, 0.0],
                ..gravity
            },
        ),
        (
            "step out of reach",
            wire::Command {
                apply_at_step: u64::MAX,
                ..push
            },
        ),
    ]
}

/// State hash after a fixed run with `commands` sent before the first step.
fn hash_with(commands: &[(&str, wire::Command)], expected_status: u32) -> String {
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "0.4", "--paused"]);
    let mut sender = stage.sender();
    for (name, command) in commands {
        let acks = sender.send(&[*command], PATIENCE).expect("an answer");
        let reason = str_from_padded(&acks[0].reason).expect("a reason is text");
        assert_eq!(acks[0].status, expected_status, "{name}: {reason}");
        if expected_status == ACK_REFUSED {
            assert!(reason.len() > 10, "{name}: {reason:?}");
        }
    }
    assert!(stage.ctl(&["resume"]).status.success());
    let result = server.result();
    assert_eq!(result["steps"], 20);
    result["state_hash"].as_str().expect("a hash").to_owned()
}

/// With a reason.
#[test]
fn malformed_commands_are_refused_and_change_nothing() {
    let _watchdog = watchdog();
    let untouched = hash_with(&[], ACK_REFUSED);
    assert_eq!(hash_with(&malformed(), ACK_REFUSED), untouched);
    // The hash is no constant: a good command does change it.
    let push = wire::Command {
        kind: wire::COMMAND_IMPULSE,
        vector: [0.1, 0.0, 0.0],
        ..Default::default()
    };
    assert_ne!(hash_with(&[("push", push)], ACK_ACCEPTED), untouched);
}

#[test]
fn a_push_takes_effect_at_the_step_its_answer_names() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "0.4", "--paused"]);
    let client = stage.client();
    let mut objects = client.objects(64).expect("objects are readable");
    let mut journal = client.journal().expect("the journal is readable");
    let output = stage.ctl(&["--at-step", "7", "--json", "push", "left", "5", "0", "0"]);
    assert!(output.status.success());
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(answer["applied_at_step"][0], 7);
    assert!(stage.ctl(&["resume"]).status.success());
    let mut speeds = Vec::new();
    while speeds.len() < 10 {
        let message = objects
            .next(PATIENCE)
            .expect("objects are well-formed")
            .expect("a message comes in time");
        speeds.push(message.items()[0].linear_velocity[0]);
    }
    // Index is the step: before 7 the block only falls, in step 7 it takes 5 N s over its mass.
    let mass = 0.2_f64.powi(3) * 1070.0;
    assert!(speeds[..7].iter().all(|v| v.abs() < 1e-4), "{speeds:?}");
    assert!((speeds[7] * mass / 5.0 - 1.0).abs() < 0.2, "{speeds:?}");
    let entry = journal
        .next(PATIENCE)
        .expect("the journal is well-formed")
        .expect("the command is in it");
    assert_eq!(entry.items()[0].step, 7);
    server.result();
}

#[test]
fn a_block_is_pinned_and_let_go_and_the_floor_is_lifted_by_name() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "0.4", "--paused"]);
    let client = stage.client();
    let mut objects = client.objects(64).expect("objects are readable");
    for order in [
        &["--at-step", "1", "pin", "left"][..],
        &["--at-step", "11", "release", "left"],
        // By 0.15 m within one frame, right under the falling block.
        &["--at-step", "3", "move-collider", "floor", "0", "0.15", "0"],
    ] {
        let output = stage.ctl(order);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{order:?}: {words}");
    }
    let output = stage.ctl(&["move-collider", "ceiling", "0", "0", "0"]);
    assert!(!output.status.success());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        words.contains("ceiling") && words.contains("floor"),
        "{words}"
    );
    assert!(stage.ctl(&["resume"]).status.success());
    let mut states = Vec::new();
    while states.len() < 20 {
        let message = objects
            .next(PATIENCE)
            .expect("objects are well-formed")
            .expect("a message comes in time");
        states.push([message.items()[0], message.items()[1]]);
    }
    let height = |step: usize, object: usize| states[step][object].com[1];
    assert_eq!(height(10, 0), height(1, 0), "held");
    assert!(height(15, 0) < height(10, 0), "let go");
    // The other one stands on the lifted floor: nothing of it is far below 0.15 m.
    assert!(height(19, 1) > 0.2, "{}", height(19, 1));
    server.result();
}

#[test]
fn any_material_is_set_in_words_and_journalled_in_numbers() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "0.4", "--paused"]);
    let client = stage.client();
    let mut journal = client.journal().expect("the journal is readable");
    let set = |words: &[&str]| stage.ctl(&[&["set-material"], words].concat());
    let sand = [
        "left",
        "--law",
        "drucker_prager",
        "--set",
        "youngs_modulus_pa=2e5",
        "--set",
        "poisson_ratio=0.3",
        "--set",
        "friction_angle_deg=30",
        "--set",
        "cohesion=0",
    ];
    assert!(set(&sand).status.success());
    let water = ["right", "water", "--set", "bulk_modulus_pa=1e5"];
    assert!(set(&water).status.success());
    let patch = ["--point", "-0.3", "0.3", "0", "--half", "9", "9", "0.02"];
    let painted = [&["left", "jelly"], &patch[..]].concat();
    assert!(set(&painted).status.success());
    let refused: [(&[&str], &str); 5] = [
        (&["left", "jelly", "--half", "1", "1", "1"], "--point"),
        (&["left", "steal"], "did you mean `steel`?"),
        (&["left", "water", "--set", "cohesion=3"], "`cohesion`"),
        (&["left", "--law", "snow"], "youngs_modulus_pa"),
        (&["left", "jelly", "--region", "3"], "region"),
    ];
    for (words, said) in refused {
        let output = set(words);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && text.contains(said),
            "{words:?}: {text}"
        );
    }
    assert!(stage.ctl(&["resume"]).status.success());
    let mut found = Vec::new();
    while found.len() < 3 {
        let message = journal
            .next(PATIENCE)
            .expect("the journal is well-formed")
            .expect("the commands are in it");
        let commands = message.items().iter().map(|entry| entry.command);
        found.extend(commands.map(|command| (command.material, command.vector)));
    }
    // Each order comes from a process of its own, and those of one step take effect in the order of their random ids.
    found.sort_by_key(|(material, half)| (half != &[0.0; 3], material.law));
    let [(sand, _), (water, _), (_, half)] = found[..] else {
        panic!("{found:?}");
    };
    assert_eq!((sand.law, sand.youngs_modulus), (4, 2e5));
    assert_eq!(sand.parameters, [30.0, 0.0, 0.0, 0.0]);
    assert_eq!((water.law, water.parameters[0]), (8, 1e5));
    assert_eq!(half, [9.0, 9.0, 0.02]);
    assert_eq!(server.result()["steps"], 20);
}

#[test]
fn reset_brings_the_first_frames_back_bit_for_bit() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let output = stage.ctl(&["--at-step", "11", "reset"]);
    assert!(output.status.success());
    assert!(stage.ctl(&["resume"]).status.success());
    let states: Vec<_> = (0..=20)
        .map(|_| {
            let frame = next_frame(&mut frames);
            (frame.header().sim_time, frame.gaussians().to_vec())
        })
        .collect();
    for step in 1..=10 {
        assert_eq!(states[step + 10], states[step], "step {step} again");
    }
}

#[test]
fn no_server_is_a_sentence() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let output = stage.ctl(&["--timeout", "0", "pause"]);
    assert!(!output.status.success());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        words.contains("default") && words.contains("cosplat serve"),
        "{words}"
    );
}

#[test]
fn pause_and_stop_act_at_their_step_and_frames_say_so() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--paused"]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    for order in [["--at-step", "8", "pause"], ["--at-step", "15", "stop"]] {
        assert!(stage.ctl(&order).status.success(), "{order:?}");
    }
    // Step and flags of the frames up to the first that is followed by nothing.
    let mut run = || {
        let mut seen = Vec::new();
        loop {
            let header = *next_frame(&mut frames).header();
            seen.push((header.step, header.flags));
            if header.flags != 0 {
                return seen;
            }
        }
    };
    assert_eq!(run(), [(0, wire::FRAME_FLAG_PAUSED)]);
    let refused = stage.ctl(&["--at-step", "9", "resume"]);
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success(), "step 9 never comes");
    assert!(
        words.contains("step 9") && words.contains("step 1"),
        "{words}"
    );
    let mut expected: Vec<_> = (1..=7).map(|step| (step, 0)).collect();
    expected[6].1 = wire::FRAME_FLAG_PAUSED;
    assert!(stage.ctl(&["resume"]).status.success());
    assert_eq!(run(), expected);
    let paused = wait_for_status(&client, |s| s.server_state == wire::SERVER_PAUSED);
    assert_eq!(paused.step, 7);
    let mut expected: Vec<_> = (8..=14).map(|step| (step, 0)).collect();
    expected[6].1 = wire::FRAME_FLAG_LAST;
    assert!(stage.ctl(&["--at-step", "8", "resume"]).status.success());
    assert_eq!(run(), expected);
    assert_eq!(server.result()["steps"], 14);
}

#[test]
fn a_flood_of_orders_leaves_steps_and_others_alone() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&[]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let ends = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let mut floods = Vec::new();
        for _ in 0..4 {
            let mut sender = stage.sender();
            let ends = &ends;
            floods.push(scope.spawn(move || {
                let push = wire::Command {
                    kind: wire::COMMAND_IMPULSE,
                    vector: [1e-9, 0.0, 0.0],
                    ..Default::default()
                };
                let mut answered = 0;
                while !ends.load(Ordering::Relaxed) {
                    answered += sender.send(&[push; 32], PATIENCE).expect("answers").len();
                }
                answered
            }));
        }
        let first = next_frame(&mut frames).header().step;
        for step in first + 1..first + 60 {
            assert_eq!(next_frame(&mut frames).header().step, step);
            if step % 20 == 0 {
                assert!(
                    stage
                        .ctl(&["push", "left", "0", "0.1", "0"])
                        .status
                        .success()
                );
            }
        }
        ends.store(true, Ordering::Relaxed);
        for flood in floods {
            assert!(flood.join().expect("a flood ends") > 0);
        }
    });
    assert!(stage.ctl(&["stop"]).status.success());
    server.result();
}
