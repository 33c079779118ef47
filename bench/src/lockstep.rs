//! `cosplat bench lockstep`: what a step in lock-step costs beside the step itself.
//!
//! A server on a scene of one small block and a bare iceoryx2 server that answers at once run as processes of their own.
//! One participant asks the two in turn, so that both meet the same load. Servers have one processor and the participant another:
//! left alone, the scheduler puts a bare pair on one processor and a pair with work on two, which compares processors, not programs.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use cosplat_ipc::{
    Domain,
    client::Participant,
    schema::{self as wire, Ack, StepDone, StepRequest},
};
use iceoryx2::{
    node::Node,
    port::{listener::Listener, notifier::Notifier},
    prelude::*,
    service::port_factory::{PortFactory as _, request_response::PortFactory},
};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::{
    child::Owned,
    machine::Run,
    page,
    process::{attach, this},
    quantiles::Quantiles,
};

const SESSION: &str = "bench";
const PATIENCE: Duration = Duration::from_secs(30);
const ECHO: &str = "cosplat/bench/echo";
/// What the table is called in a page.
const PART: &str = "cosplat bench lockstep";
/// Rounds that only warm caches.
const WARM_UP: u32 = 50;
/// Commands that go with each request.
const COMMANDS: usize = 4;
/// Steps of a request that asks for many.
const MANY: u32 = 100;

/// A small scene: a block of some cells that floats.
const SCENE: &str = r#"
version = 1
name = "a small block"
gravity = [0.0, 0.0, 0.0]
frame_rate = 60
dx = 0.05

[[objects]]
name = "block"
shape = { kind = "box", size = [0.1, 0.1, 0.1] }
material = "soft_rubber"
"#;

/// Measure the round trip of a step in lock-step beside a bare request and response, and steps per second.
#[derive(clap::Args)]
pub struct Args {
    /// Steps, and bare requests.
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(10..))]
    rounds: u32,
    /// Measure with this scene; without it, with one small block that floats.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    telling: page::Telling,
    /// Be the bare server; the measuring process starts it.
    #[arg(long, hide = true)]
    echo: bool,
}

/// Runs the command.
///
/// # Errors
/// When a process cannot be started or does not answer.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.echo {
        return echo(&Domain::from_env()?);
    }
    args.telling.check(PART)?;
    // Before the processors are shared out: the caption counts them.
    let machine = Run::here();
    let domain = Domain::named(&format!("step{}", std::process::id() % 100_000))?;
    let measured = measure(&domain, args.scene.as_deref(), args.rounds);
    domain.discard();
    let report = measured?;
    let here = (&machine, "three processes");
    args.telling.tell(PART, &report, &report.table(), here)
}

/// The first and the last processor that this process may use; `None` where there is but one.
fn processors() -> anyhow::Result<Option<[CpuSet; 2]>> {
    let allowed = sched_getaffinity(None)?;
    let mut numbers = (0..CpuSet::MAX_CPU).filter(|&number| allowed.is_set(number));
    let only = |number: usize| {
        let mut set = CpuSet::new();
        set.set(number);
        set
    };
    let first = numbers.next();
    Ok(first
        .zip(numbers.next_back())
        .map(|(a, b)| [only(a), only(b)]))
}

fn measure(domain: &Domain, scene: Option<&Path>, rounds: u32) -> anyhow::Result<Report> {
    let processors = processors()?;
    let folder = tempfile::tempdir()?;
    let scene = match scene {
        Some(path) => path.to_owned(),
        None => {
            let path = folder.path().join("scene.toml");
            std::fs::write(&path, SCENE)?;
            path
        }
    };
    // A child begins where its parent may run.
    let start = |arguments: &[&str]| -> anyhow::Result<Owned> {
        if let Some([_, servers]) = &processors {
            sched_setaffinity(None, servers)?;
        }
        let child = this(domain, arguments)?.spawn();
        let child = child.context("a process cannot be started")?;
        if let Some([participant, _]) = &processors {
            sched_setaffinity(None, participant)?;
        }
        Ok(Owned(child))
    };
    let scene = scene
        .to_str()
        .context("the path of the scene is not plain text")?;
    let _server = start(&[
        "serve",
        scene,
        "--session",
        SESSION,
        "--pace",
        "lockstep",
        "--participants",
        "bench",
        "--threads",
        "1",
    ])?;
    // First, as it makes the domain's folder with the right mode.
    let client = attach(domain, SESSION, PATIENCE)?;
    let _echo = start(&["lockstep", "--echo"])?;
    let bare = Bare::open(domain)?;
    let mut participant = client.participate("bench", PATIENCE)?;

    let gravity = wire::Command {
        kind: wire::COMMAND_SET_GRAVITY,
        ..wire::Command::default()
    };
    let commands = [gravity; COMMANDS];
    let (mut bare_us, mut step_us, mut whole_us) = (vec![], vec![], vec![]);
    for round in 0..rounds + WARM_UP {
        let begin = Instant::now();
        bare.round_trip(&commands)?;
        let bare_time = begin.elapsed();
        let begin = Instant::now();
        let stepped = participant.step(1, &commands)?;
        let whole = begin.elapsed();
        ensure!(
            stepped.is_complete() && stepped.refusal().is_none(),
            "a step was not made"
        );
        let own = Duration::from_nanos(stepped.done.step_ns);
        if round >= WARM_UP {
            bare_us.push(bare_time.as_secs_f64() * 1e6);
            step_us.push(whole.saturating_sub(own).as_secs_f64() * 1e6);
            whole_us.push(whole.as_secs_f64() * 1e6);
        }
    }
    Ok(Report {
        rounds,
        has_two_processors: processors.is_some(),
        commands: COMMANDS,
        bare_us: Quantiles::of(bare_us),
        lockstep_us: Quantiles::of(step_us),
        whole_us: Quantiles::of(whole_us),
        steps_per_second: rate(&mut participant, rounds, 1)?,
        steps_per_second_by_hundreds: rate(&mut participant, rounds.div_ceil(MANY), MANY)?,
    })
}

/// Steps per second of requests for `frames` steps each, without commands [1/s].
fn rate(participant: &mut Participant, requests: u32, frames: u32) -> anyhow::Result<f64> {
    let begin = Instant::now();
    for _ in 0..requests {
        ensure!(
            participant.step(frames, &[])?.is_complete(),
            "a step was not made"
        );
    }
    let steps = f64::from(requests) * f64::from(frames);
    Ok(steps / begin.elapsed().as_secs_f64())
}

type Echo = PortFactory<ipc::Service, [wire::Command], StepRequest, [Ack], StepDone>;

fn node(domain: &Domain) -> anyhow::Result<Node<ipc::Service>> {
    Ok(NodeBuilder::new()
        .config(&domain.config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()?)
}

/// The bare service, and the events of requests and of answers.
fn service(node: &Node<ipc::Service>) -> anyhow::Result<(Echo, [Event; 2])> {
    let service = node
        .service_builder(&ECHO.try_into()?)
        .request_response::<[wire::Command], [Ack]>()
        .request_user_header::<StepRequest>()
        .response_user_header::<StepDone>()
        .open_or_create()?;
    let event = |name: &str| -> anyhow::Result<Event> {
        let name = format!("{ECHO}/{name}");
        Ok(node
            .service_builder(&name.as_str().try_into()?)
            .event()
            .open_or_create()?)
    };
    Ok((service, [event("asked")?, event("answered")?]))
}

type Event = iceoryx2::service::port_factory::event::PortFactory<ipc::Service>;

/// Answers every request at once, as bare as can be.
fn echo(domain: &Domain) -> anyhow::Result<()> {
    let node = node(domain)?;
    let (service, [asked, answered]) = service(&node)?;
    let server = service
        .server_builder()
        .initial_max_slice_len(wire::MAX_COMMANDS)
        .create()?;
    let (listener, notifier) = (
        asked.listener_builder().create()?,
        answered.notifier_builder().create()?,
    );
    loop {
        while let Some(request) = server.receive()? {
            let mut response = request.loan_slice_uninit(request.payload().len())?;
            *response.user_header_mut() = StepDone::default();
            let acks: Vec<Ack> = request
                .payload()
                .iter()
                .map(|c| Ack::accepted(c.sequence, 1))
                .collect();
            response.write_from_slice(&acks).send()?;
            notifier.notify()?;
        }
        listener.timed_wait(|_| {}, Duration::from_millis(100))?;
    }
}

/// The client of the bare service.
struct Bare {
    client:
        iceoryx2::port::client::Client<ipc::Service, [wire::Command], StepRequest, [Ack], StepDone>,
    listener: Listener<ipc::Service>,
    notifier: Notifier<ipc::Service>,
}

impl Bare {
    fn open(domain: &Domain) -> anyhow::Result<Self> {
        let node = node(domain)?;
        let (service, [asked, answered]) = service(&node)?;
        let deadline = Instant::now() + PATIENCE;
        while service.dynamic_config().number_of_servers() == 0 {
            ensure!(Instant::now() < deadline, "the bare server did not start");
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(Self {
            client: service
                .client_builder()
                .initial_max_slice_len(wire::MAX_COMMANDS)
                .create()?,
            listener: answered.listener_builder().create()?,
            notifier: asked.notifier_builder().create()?,
        })
    }

    fn round_trip(&self, commands: &[wire::Command]) -> anyhow::Result<()> {
        let mut request = self.client.loan_slice_uninit(commands.len())?;
        *request.user_header_mut() = StepRequest::default();
        let pending = request.write_from_slice(commands).send()?;
        self.notifier.notify()?;
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(response) = pending.receive()? {
                ensure!(
                    response.payload().len() == commands.len(),
                    "an answer of another size"
                );
                return Ok(());
            }
            ensure!(Instant::now() < deadline, "the bare server does not answer");
            self.listener
                .timed_wait(|_| {}, Duration::from_millis(50))?;
        }
    }
}

#[derive(serde::Serialize)]
struct Report {
    rounds: u32,
    /// Servers have one processor, the participant another.
    has_two_processors: bool,
    /// In each request.
    commands: usize,
    bare_us: Quantiles,
    /// Less the step's own time.
    lockstep_us: Quantiles,
    whole_us: Quantiles,
    steps_per_second: f64,
    steps_per_second_by_hundreds: f64,
}

impl Report {
    fn table(&self) -> String {
        let Quantiles { p50, p99 } = self.bare_us;
        let processors = match self.has_two_processors {
            true => "servers on one processor, the participant on another",
            false => "all on one processor",
        };
        let row = |what: &str, q: Quantiles| {
            format!(
                "| {what} | {:.1} | {:.1} | {:.2} | {:.2} |",
                q.p50,
                q.p99,
                q.p50 / p50,
                q.p99 / p99
            )
        };
        [
            "| round trip | median [us] | 99 % [us] | over bare, median | over bare, 99 % |".to_owned(),
            "| --- | ---: | ---: | ---: | ---: |".to_owned(),
            row("bare iceoryx2 request and response", self.bare_us),
            row("lock-step, less the step's own time", self.lockstep_us),
            row("lock-step, whole", self.whole_us),
            String::new(),
            format!(
                "{} rounds of {} commands each, {}. Steps per second without commands: {:.0} one by one, {:.0} by {MANY} per request.",
                self.rounds,
                self.commands,
                processors,
                self.steps_per_second,
                self.steps_per_second_by_hundreds
            ),
        ]
        .join("\n")
    }
}
