//! Lock-step on the wire: requests of participants, answers that come later, and ports that vanish.

use std::time::{Duration, Instant};

use cosplat_ipc::{
    Client, ServerPorts,
    client::{SendError, StepError, Until},
    schema::{
        Ack, Command, Contact, ContactsHeader, RETURN_COMPLETE, RETURN_REFUSED, RETURN_TIMEOUT,
        STEP_ADVANCE, STEP_ATTACH, STEP_DETACH, StepDone, StepRequest, UNTIL_CONTACT, UNTIL_EVENT,
    },
    server::Reply,
};

use super::{
    child::Process,
    support::{PATIENCE, TestDomain, send_frame, serve},
};

type Held = (u64, StepRequest, Vec<Command>);

/// Takes requests until one came, and keeps it for a later answer.
fn take(ports: &mut ServerPorts) -> Held {
    let start = Instant::now();
    loop {
        let mut held = None;
        ports.poll_steps(|asked| {
            held = Some((asked.ticket, *asked.header, asked.commands.to_vec()));
            Reply::Later
        });
        if let Some(held) = held {
            return held;
        }
        assert!(start.elapsed() < PATIENCE, "no request came");
        ports.wait(Duration::from_millis(100));
        ports.maintain();
    }
}

fn complete(step: u64, acks: Vec<Ack>) -> (StepDone, Vec<Ack>) {
    let done = StepDone {
        step,
        ..StepDone::of_cause(RETURN_COMPLETE, "")
    };
    (done, acks)
}

#[test]
fn a_step_is_answered_after_its_frame() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "steps");
    let client = Client::connect(&domain, "steps", "test", PATIENCE).expect("attached");
    let epoch = client.hello().epoch;
    let robot = std::thread::spawn(move || {
        let mut frames = client.frames(1).expect("a reader");
        let mut robot = client.participate("robot", PATIENCE).expect("taken in");
        let commands = [Command::default(); 2];
        let until = Until::default().contact(3, 4).event();
        let stepped = robot.step_until(5, &commands, until).expect("an answer");
        let frame = frames.next(Duration::ZERO).expect("readable");
        (stepped, frame.map(|f| f.header().step), robot.client_id())
    });
    let (ticket, request, commands) = take(&mut ports);
    assert_eq!((request.kind, commands.len()), (STEP_ATTACH, 0));
    assert_eq!(request.participant(), Ok("robot"));
    ports.answer_steps(ticket, complete(7, vec![]));

    let (ticket, request, commands) = take(&mut ports);
    assert_eq!((request.kind, request.frames), (STEP_ADVANCE, 5));
    assert_eq!(request.until, UNTIL_CONTACT | UNTIL_EVENT);
    assert_eq!(request.pair, [3, 4]);
    assert_eq!(request.pid, std::process::id());
    let acks = commands.iter().map(|c| Ack::accepted(c.sequence, 8));
    let acks = acks.collect();
    send_frame(&ports, 12);
    ports.answer_steps(ticket, complete(12, acks));

    let (_, request, _) = take(&mut ports);
    assert_eq!(request.kind, STEP_DETACH);
    let (stepped, frame, number) = robot.join().expect("the robot's thread");
    assert!(stepped.is_complete() && stepped.refusal().is_none());
    assert_eq!((stepped.done.step, stepped.done.count), (12, 2));
    assert_eq!(stepped.done.epoch, epoch);
    assert_eq!(frame, Some(12), "the frame is there when the answer is");
    // FNV-1a of "robot": the same in every run.
    assert_eq!(number, request.client);
}

#[test]
fn refusals_and_timeouts_are_typed() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "no");
    let client = Client::connect(&domain, "no", "test", PATIENCE).expect("attached");
    for bad in ["", "a b", "ö", &"x".repeat(49)] {
        let error = client.participate(bad, PATIENCE).err().expect("no name");
        assert!(matches!(error, StepError::BadName { .. }), "{error}");
    }
    let robot = std::thread::spawn(move || {
        let refused = client
            .participate("robot", PATIENCE)
            .err()
            .expect("refused");
        let mut robot = client.participate("robot", PATIENCE).expect("taken in");
        let late = robot.step(1, &[]).expect("an answer");
        let many = robot.step(1, &[Command::default(); 33]);
        (refused, late, many.expect_err("too many"))
    });
    let (ticket, ..) = take(&mut ports);
    let refusal = StepDone::of_cause(RETURN_REFUSED, "the pace is realtime");
    ports.answer_steps(ticket, (refusal, vec![]));
    let (ticket, ..) = take(&mut ports);
    ports.answer_steps(ticket, complete(0, vec![]));
    let (ticket, ..) = take(&mut ports);
    let late = StepDone::of_cause(RETURN_TIMEOUT, "waited for camera");
    ports.answer_steps(ticket, (late, vec![]));
    take(&mut ports);
    let (refused, late, many) = robot.join().expect("the robot's thread");
    let said = refused.to_string();
    assert!(
        said.contains("robot") && said.contains("realtime"),
        "{said}"
    );
    assert_eq!(late.done.reason(), Ok("waited for camera"));
    let too_many = SendError::TooMany { count: 33, max: 32 };
    assert!(matches!(many, StepError::Send(error) if error == too_many));
}

#[test]
fn the_port_of_a_killed_participant_vanishes() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "kill");
    let mut child = Process::start(&[], &domain, "participate", "kill");
    let (ticket, request, _) = take(&mut ports);
    assert_eq!(request.pid, child.id());
    ports.answer_steps(ticket, complete(0, vec![]));
    let (ticket, ..) = take(&mut ports);
    assert_eq!(ports.participant_ports().count(), 1);
    child.kill();
    let start = Instant::now();
    while ports.participant_ports().count() > 0 {
        assert!(start.elapsed() < PATIENCE, "the port is still there");
        std::thread::sleep(Duration::from_millis(10));
        ports.maintain();
    }
    // Nobody is there to be answered, and that is no error.
    ports.answer_steps(ticket, complete(1, vec![]));
}

#[test]
fn contacts_arrive_and_the_strongest_come_first() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "touch");
    assert!(!ports.contacts_are_read());
    let client = Client::connect(&domain, "touch", "test", PATIENCE).expect("attached");
    let mut reader = client.contacts(4).expect("a reader");
    assert!(ports.contacts_are_read());
    let contact = |n: u32| Contact {
        other: n,
        impulse: [0.0, f64::from(n), 0.0],
        ..Contact::default()
    };
    let header = |step| ContactsHeader {
        step,
        ..ContactsHeader::default()
    };
    let few: Vec<Contact> = (0..3).map(contact).collect();
    let many: Vec<Contact> = (0..100).map(contact).collect();
    ports.publish_contacts(&header(1), &few).expect("sent");
    ports.publish_contacts(&header(2), &many).expect("sent");
    let message = reader.next(PATIENCE).expect("readable").expect("there");
    assert_eq!(message.items(), &few[..]);
    assert_eq!(message.header().total, 3);
    let message = reader.next(PATIENCE).expect("readable").expect("there");
    // One object: 16 contacts at most.
    assert_eq!(message.items().len(), 16);
    assert_eq!(message.items()[0].other, 99);
    assert_eq!(message.header().total, 100);
}

#[test]
fn who_lost_its_server_does_not_wait_for_another() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "gone");
    let client = Client::connect(&domain, "gone", "test", PATIENCE).expect("attached");
    let (say, hear) = std::sync::mpsc::channel();
    let robot = std::thread::spawn(move || {
        // An hour: the test would not come to its end.
        let patience = Duration::from_secs(3600);
        let mut robot = client.participate("robot", patience).expect("taken in");
        hear.recv().expect("the server has gone");
        robot.step(1, &[]).expect_err("nobody makes steps")
    });
    let (ticket, ..) = take(&mut ports);
    ports.answer_steps(ticket, complete(0, vec![]));
    // What was answered is still on its way when the last port goes.
    std::thread::sleep(Duration::from_millis(100));
    drop(ports);
    say.send(()).expect("the robot's thread");
    let error = robot.join().expect("the robot's thread");
    let is_gone = matches!(error, StepError::Send(SendError::NoServer { .. }));
    assert!(is_gone, "{error}");
}

#[test]
fn a_full_table_of_participants_leaves_a_place_for_orders() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "full");
    let attach = |role: &str| {
        let client = Client::connect(&domain, "full", role, PATIENCE).expect("attached");
        let status = client.status().expect("a reader of the status");
        (client, status)
    };
    let robots: Vec<_> = (0..32)
        .map(|n| {
            let (client, status) = attach("robot");
            let name = format!("robot-{n}");
            let robot = std::thread::spawn(move || {
                let part = client.participate(&name, PATIENCE).expect("taken in");
                let sender = client.commands().expect("a sender of orders as well");
                (client, part, sender, status)
            });
            let (ticket, ..) = take(&mut ports);
            ports.answer_steps(ticket, complete(0, vec![]));
            robot.join().expect("the robot's thread")
        })
        .collect();
    for role in ["view", "record", "controller"] {
        let (client, _) = attach(role);
        client.commands().expect("a place for orders");
    }
    std::thread::scope(|scope| {
        scope.spawn(|| drop(robots));
        for _ in 0..32 {
            let (ticket, ..) = take(&mut ports);
            ports.answer_steps(ticket, complete(0, vec![]));
        }
    });
}
