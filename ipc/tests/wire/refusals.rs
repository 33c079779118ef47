//! Attaching that cannot work, and the sentences that say so.

use std::{
    fs::{self, DirBuilder, Permissions},
    os::unix::fs::{DirBuilderExt, PermissionsExt},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use cosplat_ipc::{
    Client, Domain, ServerPorts,
    client::ConnectError,
    list_sessions,
    schema::{FrameHeader, GaussianState, Hello, WIRE_VERSION, schema_hash},
    server::{CreateError, PoolPlan},
};
use iceoryx2::{
    port::{publisher::Publisher, update_connections::UpdateConnections},
    prelude::*,
};

use super::{
    child::Process,
    support::{COUNT, PATIENCE, TestDomain, serve},
};

const SOON: Duration = Duration::from_millis(20);

fn refusal(domain: &Domain, session: &str) -> ConnectError {
    match Client::connect(domain, session, "test", SOON) {
        Ok(_) => panic!("attached"),
        Err(error) => error,
    }
}

/// A node as a foreign program would make it, in a folder of its user alone.
pub fn foreign_node(domain: &Domain) -> Node<ipc::Service> {
    let mut folder = DirBuilder::new();
    folder.recursive(true).mode(0o700);
    folder.create(domain.root()).expect("a folder");
    NodeBuilder::new()
        .config(&domain.config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .expect("a node")
}

/// A server of which only the hello and the frames exist, until it is dropped.
pub struct Stranger {
    pub frame: Publisher<ipc::Service, [GaussianState], FrameHeader>,
    _events: [iceoryx2::service::port_factory::event::PortFactory<ipc::Service>; 2],
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Stranger {
    pub fn start(domain: &Domain, hello: Hello) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (ready, wait) = std::sync::mpsc::channel();
        let node = foreign_node(domain);
        let name = |stream: &str| {
            let name = format!("cosplat/other/v1/{stream}");
            ServiceName::new(&name).expect("a name")
        };
        let events = ["frame", "command"].map(|stream| {
            let event = node.service_builder(&name(stream)).event();
            event.create().expect("a service")
        });
        let frame = node
            .service_builder(&name("frame"))
            .publish_subscribe::<[GaussianState]>()
            .user_header::<FrameHeader>()
            .history_size(1)
            .subscriber_max_buffer_size(64)
            .create()
            .expect("a service")
            .publisher_builder()
            .initial_max_slice_len(COUNT)
            .create()
            .expect("a publisher");
        let thread = std::thread::spawn({
            let stop = stop.clone();
            move || {
                let service = node
                    .service_builder(&"cosplat/other/hello".try_into().expect("a name"))
                    .publish_subscribe::<Hello>()
                    .history_size(1)
                    .create()
                    .expect("a service");
                let publisher = service.publisher_builder().create().expect("a publisher");
                publisher.send_copy(hello).expect("sent");
                ready.send(()).expect("heard");
                // Whoever serves has to look after late joiners.
                while !stop.load(Ordering::Relaxed) {
                    publisher.update_connections().expect("updated");
                    std::thread::sleep(Duration::from_millis(5));
                }
            }
        });
        wait.recv().expect("a stranger");
        Self {
            frame,
            _events: events,
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Stranger {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

#[test]
fn a_second_server_is_refused_and_told_who_serves() {
    let domain = TestDomain::new();
    let mut first = Process::start(&[], &domain, "serve", "taken");
    first.hear().expect("a server");
    let plan = PoolPlan::default();
    let error = ServerPorts::create(&domain, "taken", &plan)
        .err()
        .expect("refused");
    let pid = first.id();
    assert!(
        matches!(&error, CreateError::AlreadyServed { session, pid: p } if session == "taken" && *p == pid),
        "{error}"
    );
    assert!(error.to_string().contains(&format!("process {pid}")));
    // The first one is none the worse.
    let client = Client::connect(&domain, "taken", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(1).expect("a reader");
    assert!(reader.next(PATIENCE).expect("readable").is_some());
    // Its place is free as soon as it is gone, however it went.
    first.kill();
    ServerPorts::create(&domain, "taken", &plan).expect("a server");
}

/// And which sessions are there.
#[test]
fn without_a_server_the_sentence_says_how_to_start_one() {
    let domain = TestDomain::new();
    let error = refusal(&domain, "nobody").to_string();
    assert!(
        error.contains("no server for session \"nobody\""),
        "{error}"
    );
    assert!(
        error.contains("cosplat serve SCENE.toml --session nobody"),
        "{error}"
    );
    assert!(error.contains("no session is served there"), "{error}");
    let ports = serve(&domain, "here");
    let _another = serve(&domain, "there");
    let pid = std::process::id();
    let error = refusal(&domain, "nobody").to_string();
    let others = format!("served there: \"here\" (process {pid}), \"there\" (process {pid})");
    assert!(error.contains(&others), "{error}");
    assert!(
        error.contains(&domain.root().display().to_string()),
        "{error}"
    );
    drop(ports);
    let names: Vec<String> = list_sessions(&domain).into_iter().map(|s| s.name).collect();
    assert_eq!(names, ["there"]);
    let error = refusal(&domain, "a/b").to_string();
    assert!(error.contains("\"a/b\" is not a session name"), "{error}");
}

#[test]
fn a_killed_server_counts_as_none() {
    let domain = TestDomain::new();
    let mut server = Process::start(&[], &domain, "serve", "gone");
    server.hear().expect("a server");
    let client = Client::connect(&domain, "gone", "test", PATIENCE).expect("attached");
    let _reader = client.frames(1).expect("a reader keeps the services");
    server.kill();
    let error = refusal(&domain, "gone");
    assert!(
        matches!(&error, ConnectError::NoServer { others, .. } if others.is_empty()),
        "{error}"
    );
}

#[test]
fn another_wire_version_is_said_with_both_versions() {
    let domain = TestDomain::new();
    let _stranger = Stranger::start(
        &domain,
        Hello {
            wire_version: WIRE_VERSION + 1,
            pid: 4711,
            ..Hello::of_this_program(5)
        },
    );
    let error = refusal(&domain, "other").to_string();
    assert!(
        error.contains("process 4711) with wire version 2"),
        "{error}"
    );
    assert!(
        error.contains("this is cosplat") && error.contains("with wire version 1"),
        "{error}"
    );
}

#[test]
fn another_layout_under_the_same_version_is_said() {
    let domain = TestDomain::new();
    let _stranger = Stranger::start(
        &domain,
        Hello {
            schema_hash: 0xabc,
            ..Hello::of_this_program(5)
        },
    );
    let error = refusal(&domain, "other").to_string();
    assert!(error.contains("0000000000000abc"), "{error}");
    assert!(
        error.contains(&format!("{:016x}", schema_hash())),
        "{error}"
    );
}

/// One that another release of iceoryx2 made.
#[test]
fn an_unreadable_service_is_said_with_its_release() {
    let domain = TestDomain::new();
    let _ports = serve(&domain, "old");
    // What another release leaves: files that ours does not understand, and a mark with its version.
    for file in fs::read_dir(domain.root().join("services"))
        .expect("services")
        .flatten()
    {
        // Files that may be written count as unfinished.
        let set = |mode| fs::set_permissions(file.path(), Permissions::from_mode(mode));
        let mode = file.metadata().expect("metadata").permissions().mode();
        set(0o600).expect("writable");
        fs::write(file.path(), "another format").expect("written");
        set(mode).expect("as before");
    }
    let mark = format!(
        "/dev/shm/{}{:040}_node.0_9_3.global_mgmt",
        domain.prefix(),
        0
    );
    fs::write(mark, "").expect("written");
    let error = refusal(&domain, "old");
    assert!(
        matches!(error, ConnectError::OtherTransport { .. }),
        "{error}"
    );
    let error = error.to_string();
    assert!(error.contains("iceoryx2 0.10.0"), "{error}");
    assert!(error.contains("traces of 0.9.3"), "{error}");
}
