//! What an inbox takes, gives and forgets.

use cosplat_pacing::{steering::Permission, waiting::SHARE};

use super::*;

fn impulse(sequence: u64, apply_at_step: u64) -> wire::Command {
    wire::Command {
        kind: wire::COMMAND_IMPULSE,
        sequence,
        apply_at_step,
        vector: [1.0, 0.0, 0.0],
        ..Default::default()
    }
}

/// The answers to a request of `client`, which come at once.
fn accept(
    ingest: &mut Ingest,
    client: u64,
    commands: &[wire::Command],
    next_step: u64,
    check: &dyn Fn(&Action) -> Result<(), CommandError>,
) -> Vec<wire::Ack> {
    let header = wire::CommandHeader {
        client,
        ..Default::default()
    };
    let asked = Asked {
        ticket: 1,
        port: client.into(),
        header: &header,
        commands,
    };
    match ingest.accept(&asked, next_step, check) {
        Reply::Now(acks) => acks,
        other => panic!("{other:?}"),
    }
}

#[test]
fn due_commands_come_in_step_client_sequence_order() {
    let mut ingest = Ingest::default();
    let fine = |_: &Action| Ok(());
    accept(&mut ingest, 2, &[impulse(1, 5), impulse(2, 4)], 3, &fine);
    accept(
        &mut ingest,
        1,
        &[impulse(9, 5), impulse(3, 5), impulse(4, 7)],
        3,
        &fine,
    );
    let order: Vec<_> = ingest
        .take_due(5)
        .iter()
        .map(|p| (p.applied.step, p.applied.client, p.command.sequence))
        .collect();
    assert_eq!(order, [(4, 2, 2), (5, 1, 3), (5, 1, 9), (5, 2, 1)]);
    assert_eq!(ingest.take_due(7).len(), 1);
}

#[test]
fn a_past_step_means_the_next_one() {
    let mut ingest = Ingest::default();
    let acks = accept(&mut ingest, 1, &[impulse(1, 0), impulse(2, 2)], 8, &|_| {
        Ok(())
    });
    assert!(acks.iter().all(|ack| ack.applied_at_step == 8));
    assert!(ingest.take_due(7).is_empty());
}

#[test]
fn a_refused_command_leaves_nothing_behind() {
    let mut ingest = Ingest::default();
    let refuse = |_: &Action| {
        Err(CommandError::UnknownObject {
            object: 7,
            count: 2,
        })
    };
    let acks = accept(&mut ingest, 1, &[impulse(1, 0)], 1, &refuse);
    assert_eq!(acks[0].status, wire::ACK_REFUSED);
    let reason = String::from_utf8_lossy(&acks[0].reason).into_owned();
    assert!(reason.contains('7') && reason.contains('2'), "{reason}");
    assert!(ingest.take_due(u64::MAX).is_empty());
    assert_eq!((ingest.accepted, ingest.refused), (0, 1));
}

#[test]
fn an_edit_that_waits_can_be_undone_already() {
    let mut ingest = Ingest::default();
    let judge = |action: &Action| match action {
        Action::Undo => Err(CommandError::NothingToUndo),
        Action::Redo => Err(CommandError::NothingToRedo),
        _ => Ok(()),
    };
    let of = |kind| wire::Command {
        kind,
        ..Default::default()
    };
    let (undo, redo) = (of(wire::COMMAND_UNDO), of(wire::COMMAND_REDO));
    let early = accept(&mut ingest, 1, &[undo, redo], 1, &judge);
    assert!(early.iter().all(|ack| !ack.is_accepted()));
    let orders = [of(wire::COMMAND_REMOVE), undo, redo];
    let acks = accept(&mut ingest, 1, &orders, 1, &judge);
    assert!(acks.iter().all(wire::Ack::is_accepted), "{acks:?}");
}

#[test]
fn a_flood_is_refused_and_not_stored() {
    let mut ingest = Ingest::default();
    let flood = vec![impulse(1, 0); SHARE + 10];
    let acks = accept(&mut ingest, 1, &flood, 1, &|_| Ok(()));
    let refused = acks.iter().filter(|a| a.status == wire::ACK_REFUSED);
    assert_eq!(refused.count(), 10);
    assert_eq!(ingest.take_due(1).len(), SHARE);
}

#[test]
fn an_order_for_a_checkpoint_is_answered_late_or_refused_now() {
    let checkpoint = wire::Command {
        kind: wire::COMMAND_CHECKPOINT,
        sequence: 3,
        ..Default::default()
    };
    let fine = |_: &Action| Ok(());
    let refused = accept(&mut Ingest::default(), 1, &[checkpoint], 5, &fine);
    assert_eq!(refused[0].status, wire::ACK_REFUSED);
    let folder = CheckpointFolder {
        folder: "/tmp/states".into(),
        session: "demo".into(),
    };
    let mut ingest = Ingest::new(false, Some(folder));
    let asked = Asked {
        ticket: 8,
        port: 1,
        header: &wire::CommandHeader::default(),
        commands: &[impulse(2, 0), checkpoint],
    };
    assert_eq!(ingest.accept(&asked, 5, &fine), Reply::Later);
    let answers = ingest.late.written(5, &Ok("file".into()));
    let (ticket, acks) = &answers[0];
    assert_eq!((*ticket, acks.len()), (8, 2));
    assert_eq!((acks[0].sequence, acks[0].reason()), (2, Ok("")));
    assert_eq!((acks[1].sequence, acks[1].reason()), (3, Ok("file")));
}

fn of(kind: u32, object: u32, apply_at_step: u64) -> wire::Command {
    wire::Command {
        kind,
        object,
        apply_at_step,
        ..Default::default()
    }
}

fn fine(_: &Action) -> Result<(), CommandError> {
    Ok(())
}

#[test]
fn a_client_that_fills_its_share_keeps_out_nobody() {
    let mut ingest = Ingest::default();
    let flood = vec![impulse(1, 9_000_000); SHARE + 1];
    let acks = accept(&mut ingest, 1, &flood, 1, &fine);
    assert_eq!(acks.iter().filter(|ack| ack.is_accepted()).count(), SHARE);
    let orders = [
        impulse(2, 0),
        impulse(3, 50),
        of(wire::COMMAND_RESET, 0, 0),
        of(wire::COMMAND_PAUSE, 0, 7),
    ];
    let of_another = accept(&mut ingest, 2, &orders, 1, &fine);
    assert!(of_another.iter().all(wire::Ack::is_accepted));
    // The next step hears everybody.
    let own = accept(&mut ingest, 1, &[impulse(2, 0), impulse(3, 2)], 1, &fine);
    assert!(own[0].is_accepted() && !own[1].is_accepted(), "{own:?}");
    assert_eq!(ingest.take_due(1).len(), 3);
    ingest.steering.made_step(7);
    assert_eq!(ingest.steering.permission(), Permission::Wait);
}

#[test]
fn a_full_share_of_controls_still_takes_what_acts_at_once() {
    let mut ingest = Ingest::default();
    let flood = vec![of(wire::COMMAND_PAUSE, 0, 50); SHARE + 1];
    let acks = accept(&mut ingest, 1, &flood, 1, &fine);
    assert!(!acks[SHARE].is_accepted());
    let now = accept(&mut ingest, 1, &[of(wire::COMMAND_PAUSE, 0, 0)], 1, &fine);
    assert!(now[0].is_accepted());
    assert_eq!(ingest.steering.permission(), Permission::Wait);
}

#[test]
fn orders_of_the_dead_are_dropped_and_of_those_who_left_kept() {
    let mut ingest = Ingest::default();
    let orders = [impulse(1, 5), of(wire::COMMAND_PAUSE, 0, 5)];
    for client in [1, 2] {
        accept(&mut ingest, client, &orders, 1, &fine);
    }
    ingest.depart(Departed {
        port: 1,
        died: true,
    });
    ingest.depart(Departed {
        port: 2,
        died: false,
    });
    assert_eq!((ingest.waiting(), ingest.steering.later().len()), (1, 1));
    assert_eq!(ingest.take_due(5)[0].command.client, 2);
    // As many as come and go take the room of one.
    for client in 3..=5 {
        let flood = vec![impulse(1, 9_000_000); SHARE];
        accept(&mut ingest, client, &flood, 1, &fine);
        ingest.depart(Departed {
            port: client.into(),
            died: false,
        });
    }
    assert!(ingest.waiting() <= SHARE, "{}", ingest.waiting());
}

#[test]
fn what_waits_can_be_cancelled() {
    let folder = CheckpointFolder {
        folder: "/tmp/states".into(),
        session: "demo".into(),
    };
    let mut ingest = Ingest::new(true, Some(folder));
    for (client, ticket) in [(1, 4), (2, 5)] {
        let header = wire::CommandHeader {
            client,
            ..Default::default()
        };
        let asked = Asked {
            ticket,
            port: client.into(),
            header: &header,
            commands: &[
                impulse(1, 0),
                impulse(2, 9),
                of(wire::COMMAND_PAUSE, 0, 9),
                of(wire::COMMAND_CHECKPOINT, 0, 9),
                of(wire::COMMAND_STEP, 3, 0),
            ],
        };
        assert_eq!(ingest.accept(&asked, 1, &fine), Reply::Later);
    }
    let cancel = |whose| of(wire::COMMAND_CANCEL, whose, 0);
    let acks = accept(&mut ingest, 1, &[cancel(0)], 1, &fine);
    assert_eq!((acks[0].status, acks[0].applied_at_step), (1, 1));
    assert_eq!((ingest.waiting(), ingest.steering.later().len()), (2, 1));
    let answers = ingest.take_answers();
    assert_eq!((answers.len(), answers[0].0), (1, 4));
    assert_eq!(answers[0].1[3].reason(), Ok(CANCELLED));
    // Steps that somebody else waits for are made.
    assert_eq!(ingest.steering.permission(), Permission::Step);
    let of_all = [of(wire::COMMAND_CHECKPOINT, 0, 9), cancel(1)];
    let acks = accept(&mut ingest, 3, &of_all, 1, &fine);
    assert!(!acks[0].is_accepted() && acks[1].is_accepted());
    assert_eq!((ingest.waiting(), ingest.steering.later().len()), (0, 0));
    assert_eq!(ingest.take_answers()[0].0, 5);
    assert_eq!(ingest.steering.permission(), Permission::Wait);
    assert_eq!(ingest.late.file_due(9), None);
    let refused = [cancel(2), of(wire::COMMAND_CANCEL, 0, 9)];
    let acks = accept(&mut ingest, 3, &refused, 1, &fine);
    assert!(acks.iter().all(|ack| !ack.is_accepted()));
}

#[test]
fn a_request_that_ends_early_takes_its_orders_along() {
    let mut ingest = Ingest::default();
    let header = wire::StepRequest::default();
    for ticket in [7, 8] {
        let asked = Asked {
            ticket,
            port: 3,
            header: &header,
            commands: &[impulse(1, 0), impulse(2, 5)],
        };
        ingest.accept_now(&asked, 1, &fine);
    }
    ingest.withdraw(CalledOff::Request { port: 3, ticket: 7 });
    assert_eq!(ingest.take_due(1).len(), 1);
    assert_eq!(ingest.waiting(), 1);
    ingest.withdraw(CalledOff::Port(3));
    assert_eq!(ingest.waiting(), 0);
}

#[test]
fn a_step_beyond_reach_is_refused() {
    let mut ingest = Ingest::default();
    let acks = accept(&mut ingest, 1, &[impulse(1, u64::MAX)], 1, &|_| Ok(()));
    assert_eq!(acks[0].status, wire::ACK_REFUSED);
}
