//! Other processes: this test binary started again in a role.

use std::{
    io::{BufRead, BufReader, Write},
    path::PathBuf,
    process::{Child, ChildStdout, Command, Stdio},
    time::Duration,
};

use cosplat_ipc::{
    Client, Domain, ServerPorts,
    schema::{Ack, Status},
    server::{PoolPlan, Reply},
};

use super::support::{PATIENCE, TestDomain, send_frame, serve};

const ROLE: &str = "COSPLAT_WIRE_TEST_ROLE";
const ROOT: &str = "COSPLAT_WIRE_TEST_ROOT";
const PREFIX: &str = "COSPLAT_WIRE_TEST_PREFIX";
/// How many more files a child may open, if that is to be few.
pub const FREE_FILES: &str = "COSPLAT_WIRE_TEST_FREE_FILES";
const SESSION: &str = "COSPLAT_WIRE_TEST_SESSION";

/// A running child; killed with `kill -9` when dropped.
pub struct Process {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl Process {
    /// Starts a child that plays `role` in `session`, by way of the command `wrapper` if there is one.
    pub fn start(wrapper: &[&str], domain: &Domain, role: &str, session: &str) -> Self {
        let binary = std::env::current_exe().expect("this binary");
        let mut command = match wrapper {
            [] => Command::new(binary),
            [program, arguments @ ..] => {
                let mut command = Command::new(program);
                command.args(arguments).arg(binary);
                command
            }
        };
        let mut child = command
            .args([
                "--exact",
                "wire::child::a_child_plays_its_role",
                "--nocapture",
            ])
            .env(ROLE, role)
            .env(ROOT, domain.root())
            .env(PREFIX, domain.prefix())
            .env(SESSION, session)
            .stdout(Stdio::piped())
            .spawn()
            .expect("a child process");
        let output = BufReader::new(child.stdout.take().expect("its output"));
        Self { child, output }
    }

    /// The next line that the child says, without the leading `> `; `None` when it ended.
    pub fn hear(&mut self) -> Option<String> {
        loop {
            let mut line = String::new();
            if self.output.read_line(&mut line).expect("readable") == 0 {
                return None;
            }
            // The test harness may have begun a line of its own.
            if let Some((_, said)) = line.split_once("> ") {
                return Some(said.trim_end().into());
            }
        }
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    pub fn kill(&mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("reaped");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    // A parent that is gone ends the child.
    writeln!(out, "> {text}")
        .and_then(|()| out.flush())
        .expect("the parent reads");
}

#[test]
fn a_child_plays_its_role() {
    let (Ok(role), Ok(root), Ok(prefix), Ok(session)) = (
        std::env::var(ROLE),
        std::env::var(ROOT),
        std::env::var(PREFIX),
        std::env::var(SESSION),
    ) else {
        let domain = TestDomain::new();
        let mut child = Process::start(&[], &domain, "parrot", "a name");
        assert_eq!(child.hear().as_deref(), Some("a name"));
        return;
    };
    let domain = Domain::new(root, &prefix).expect("a domain");
    if let Ok(free) = std::env::var(FREE_FILES) {
        leave_files(free.parse().expect("a number"));
    }
    match role.as_str() {
        "parrot" => say(&session),
        "serve" => run_server(serve(&domain, &session)),
        "idle" => run_idle(serve(&domain, &session)),
        "start" => match ServerPorts::create(&domain, &session, &PoolPlan::default()) {
            Ok(_) => say("served"),
            Err(error) => say(&error.to_string()),
        },
        "look" => match look(&domain, &session) {
            Ok(step) => say(&format!("step {step}")),
            Err(error) => say(&error.to_string()),
        },
        "participate" => participate(&domain, &session),
        "order" => order(&domain, &session),
        "hold" => hold(&domain, &session),
        "cramped" => cramped(&domain, &session),
        other => panic!("no role {other:?}"),
    }
}

/// Serves until killed: a frame and a status every 2 ms, every command accepted.
fn run_server(mut ports: ServerPorts) {
    say(&format!("serving {}", ports.epoch()));
    for step in 1.. {
        send_frame(&ports, step);
        let status = Status {
            step,
            ..Status::default()
        };
        ports.update_status(&status).expect("published");
        ports.poll_commands(|asked| {
            let accept = |c: &cosplat_ipc::schema::Command| Ack::accepted(c.sequence, step);
            Reply::Now(asked.commands.iter().map(accept).collect())
        });
        ports.maintain();
        ports.wait(Duration::from_millis(2));
    }
}

/// Takes part in lock-step and asks for a step that never comes.
fn participate(domain: &Domain, session: &str) {
    let client = Client::connect(domain, session, "child", PATIENCE).expect("attached");
    let mut robot = client.participate("robot", PATIENCE).expect("taken in");
    robot.step(1, &[]).expect("a step");
}

/// Gives an order and stays.
fn order(domain: &Domain, session: &str) {
    let client = Client::connect(domain, session, "child", PATIENCE).expect("attached");
    let mut sender = client.commands().expect("a sender");
    let order = cosplat_ipc::schema::Command::default();
    sender.send(&[order], PATIENCE).expect("an answer");
    std::thread::sleep(10 * PATIENCE);
}

/// Lets this process open `free` more files and no others.
fn leave_files(free: u64) {
    let resource = rustix::process::Resource::Nofile;
    // Numbers are limited; those that are open may have gaps.
    let is_open = |number: &u64| {
        PathBuf::from(format!("/proc/self/fd/{number}"))
            .symlink_metadata()
            .is_ok()
    };
    let last = (0..).filter(|number| !is_open(number)).nth(free as usize);
    let limit = rustix::process::Rlimit {
        current: last,
        ..rustix::process::getrlimit(resource)
    };
    rustix::process::setrlimit(resource, limit).expect("a limit");
}

/// Serves until killed as a paused server does: one frame, and then nothing.
fn run_idle(ports: ServerPorts) {
    send_frame(&ports, 1);
    ports.update_status(&Status::default()).expect("published");
    say("serving");
    loop {
        ports.maintain();
        ports.wait(Duration::from_millis(20));
    }
}

/// The step of the newest frame.
fn look(domain: &Domain, session: &str) -> Result<u64, Box<dyn std::error::Error>> {
    let client = Client::connect(domain, session, "looker", Duration::from_millis(50))?;
    let mut reader = client.frames(1)?;
    // Not in a hurry: the frame comes with the next turn of the server's monitor, and then the wake-ups are made.
    let frame = loop {
        match reader.next(Duration::from_millis(100))? {
            Some(frame) => break frame,
            None => continue,
        }
    };
    let step = frame.header().step;
    drop(frame);
    reader.next(Duration::from_millis(1))?;
    Ok(step)
}

/// Takes frames, keeps one and stops reading: its queue fills behind it.
fn hold(domain: &Domain, session: &str) {
    let client = Client::connect(domain, session, "holder", PATIENCE).expect("attached");
    let mut reader = client.frames(64).expect("a reader");
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    say(&format!("holding {}", frame.header().step));
    std::thread::sleep(10 * PATIENCE);
    drop(frame);
}

/// Tries two sessions in little shared memory: one that does not fit, one that just does.
fn cramped(domain: &Domain, session: &str) {
    let plan = |gaussian_count| PoolPlan {
        gaussian_count,
        ..PoolPlan::default()
    };
    match ServerPorts::create(domain, session, &plan(1 << 20)) {
        Ok(_) => say("served"),
        Err(error) => say(&error.to_string()),
    }
    let count = 1 << 14;
    let ports = ServerPorts::create(domain, session, &plan(count)).expect("it fits");
    say(&format!("{} slots", ports.frame_slots()));
    let client = Client::connect(domain, session, "viewer", PATIENCE).expect("attached");
    let mut reader = client.frames(2).expect("a reader");
    let mut seen = 0;
    for step in 0..100 {
        let mut loan = ports.loan_frame(count).expect("memory");
        loan.gaussians_mut().fill(bytemuck::Zeroable::zeroed());
        let header = cosplat_ipc::schema::FrameHeader {
            step,
            ..Default::default()
        };
        loan.send(&header).expect("sent");
        seen += u64::from(reader.next(PATIENCE).expect("readable").is_some());
    }
    say(&format!("{seen} frames"));
}
