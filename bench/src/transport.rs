//! `cosplat bench transport`: what a frame costs on its way to another process.
//!
//! Two processes take turns on every path in every round, so that all paths meet the same load. Times run from
//! just before the send (for copies: before the copy) until the other process has the whole message.

mod publish;

use std::{
    hint::black_box,
    io::{BufRead, BufReader, Read, Write},
    os::unix::net::{UnixListener, UnixStream},
    process::Command,
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use cosplat_console::say;
use cosplat_ipc::{
    Client, Domain, ServerPorts,
    client::FrameReader,
    monotonic_ns,
    schema::{FrameHeader, GaussianState},
    server::PoolPlan,
};
use iceoryx2::{
    port::{listener::Listener, notifier::Notifier, publisher::Publisher, subscriber::Subscriber},
    prelude::*,
};

use crate::{child::Owned, quantiles::Quantiles};
use publish::PublishReport;

const SESSION: &str = "bench";
const PATIENCE: Duration = Duration::from_secs(20);
/// Gaussians per frame: 64 B, 1 MiB, 16 MiB.
const COUNTS: [usize; 3] = [1, 1 << 14, 1 << 18];
const LARGEST: usize = COUNTS[2];
/// Rounds that only warm caches and page tables.
const WARM_UP: usize = 10;

/// Measure latency and bandwidth of frames on their way to another process.
#[derive(clap::Args)]
pub struct Args {
    /// Messages per path and size.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..))]
    rounds: u32,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Be the receiving process; the sending one starts it.
    #[arg(long, hide = true)]
    receiver: bool,
}

/// How a message travels.
#[derive(Clone, Copy, PartialEq)]
enum Path {
    /// Written into the loan before the clock starts.
    InPlace(usize),
    /// A finished buffer is copied into the loan.
    Memcpy(usize),
    /// Through a Unix stream socket.
    Socket(usize),
    /// 64 bytes over bare iceoryx2.
    Ping,
}

/// One round, with the index of each path; both processes walk through it in step. The order changes from
/// round to round, because every path leaves the caches to the next in its own way.
fn round(number: usize) -> impl Iterator<Item = (usize, Path)> {
    let sizes = COUNTS.into_iter().flat_map(|count| {
        [
            Path::InPlace(count),
            Path::Memcpy(count),
            Path::Socket(count),
        ]
    });
    let paths: Vec<Path> = sizes.chain([Path::Ping]).collect();
    // Steps without a common divisor with the number of paths reach each of them once.
    let stride = [1, 3, 7, 9][number % 4];
    (0..PATHS)
        .map(move |i| (i * stride + number) % PATHS)
        .map(move |i| (i, paths[i]))
}

const PATHS: usize = 3 * COUNTS.len() + 1;
const _: () = assert!(PATHS == 10, "choose other strides");

/// Runs the command.
///
/// # Errors
/// When shared memory is short or the other process fails.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let rounds = args.rounds as usize + WARM_UP;
    if args.receiver {
        return receive(&Domain::from_env()?, rounds);
    }
    let domain = Domain::named(&format!("bench{}", std::process::id()))?;
    let outcome = send(&domain, args.rounds, rounds);
    domain.discard();
    let mut report = outcome?;
    report.publish = Some(publish::measure(args.rounds as usize)?);
    if args.json {
        say!("{}", serde_json::to_string(&report)?)?;
    } else {
        report.print()?;
    }
    Ok(())
}

fn send(domain: &Domain, counted: u32, rounds: usize) -> anyhow::Result<Report> {
    let plan = PoolPlan {
        gaussian_count: LARGEST,
        frame_slots: Some(4),
        ..PoolPlan::default()
    };
    let ports = ServerPorts::create(domain, SESSION, &plan)?;
    let ping = PingSender::create(domain)?;
    let (write, copy) = bandwidth(&ports)?;

    let listener = UnixListener::bind(domain.root().join("bench.sock"))?;
    let _receiver = Owned(
        Command::new(std::env::current_exe()?)
            .args(["transport", "--receiver", "--rounds"])
            .arg(counted.to_string())
            .env("COSPLAT_DOMAIN", domain.root())
            .spawn()
            .context("the receiving process cannot be started")?,
    );
    let (control, _) = listener.accept()?;
    control.set_read_timeout(Some(PATIENCE))?;
    let mut control = BufReader::new(control);
    let (mut data, _) = listener.accept()?;

    let source = vec![GaussianState::default(); LARGEST];
    let bytes = vec![7_u8; LARGEST * size_of::<GaussianState>()];
    let mut step = 0;
    for number in 0..rounds {
        for (_, path) in round(number) {
            control.read_exact(&mut [0]).context("the receiver ended")?;
            // It has said that it will wait, not that it waits.
            std::thread::sleep(Duration::from_micros(200));
            step += 1;
            let header = |start| FrameHeader {
                step,
                state_hash: start,
                ..FrameHeader::default()
            };
            match path {
                Path::InPlace(count) => {
                    let mut loan = ports.loan_frame_within(count, PATIENCE)?;
                    fill(loan.gaussians_mut(), step);
                    loan.send(&header(monotonic_ns()))?;
                }
                Path::Memcpy(count) => {
                    let start = monotonic_ns();
                    let mut loan = ports.loan_frame_within(count, PATIENCE)?;
                    loan.gaussians_mut().copy_from_slice(&source[..count]);
                    loan.send(&header(start))?;
                }
                Path::Socket(count) => {
                    data.write_all(&monotonic_ns().to_le_bytes())?;
                    data.write_all(&bytes[..count * size_of::<GaussianState>()])?;
                }
                Path::Ping => ping.send()?,
            }
        }
    }
    let mut line = String::new();
    control.read_line(&mut line)?;
    let latencies: Vec<Vec<f64>> = serde_json::from_str(&line).context("the receiver's report")?;
    ensure!(
        latencies.len() == PATHS,
        "{} paths reported",
        latencies.len()
    );
    Ok(Report::new(counted, &latencies, write, copy))
}

/// Bytes per second of writing Gaussians in place, and of copying finished ones, on one core [GB/s].
fn bandwidth(ports: &ServerPorts) -> anyhow::Result<(f64, f64)> {
    let source = vec![GaussianState::default(); LARGEST];
    let (mut write, mut copy) = (Vec::new(), Vec::new());
    for step in 0..40 {
        let mut loan = ports.loan_frame(LARGEST)?;
        let start = Instant::now();
        fill(black_box(loan.gaussians_mut()), step);
        write.push(start.elapsed().as_secs_f64());
        let start = Instant::now();
        black_box(loan.gaussians_mut()).copy_from_slice(&source);
        copy.push(start.elapsed().as_secs_f64());
    }
    let rate = |seconds: Vec<f64>| {
        (LARGEST * size_of::<GaussianState>()) as f64 / 1e9 / Quantiles::of(seconds).p50
    };
    Ok((rate(write), rate(copy)))
}

/// Writes every byte of a frame.
pub fn fill(gaussians: &mut [GaussianState], step: u64) {
    for (i, gaussian) in gaussians.iter_mut().enumerate() {
        let x = (i as u64 + step) as f32;
        *gaussian = GaussianState {
            position: [x, 2.0 * x, 3.0 * x],
            color: [1, 2, 3, 255],
            covariance: [x, 0.0, 0.0, x, 0.0, x],
            object: 1,
            index: i as u32,
            rotation: [0.0, 0.0, 0.0, 1.0],
        };
    }
}

fn receive(domain: &Domain, rounds: usize) -> anyhow::Result<()> {
    let socket = domain.root().join("bench.sock");
    let mut control = UnixStream::connect(&socket)?;
    let mut data = UnixStream::connect(&socket)?;
    data.set_read_timeout(Some(PATIENCE))?;
    let client = Client::connect(domain, SESSION, "bench", PATIENCE)?;
    let mut frames = client.frames(1)?;
    let ping = PingReceiver::open(domain)?;
    let mut buffer = vec![0; LARGEST * size_of::<GaussianState>()];
    let mut latencies = vec![Vec::new(); PATHS];
    for number in 0..rounds {
        for (index, path) in round(number) {
            control.write_all(&[1])?;
            let (start, end) = match path {
                Path::InPlace(count) | Path::Memcpy(count) => take_frame(&mut frames, count)?,
                Path::Socket(count) => {
                    let mut start = [0; 8];
                    data.read_exact(&mut start)?;
                    data.read_exact(&mut buffer[..count * size_of::<GaussianState>()])?;
                    (u64::from_le_bytes(start), monotonic_ns())
                }
                Path::Ping => ping.take()?,
            };
            if number >= WARM_UP {
                latencies[index].push(end.saturating_sub(start) as f64 / 1e3);
            }
        }
    }
    writeln!(control, "{}", serde_json::to_string(&latencies)?)?;
    Ok(())
}

/// When a frame was sent and when it was here [ns].
fn take_frame(frames: &mut FrameReader, count: usize) -> anyhow::Result<(u64, u64)> {
    let frame = frames.next(PATIENCE)?.context("no frame came")?;
    let end = monotonic_ns();
    ensure!(frame.gaussians().len() == count, "a frame of another size");
    black_box((frame.gaussians().first(), frame.gaussians().last()));
    Ok((frame.header().state_hash, end))
}

const PING: &str = "cosplat/bench/ping";

fn node(domain: &Domain) -> anyhow::Result<Node<ipc::Service>> {
    Ok(NodeBuilder::new()
        .config(&domain.config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()?)
}

struct PingSender {
    publisher: Publisher<ipc::Service, [u64; 8], ()>,
    notifier: Notifier<ipc::Service>,
}

impl PingSender {
    fn create(domain: &Domain) -> anyhow::Result<Self> {
        let node = node(domain)?;
        let name = PING.try_into()?;
        let service = node.service_builder(&name).publish_subscribe::<[u64; 8]>();
        let event = node.service_builder(&name).event();
        Ok(Self {
            publisher: service.create()?.publisher_builder().create()?,
            notifier: event.create()?.notifier_builder().create()?,
        })
    }

    fn send(&self) -> anyhow::Result<()> {
        // The loan is outside the clock, as for frames written in place.
        let loan = self.publisher.loan_uninit()?;
        loan.write_payload([monotonic_ns(); 8]).send()?;
        self.notifier.notify()?;
        Ok(())
    }
}

struct PingReceiver {
    subscriber: Subscriber<ipc::Service, [u64; 8], ()>,
    listener: Listener<ipc::Service>,
}

impl PingReceiver {
    fn open(domain: &Domain) -> anyhow::Result<Self> {
        let node = node(domain)?;
        let name = PING.try_into()?;
        let service = node.service_builder(&name).publish_subscribe::<[u64; 8]>();
        let event = node.service_builder(&name).event();
        Ok(Self {
            subscriber: service.open()?.subscriber_builder().create()?,
            listener: event.open()?.listener_builder().create()?,
        })
    }

    fn take(&self) -> anyhow::Result<(u64, u64)> {
        let start = Instant::now();
        loop {
            if let Some(sample) = self.subscriber.receive()? {
                let end = monotonic_ns();
                return Ok((sample.payload()[0], end));
            }
            ensure!(start.elapsed() < PATIENCE, "no ping came");
            self.listener
                .timed_wait(|_| {}, Duration::from_millis(20))?;
        }
    }
}

#[derive(serde::Serialize)]
struct SizeReport {
    bytes: usize,
    in_place_us: Quantiles,
    memcpy_us: Quantiles,
    unix_socket_us: Quantiles,
    /// Ratios of medians.
    memcpy_over_in_place: f64,
    unix_socket_over_in_place: f64,
    in_place_over_ping: f64,
}

#[derive(serde::Serialize)]
struct Report {
    rounds: u32,
    sizes: Vec<SizeReport>,
    ping_64_bytes_us: Quantiles,
    largest_over_smallest_in_place: f64,
    write_in_place_gb_per_s: f64,
    copy_into_loan_gb_per_s: f64,
    publish: Option<PublishReport>,
}

impl Report {
    fn new(rounds: u32, latencies: &[Vec<f64>], write: f64, copy: f64) -> Self {
        let latency: Vec<Quantiles> = latencies.iter().cloned().map(Quantiles::of).collect();
        let ping = latency[PATHS - 1];
        let sizes: Vec<SizeReport> = COUNTS
            .iter()
            .zip(latency.chunks(3))
            .map(|(count, paths)| SizeReport {
                bytes: count * size_of::<GaussianState>(),
                in_place_us: paths[0],
                memcpy_us: paths[1],
                unix_socket_us: paths[2],
                memcpy_over_in_place: paths[1].p50 / paths[0].p50,
                unix_socket_over_in_place: paths[2].p50 / paths[0].p50,
                in_place_over_ping: paths[0].p50 / ping.p50,
            })
            .collect();
        Self {
            rounds,
            ping_64_bytes_us: ping,
            largest_over_smallest_in_place: sizes[COUNTS.len() - 1].in_place_us.p50
                / sizes[0].in_place_us.p50,
            sizes,
            write_in_place_gb_per_s: write,
            copy_into_loan_gb_per_s: copy,
            publish: None,
        }
    }

    fn print(&self) -> anyhow::Result<()> {
        say!(
            "one way to another process, median / 99 % of {} [us]",
            self.rounds
        )?;
        say!(
            "{:>10} {:>18} {:>25} {:>25}",
            "bytes",
            "in place",
            "memcpy (ratio)",
            "Unix socket (ratio)"
        )?;
        let pair = |l: Quantiles| format!("{:.1} / {:.1}", l.p50, l.p99);
        for size in &self.sizes {
            say!(
                "{:>10} {:>18} {:>25} {:>25}",
                size.bytes,
                pair(size.in_place_us),
                format!(
                    "{} ({:.1}x)",
                    pair(size.memcpy_us),
                    size.memcpy_over_in_place
                ),
                format!(
                    "{} ({:.1}x)",
                    pair(size.unix_socket_us),
                    size.unix_socket_over_in_place
                ),
            )?;
        }
        say!(
            "ping of 64 bytes over bare iceoryx2: {}",
            pair(self.ping_64_bytes_us)
        )?;
        say!(
            "in place, largest over smallest: {:.2}x",
            self.largest_over_smallest_in_place
        )?;
        say!(
            "one core writes {:.1} GB/s of Gaussians in place, and copies {:.1} GB/s",
            self.write_in_place_gb_per_s,
            self.copy_into_loan_gb_per_s
        )?;
        match &self.publish {
            Some(publish) => publish.print(),
            None => Ok(()),
        }
    }
}
