//! Limits of the machine and of a session, and the sentences that say so.

use cosplat_ipc::{Client, LimitReached, client::ConnectError};

use super::{
    child::{FREE_FILES, Process},
    support::{PATIENCE, TestDomain, send_frame, serve},
};

const REMEDY: &str = "raise the limit with `ulimit -n ";

/// What a child says that plays `role` and may open `files` files more than it has at its start.
fn with_files(files: u64, domain: &TestDomain, role: &str) -> String {
    let setting = format!("{FREE_FILES}={files}");
    let mut child = Process::start(&["env", &setting], domain, role, "narrow");
    child.hear().expect("a sentence")
}

#[test]
fn too_few_descriptors_are_said_with_the_limit_and_the_remedy() {
    let domain = TestDomain::new();
    let refusal = with_files(100, &domain, "start");
    assert!(refusal.contains("expected room for 240 more"), "{refusal}");
    assert!(refusal.contains(REMEDY), "{refusal}");

    let ports = serve(&domain, "narrow");
    send_frame(&ports, 1);
    // A client that watches frames has some 20 files open: every step of attaching fails once.
    for files in 2..22 {
        let said = with_files(files, &domain, "look");
        let is_said = said.contains("expected room for 16 more") && said.contains(REMEDY);
        assert!(
            is_said || (files > 12 && said == "step 1"),
            "{files}: {said}"
        );
    }
    assert_eq!(with_files(40, &domain, "look"), "step 1");
}

#[test]
fn a_full_session_says_how_many_places_it_has() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "full");
    send_frame(&ports, 1);
    let client = Client::connect(&domain, "full", "test", PATIENCE).expect("attached");
    let mut readers: Vec<_> = (0..32)
        .map(|_| client.frames(1).expect("a reader"))
        .collect();
    let places = |error: ConnectError| match error {
        ConnectError::Limit {
            limit: LimitReached::Places { what, max },
            ..
        } => (what, max),
        other => panic!("{other}"),
    };
    let refused = client.frames(1).err().expect("refused");
    assert!(
        refused
            .to_string()
            .contains("all 32 places for readers are taken"),
        "{refused}"
    );
    assert_eq!(places(refused), ("readers", 32));
    let senders: Vec<_> = (0..40)
        .map(|_| client.commands().expect("a sender"))
        .collect();
    let refused = client.commands().err().expect("refused");
    assert_eq!(places(refused), ("command senders", 40));
    // Those who have a place are none the worse, and a place that is left is free.
    assert!(readers[31].next(PATIENCE).expect("readable").is_some());
    drop((readers.pop(), senders));
    client.frames(1).expect("a reader");
    client.commands().expect("a sender");
}
