//! Commands, their answers, and the journal of what was applied.

use std::time::{Duration, Instant};

use cosplat_ipc::{
    Client, ServerPorts,
    client::{CommandSender, SendError, Unanswered},
    schema::{
        ACK_ACCEPTED, ACK_REFUSED, Ack, AppliedCommand, COMMAND_IMPULSE, COMMAND_PAUSE, Command,
        MAX_COMMANDS,
    },
    server::{Departed, Reply},
};

use super::{
    child::Process,
    support::{PATIENCE, TestDomain, serve},
};

/// Impulses are accepted at step 9, everything else is refused.
fn acks(commands: &[Command]) -> Vec<Ack> {
    let ack = |command: &Command| match command.kind {
        COMMAND_IMPULSE => Ack::accepted(command.sequence, 9),
        _ => Ack::refused(command.sequence, "not today"),
    };
    commands.iter().map(ack).collect()
}

/// Answers requests until `count` came.
fn answer(ports: &mut ServerPorts, count: usize) -> Vec<(u64, Command)> {
    let mut seen = Vec::new();
    let start = Instant::now();
    let mut answered = 0;
    while answered < count {
        assert!(start.elapsed() < PATIENCE, "no request came");
        ports.wait(Duration::from_millis(100));
        answered += ports.poll_commands(|asked| {
            let client = asked.header.client;
            seen.extend(asked.commands.iter().map(|command| (client, *command)));
            Reply::Now(acks(asked.commands))
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

/// Unseen, that is without an effect.
#[test]
fn a_flood_is_bounded_and_abandoned_requests_are_dropped() {
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
        ports.poll_commands(|_| panic!("an abandoned request was served")),
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

/// For early and for late readers.
#[test]
fn every_applied_command_is_in_the_journal_once() {
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

fn push() -> [Command; 1] {
    [Command {
        kind: COMMAND_IMPULSE,
        ..Command::default()
    }]
}

/// Senders with as many requests as they may have, whose answers nobody fetches.
fn careless(
    domain: &TestDomain,
    session: &str,
    count: usize,
) -> Vec<(CommandSender, Vec<Unanswered>)> {
    let careless = || {
        let client = Client::connect(domain, session, "careless", PATIENCE).expect("attached");
        let mut sender = client.commands().expect("a sender");
        let sent = (0..16).map(|_| sender.submit(&push(), PATIENCE).expect("a place"));
        let sent = sent.collect();
        (sender, sent)
    };
    (0..count).map(|_| careless()).collect()
}

#[test]
fn answers_that_nobody_fetches_take_no_place_of_others() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "careless");
    let careless = careless(&domain, "careless", 30);
    assert_eq!(answer(&mut ports, 30 * 16).len(), 30 * 16);
    let client = Client::connect(&domain, "careless", "honest", PATIENCE).expect("attached");
    let mut honest = client.commands().expect("a sender");
    for _ in 0..40 {
        let sent = honest.submit(&push(), PATIENCE).expect("a place");
        answer(&mut ports, 1);
        let acks = honest.answers(sent, PATIENCE).expect("an answer");
        assert_eq!(acks[0].status, ACK_ACCEPTED);
    }
    // And theirs are still there.
    for (sender, sent) in careless {
        for sent in sent {
            assert_eq!(sender.answers(sent, PATIENCE).expect("an answer").len(), 1);
        }
    }
}

#[test]
fn clients_take_turns_whatever_one_of_them_sends() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "turns");
    let greedy = careless(&domain, "turns", 20);
    let client = Client::connect(&domain, "turns", "honest", PATIENCE).expect("attached");
    let mut honest = client.commands().expect("a sender");
    let id = honest.client_id();
    // A server with time for few requests at once: each gets its turn after at most one of every other.
    for _ in 0..2 {
        let sent = honest.submit(&push(), PATIENCE).expect("a place");
        let mut before = Vec::new();
        while before.last() != Some(&id) {
            let mut room = 7;
            ports.poll_commands(|asked| {
                if room == 0 || before.last() == Some(&id) {
                    return Reply::NotYet;
                }
                room -= 1;
                before.push(asked.header.client);
                Reply::Now(acks(asked.commands))
            });
            assert!(before.len() <= 21, "{before:?}");
        }
        honest.answers(sent, PATIENCE).expect("an answer");
        let turns = before.len();
        before.sort_unstable();
        before.dedup();
        assert_eq!(before.len(), turns, "nobody has two turns before it");
    }
    drop(greedy);
}

#[test]
fn what_cannot_wait_is_heard_past_what_others_sent() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "urgent");
    let client = Client::connect(&domain, "urgent", "test", PATIENCE).expect("attached");
    let (mut patient, mut urgent) = (
        client.commands().expect("a sender"),
        client.commands().expect("a sender"),
    );
    let first = patient.submit(&push(), PATIENCE).expect("a place");
    let pause = [Command {
        kind: COMMAND_PAUSE,
        ..Command::default()
    }];
    let second = urgent.submit(&pause, PATIENCE).expect("a place");
    let mut heard = Vec::new();
    let is_pause = |commands: &[Command]| commands.iter().all(|c| c.kind == COMMAND_PAUSE);
    for _ in 0..2 {
        ports.poll_urgent(is_pause, |asked| {
            heard.push(asked.commands[0].kind);
            Reply::Now(acks(asked.commands))
        });
    }
    assert_eq!(heard, [COMMAND_PAUSE]);
    let acks = urgent.answers(second, PATIENCE).expect("an answer");
    assert_eq!(acks[0].status, ACK_REFUSED);
    // The other one is still there.
    answer(&mut ports, 1);
    assert_eq!(
        patient.answers(first, PATIENCE).expect("an answer").len(),
        1
    );
}

#[test]
fn answers_may_come_later_and_reach_who_still_waits() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "later");
    let client = Client::connect(&domain, "later", "test", PATIENCE).expect("attached");
    let mut sender = client.commands().expect("a sender");
    let (first, second, third) = (
        sender.submit(&push(), PATIENCE).expect("a place"),
        sender.submit(&push(), PATIENCE).expect("a place"),
        sender.submit(&push(), PATIENCE).expect("a place"),
    );
    let mut tickets = Vec::new();
    ports.poll_commands(|asked| {
        tickets.push(asked.ticket);
        Reply::Later
    });
    assert_eq!(tickets.len(), 3);
    let soon = Duration::from_millis(20);
    let waited = sender.answers(first, soon);
    assert!(
        matches!(waited, Err(SendError::Timeout { seconds }) if seconds >= 0.02),
        "{waited:?}"
    );
    // The first does not wait any more; the second gets the answer to its own request, and the third is dropped.
    for (ticket, sequence) in tickets.iter().zip(1..=2) {
        ports.answer(*ticket, vec![Ack::refused(sequence, "no")]);
    }
    let acks = sender.answers(second, PATIENCE).expect("an answer");
    assert_eq!((acks[0].sequence, acks[0].status), (2, ACK_REFUSED));
    drop(ports);
    let lost = sender.answers(third, PATIENCE);
    assert!(
        matches!(lost, Err(SendError::ServerEnded { .. })),
        "{lost:?}"
    );
}

#[test]
fn a_place_that_a_dead_client_left_gets_no_answers_of_its() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "place");
    let client = Client::connect(&domain, "place", "test", PATIENCE).expect("attached");
    let mut tickets = Vec::new();
    let mut hold = |ports: &mut ServerPorts| {
        ports.poll_commands(|asked| {
            tickets.push(asked.ticket);
            Reply::Later
        });
        *tickets.last().expect("a request came")
    };
    // The next sender takes the place of the former, and its first request has the same number.
    let mut gone = client.commands().expect("a sender");
    let unread = gone.submit(&push(), PATIENCE).expect("a place");
    let former = hold(&mut ports);
    drop((unread, gone));
    let mut sender = client.commands().expect("a sender");
    let sent = sender.submit(&push(), PATIENCE).expect("a place");
    let ticket = hold(&mut ports);
    ports.answer(former, vec![Ack::refused(1, "not yours")]);
    ports.answer(ticket, vec![Ack::accepted(1, 9)]);
    let acks = sender.answers(sent, PATIENCE).expect("an answer");
    assert_eq!(acks[0].status, ACK_ACCEPTED);
}

/// The first port that has gone.
fn departed(ports: &mut ServerPorts) -> Departed {
    let start = Instant::now();
    loop {
        ports.poll_commands(|asked| Reply::Now(acks(asked.commands)));
        if let Some(departed) = ports.departed().first() {
            return *departed;
        }
        assert!(start.elapsed() < PATIENCE, "it is still there");
        ports.wait(Duration::from_millis(5));
        ports.maintain();
    }
}

#[test]
fn a_client_that_died_is_told_from_one_that_left() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "gone");
    let client = Client::connect(&domain, "gone", "test", PATIENCE).expect("attached");
    let mut sender = client.commands().expect("a sender");
    let leaving = std::thread::spawn(move || {
        sender
            .send(&[Command::default()], PATIENCE)
            .expect("an answer");
    });
    answer(&mut ports, 1);
    leaving.join().expect("the sender's thread");
    assert!(!departed(&mut ports).died);
    let mut child = Process::start(&[], &domain, "order", "gone");
    answer(&mut ports, 1);
    child.kill();
    assert!(departed(&mut ports).died);
}
