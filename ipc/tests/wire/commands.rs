//! Commands, their answers, and the journal of what was applied.

use std::time::{Duration, Instant};

use cosplat_ipc::{
    Client, ServerPorts,
    client::SendError,
    schema::{
        ACK_ACCEPTED, ACK_REFUSED, Ack, AppliedCommand, COMMAND_IMPULSE, COMMAND_PAUSE, Command,
        MAX_COMMANDS,
    },
};

use super::support::{PATIENCE, TestDomain, serve};

/// Answers requests until `count` came: impulses are accepted at step 9, everything else is refused.
fn answer(ports: &mut ServerPorts, count: usize) -> Vec<(u64, Command)> {
    let mut seen = Vec::new();
    let start = Instant::now();
    let mut answered = 0;
    while answered < count {
        assert!(start.elapsed() < PATIENCE, "no request came");
        ports.wait(Duration::from_millis(100));
        answered += ports.poll_commands(|header, commands| {
            seen.extend(commands.iter().map(|command| (header.client, *command)));
            commands
                .iter()
                .map(|command| match command.kind {
                    COMMAND_IMPULSE => Ack::accepted(command.sequence, 9),
                    _ => Ack::refused(command.sequence, "not today"),
                })
                .collect()
        });
        ports.maintain();
    }
    seen
}

#[test]
fn commands_and_answers_make_the_round_trip() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "talk");
    let client = Client::connect(&domain, "talk", "test", PATIENCE).expect("attached");
    let mut sender = client.commands().expect("a sender");
    let id = sender.client_id();
    let commands = [
        Command {
            kind: COMMAND_IMPULSE,
            object: 3,
            vector: [1.0, 2.0, 3.0],
            ..Command::default()
        },
        Command {
            kind: COMMAND_PAUSE,
            ..Command::default()
        },
    ];
    let waiting = std::thread::spawn(move || {
        let first = sender.send(&commands, PATIENCE);
        let second = sender.send(&commands[..1], PATIENCE);
        (first, second)
    });
    let seen = answer(&mut ports, 2);
    let (first, second) = waiting.join().expect("the sender's thread");
    let first = first.expect("answers");
    assert_eq!(
        (first[0].status, first[0].applied_at_step),
        (ACK_ACCEPTED, 9)
    );
    assert_eq!(
        (first[1].status, first[1].reason()),
        (ACK_REFUSED, Ok("not today"))
    );
    assert_eq!(second.expect("an answer")[0].sequence, 3);
    let sequences: Vec<u64> = seen.iter().map(|(_, command)| command.sequence).collect();
    assert_eq!(sequences, [1, 2, 3]);
    assert_eq!(seen[0].0, id);
    assert_eq!(seen[0].1.vector, [1.0, 2.0, 3.0]);
}

#[test]
fn a_flood_of_requests_is_bounded_and_abandoned_ones_are_dropped_unseen() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "flood");
    let client = Client::connect(&domain, "flood", "test", PATIENCE).expect("attached");
    let mut sender = client.commands().expect("a sender");
    let impulse = [Command {
        kind: COMMAND_IMPULSE,
        ..Command::default()
    }];
    // The server looks at nothing: each wait ends, and soon the queue is full.
    let mut outcomes = Vec::new();
    for _ in 0..40 {
        outcomes.push(sender.send(&impulse, Duration::from_millis(1)));
    }
    let busy = |o: &Result<_, _>| matches!(o, Err(SendError::Busy { .. }));
    let timeout = |o: &Result<_, _>| matches!(o, Err(SendError::Timeout { .. }));
    assert!(
        outcomes.iter().all(|o| busy(o) || timeout(o)),
        "{outcomes:?}"
    );
    assert!(outcomes.iter().filter(|o| timeout(o)).count() <= 16);
    assert!(busy(outcomes.last().expect("an outcome")));
    // Nobody waits for them any more, so they must not act on the world.
    assert_eq!(
        ports.poll_commands(|_, _| panic!("an abandoned request was served")),
        0
    );
    // And the sender is not stuck.
    let waiting = std::thread::spawn(move || sender.send(&impulse, PATIENCE));
    assert_eq!(answer(&mut ports, 1).len(), 1);
    assert_eq!(waiting.join().expect("thread").expect("answers").len(), 1);
}

#[test]
fn too_many_commands_are_refused_before_they_are_sent() {
    let domain = TestDomain::new();
    let _ports = serve(&domain, "many");
    let client = Client::connect(&domain, "many", "test", PATIENCE).expect("attached");
    let mut sender = client.commands().expect("a sender");
    let outcome = sender.send(&[Command::default(); MAX_COMMANDS + 1], PATIENCE);
    let expected = SendError::TooMany {
        count: MAX_COMMANDS + 1,
        max: MAX_COMMANDS,
    };
    assert_eq!(outcome, Err(expected));
}

#[test]
fn every_applied_command_is_in_the_journal_once_for_early_and_late_readers() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "journal");
    let client = Client::connect(&domain, "journal", "test", PATIENCE).expect("attached");
    let mut early = client.journal().expect("a reader");
    let applied = |sequence| AppliedCommand {
        client: 5,
        command: Command {
            sequence,
            ..Command::default()
        },
        ..AppliedCommand::default()
    };
    // 1 + 2 + ... + 40 commands in 40 steps; the larger steps need two messages each.
    let mut sequence = 0;
    for step in 1..=40 {
        let commands: Vec<_> = (0..step).map(|i| applied(sequence + i)).collect();
        ports.publish_journal(step, &commands).expect("published");
        sequence += step;
    }
    let mut late = client.journal().expect("a reader");
    for reader in [&mut early, &mut late] {
        let mut next = 0;
        let mut step = 0;
        while next < sequence {
            let message = reader.next(PATIENCE).expect("readable").expect("a message");
            assert!(message.header().step >= step);
            step = message.header().step;
            for entry in message.items() {
                assert_eq!(entry.command.sequence, next);
                next += 1;
            }
        }
        assert_eq!(
            reader
                .next(Duration::ZERO)
                .expect("readable")
                .map(|m| m.missed()),
            None
        );
        assert_eq!(reader.missed(), 0);
    }
}
