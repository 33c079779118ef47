//! Orders that wait for their step: nobody's keep out those of others, and all can be taken back.

use cosplat_ipc::{
    client::Until,
    schema::{self as wire, Command},
};

use crate::stage::{PATIENCE, Stage, wait_for_status, watchdog};

/// Orders that one client may have waiting for later steps.
const SHARE: usize = 4096;

fn impulse(apply_at_step: u64) -> Command {
    Command {
        kind: wire::COMMAND_IMPULSE,
        vector: [0.1, 0.0, 0.0],
        apply_at_step,
        ..Command::default()
    }
}

#[test]
fn a_client_that_fills_its_share_shuts_out_nobody() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "free"]);
    let mut flooder = stage.sender();
    let ahead = [impulse(9_000_000); wire::MAX_COMMANDS];
    for _ in 0..SHARE / wire::MAX_COMMANDS {
        let acks = flooder.send(&ahead, PATIENCE).expect("answers");
        assert!(acks.iter().all(wire::Ack::is_accepted));
    }
    let mut refused = |command| {
        let acks = flooder.send(&[command], PATIENCE).expect("an answer");
        let reason = acks[0].reason().expect("text").to_owned();
        (!acks[0].is_accepted()).then_some(reason)
    };
    let full = refused(impulse(9_000_000)).expect("its share is full");
    assert!(full.contains("4096 orders of this client"), "{full}");
    assert_eq!(refused(impulse(0)), None, "the next step hears everybody");
    for order in [
        &["push", "left", "1", "0", "0"][..],
        &["--at-step", "8000000", "pause"],
        &["--at-step", "8000000", "push", "left", "1", "0", "0"],
        &["reset"],
    ] {
        let output = stage.ctl(order);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{order:?}: {words}");
    }
    let late = stage.ctl(&["--at-step", "8000000", "cancel"]);
    let words = String::from_utf8_lossy(&late.stderr).into_owned();
    assert!(
        !late.status.success() && words.contains("at once"),
        "{words}"
    );
    assert!(stage.ctl(&["cancel"]).status.success());
    assert_eq!(refused(impulse(9_000_000)), None, "its share is free again");
}

#[test]
fn cancelled_orders_do_not_take_effect() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--paused"]);
    let client = stage.client();
    let mut journal = client.journal().expect("the journal is readable");
    for order in [
        &["--at-step", "3", "push", "left", "9", "0", "0"][..],
        &["--at-step", "4", "stop"],
        &["cancel"],
        &["--at-step", "9", "stop"],
        &["--at-step", "5", "gravity", "0", "0", "0"],
        &["resume"],
    ] {
        assert!(stage.ctl(order).status.success(), "{order:?}");
    }
    assert_eq!(server.result()["steps"], 8);
    let message = journal.next(PATIENCE).expect("well-formed").expect("one");
    let kinds: Vec<_> = message.items().iter().map(|a| a.command.kind).collect();
    assert_eq!(kinds, [wire::COMMAND_SET_GRAVITY]);
}

#[test]
fn an_early_return_takes_the_rest_of_the_move_along() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "lockstep", "--participants", "arm"]);
    let client = stage.client();
    let mut journal = client.journal().expect("the journal is readable");
    let mut arm = client.participate("arm", PATIENCE).expect("taken in");
    let reset = Command {
        kind: wire::COMMAND_RESET,
        apply_at_step: 2,
        ..Command::default()
    };
    let guarded = [impulse(1), reset, impulse(3), impulse(5)];
    let until = Until::default().event();
    let stepped = arm.step_until(9, &guarded, until).expect("an answer");
    assert_eq!(
        (stepped.done.cause, stepped.done.step),
        (wire::RETURN_EVENT, 2)
    );
    arm.step(9, &[impulse(11)]).expect("an answer");
    let mut steps = Vec::new();
    while steps.len() < 3 {
        let message = journal.next(PATIENCE).expect("well-formed").expect("one");
        steps.extend(message.items().iter().map(|applied| applied.step));
    }
    assert_eq!(steps, [1, 2, 11]);
}

#[test]
fn the_world_stands_when_the_last_named_participant_has_left() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "lockstep", "--participants", "arm"]);
    let client = stage.client();
    let mut arm = client.participate("arm", PATIENCE).expect("taken in");
    arm.step(3, &[]).expect("an answer");
    drop(arm);
    let waits = |s: &wire::Status| s.server_state == wire::SERVER_WAITING && s.step == 3;
    wait_for_status(&client, waits);
    // Twenty steps of real time, in which it made as many.
    std::thread::sleep(std::time::Duration::from_millis(400));
    wait_for_status(&client, waits);
    let mut leg = client.participate("leg", PATIENCE).expect("taken in");
    let done = leg.step(1, &[]).expect("an answer").done;
    assert_eq!(done.step, 4);
    assert!(stage.ctl(&["stop"]).status.success());
}
