//! Processes that die, and others that do not mind.

use std::{
    collections::BTreeSet,
    fs,
    os::unix::{fs::PermissionsExt, net::UnixDatagram},
    path::PathBuf,
    time::{Duration, Instant},
};

use cosplat_ipc::{Client, client::heartbeat_age, schema::Command, server::LoanRefused};

use super::{
    child::Process,
    support::{COUNT, PATIENCE, TestDomain, send_frame, serve},
};

#[test]
fn clients_carry_on_when_the_server_is_killed_and_started_again() {
    let domain = TestDomain::new();
    let mut server = Process::start(&[], &domain, "serve", "phoenix");
    server.hear().expect("a server");
    let client = Client::connect(&domain, "phoenix", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(64).expect("a reader");
    let mut objects = client.frames(1).expect("another reader");
    let mut status = client.status().expect("a status reader");
    let mut sender = client.commands().expect("a sender");
    let scene = client.scene(PATIENCE).expect("a scene");
    let command = [Command::default()];

    let mut first_epoch = 0;
    for round in 0..3 {
        let mut epoch = 0;
        let mut step = 0;
        let mut rounds_frames = 0;
        while rounds_frames < 50 {
            let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
            if rounds_frames == 0 && round > 0 && !frame.is_new_run() {
                // Left in the queue by the former server.
                continue;
            }
            if rounds_frames == 0 {
                assert_eq!(frame.is_new_run(), round > 0);
                epoch = frame.header().epoch;
                assert!(epoch > first_epoch);
                first_epoch = epoch;
            } else {
                assert_eq!(frame.header().epoch, epoch);
                assert_eq!(frame.header().step, step + 1);
            }
            step = frame.header().step;
            assert_eq!(
                frame.gaussians()[1].position,
                [step as f32, 1.0, step as f32]
            );
            rounds_frames += 1;
        }
        assert_eq!(reader.runs(), round + 1);
        assert_eq!(reader.missed(), 0);
        assert!(objects.next(PATIENCE).expect("readable").is_some());
        assert!(status.is_server_alive().expect("readable"));
        let acks = sender.send(&command, PATIENCE).expect("answers");
        assert_eq!(acks[0].sequence, 2 * round + 1);
        assert_eq!(
            client.scene(PATIENCE).expect("a scene").header().epoch,
            epoch
        );

        server.kill();
        let newest = status.newest().expect("readable").expect("a status");
        let start = Instant::now();
        while status.is_server_alive().expect("readable") {
            assert!(start.elapsed() < PATIENCE, "the heartbeat does not stop");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(heartbeat_age(&newest) >= Duration::from_secs(1));
        assert!(sender.send(&command, Duration::from_millis(50)).is_err());
        server = Process::start(&[], &domain, "serve", "phoenix");
        server.hear().expect("a server");
    }
    // What was mapped before the first death is still there.
    assert_eq!(scene.gaussians().len(), COUNT);
    assert_eq!(scene.gaussians()[5].position[0], 5.0);
}

#[test]
fn killed_readers_give_back_what_they_held() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "holders");
    let client = Client::connect(&domain, "holders", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(64).expect("a reader");
    let mut step = 0;
    for _ in 0..10 {
        let mut holder = Process::start(&[], &domain, "hold", "holders");
        // The holder takes one frame, keeps it, and lets its queue fill.
        step += 1;
        send_frame(&ports, step);
        assert!(holder.hear().expect("a holder").starts_with("holding"));
        for _ in 0..64 {
            step += 1;
            send_frame(&ports, step);
        }
        holder.kill();
        // More frames than the pool has: they fit only when the dead give theirs back.
        for _ in 0..ports.frame_slots() {
            step += 1;
            send_frame(&ports, step);
            while reader.next(Duration::ZERO).expect("readable").is_some() {}
        }
    }
    assert!(step > 10 * 160);
}

#[test]
fn a_full_pool_is_said_and_recovers_when_the_stuck_reader_dies() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "stuck");
    let slots = ports.frame_slots();
    // Enough readers with full queues to take the whole pool.
    let client = Client::connect(&domain, "stuck", "test", PATIENCE).expect("attached");
    let mut loans = Vec::new();
    let mut holders = Vec::new();
    let mut step = 0;
    while slots - loans.len() > 66 {
        loans.push(ports.loan_frame(COUNT).expect("memory"));
    }
    let mut holder = Process::start(&[], &domain, "hold", "stuck");
    step += 1;
    send_frame(&ports, step);
    assert!(holder.hear().expect("a holder").starts_with("holding"));
    holders.push(holder);
    let refused = loop {
        match ports.loan_frame(COUNT) {
            Ok(loan) => {
                assert!(loans.len() <= slots);
                // Half of them go out, half stay loans: both count.
                if step % 2 == 0 {
                    loans.push(loan);
                } else {
                    loan.send(&Default::default()).expect("sent");
                }
                step += 1;
            }
            Err(refused) => break refused,
        }
    };
    assert_eq!(refused, LoanRefused::PoolInUse { slots });
    assert!(refused.to_string().contains(&slots.to_string()));
    drop(loans);
    holders.clear();
    send_frame(&ports, 1000);
    let mut reader = client.frames(1).expect("a reader");
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!(frame.header().step, 1000);
}

/// Servers and clients.
#[test]
fn processes_killed_as_they_start_leave_the_session_usable() {
    let domain = TestDomain::new();
    // Starting takes some tens of milliseconds: the kills fall into all of its parts.
    for delay in (0..60).step_by(4) {
        let mut server = Process::start(&[], &domain, "serve", "early");
        std::thread::sleep(Duration::from_millis(delay));
        server.kill();
    }
    let mut server = Process::start(&[], &domain, "serve", "early");
    assert!(server.hear().expect("a server").starts_with("serving"));
    for delay in (0..60).step_by(4) {
        let mut client = Process::start(&[], &domain, "hold", "early");
        std::thread::sleep(Duration::from_millis(delay));
        client.kill();
    }
    let client = Client::connect(&domain, "early", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(1).expect("a reader");
    let first = reader.next(PATIENCE).expect("readable").expect("a frame");
    let first = first.header().step;
    while reader
        .next(PATIENCE)
        .expect("readable")
        .expect("a frame")
        .header()
        .step
        < first + 100
    {}
    assert_eq!(reader.runs(), 1);
}

/// All files and folders that `domain` has on this machine.
fn files_of(domain: &TestDomain) -> BTreeSet<PathBuf> {
    let shared = fs::read_dir("/dev/shm").expect("shared memory").flatten();
    let ours = |path: &PathBuf| {
        let name = path.file_name().expect("a name").to_string_lossy();
        name.starts_with(domain.prefix())
    };
    let mut found: BTreeSet<PathBuf> = shared.map(|file| file.path()).filter(ours).collect();
    let mut folders = vec![domain.root().to_path_buf()];
    while let Some(folder) = folders.pop() {
        // A folder may go while we look.
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                folders.push(entry.path());
            }
            found.insert(entry.path());
        }
    }
    found
}

#[test]
fn clients_killed_while_they_attach_leave_nothing() {
    let domain = TestDomain::new();
    let mut server = Process::start(&[], &domain, "idle", "tidy");
    server.hear().expect("a server");
    let before = files_of(&domain);
    // Attaching takes some hundred milliseconds: the kills fall into all of its parts.
    for delay in 0..40 {
        let mut client = Process::start(&[], &domain, "hold", "tidy");
        std::thread::sleep(Duration::from_millis(3 * delay));
        client.kill();
    }
    let start = Instant::now();
    loop {
        let now = files_of(&domain);
        if now == before {
            break;
        }
        let left: Vec<_> = now.symmetric_difference(&before).collect();
        assert!(start.elapsed() < 3 * PATIENCE, "{left:#?}");
        std::thread::sleep(Duration::from_millis(100));
    }
    // And the server serves.
    let client = Client::connect(&domain, "tidy", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(1).expect("a reader");
    assert!(reader.next(PATIENCE).expect("readable").is_some());
}

/// As a process leaves it that is killed between making a socket and registering its port.
#[test]
fn a_socket_without_an_owner_goes_and_others_stay() {
    let domain = TestDomain::new();
    let mut server = Process::start(&[], &domain, "idle", "socket");
    server.hear().expect("a server");
    let before = files_of(&domain);
    let orphan = domain.root().join("orphan.event");
    drop(UnixDatagram::bind(&orphan).expect("bound"));
    let kept = domain.root().join("kept.event");
    let _owner = UnixDatagram::bind(&kept).expect("bound");
    let start = Instant::now();
    while orphan.exists() {
        assert!(start.elapsed() < 3 * PATIENCE, "it stays");
        std::thread::sleep(Duration::from_millis(100));
    }
    let mut with_kept = before;
    with_kept.insert(kept);
    assert_eq!(files_of(&domain), with_kept);
}

/// Makes the files of `domain` whose names end in `suffix` what a process leaves that is killed while it makes
/// them; returns their number.
fn leave_unfinished(domain: &TestDomain, suffix: &str, is_empty: bool) -> usize {
    let files = fs::read_dir("/dev/shm").expect("shared memory").flatten();
    let theirs = files.filter(|file| {
        let name = file.file_name().into_string().unwrap_or_default();
        name.starts_with(domain.prefix()) && name.ends_with(suffix)
    });
    let mut count = 0;
    for file in theirs {
        let length = file.metadata().expect("its size").len();
        let opened = fs::OpenOptions::new().write(true).open(file.path());
        let opened = opened.expect("writable");
        opened.set_len(0).expect("emptied");
        if !is_empty {
            opened.set_len(length).expect("of full size");
        }
        let unfinished = fs::Permissions::from_mode(0o200);
        opened.set_permissions(unfinished).expect("unfinished");
        count += 1;
    }
    count
}

/// As a process leaves it that is killed.
#[test]
fn unfinished_shared_memory_holds_nobody_up() {
    for (suffix, is_empty) in [
        (".global_mgmt", true),
        (".global_mgmt", false),
        (".dynamic", true),
        (".dynamic", false),
        (".connection", true),
        (".connection", false),
        (".data", true),
        (".data", false),
    ] {
        let domain = TestDomain::new();
        let mut server = Process::start(&[], &domain, "serve", "early");
        server.hear().expect("a server");
        let mut holder = Process::start(&[], &domain, "hold", "early");
        holder.hear().expect("a holder");
        // The server first: it would clean up after the holder.
        server.kill();
        holder.kill();
        assert!(
            leave_unfinished(&domain, suffix, is_empty) > 0,
            "no {suffix}"
        );

        let mut server = Process::start(&[], &domain, "serve", "early");
        let said = server.hear();
        assert!(
            said.is_some_and(|s| s.starts_with("serving")),
            "{suffix}, empty: {is_empty}"
        );
        let client = Client::connect(&domain, "early", "test", PATIENCE).expect("attached");
        let mut reader = client.frames(1).expect("a reader");
        assert!(reader.next(PATIENCE).expect("readable").is_some());
        assert_eq!(cosplat_ipc::list_sessions(&domain).len(), 1);
    }
}
