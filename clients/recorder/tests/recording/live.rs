//! The recorder attached to a serving process: nothing missed, nothing unsaid, killed and restarted at will.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use cosplat_ipc::schema::{FrameHeader, SERVER_STOPPING, Status};
use cosplat_ipc::server::{PoolPlan, SceneBlocks};
use cosplat_ipc::{Domain, ServerPorts};
use cosplat_recorder::RecordingError;
use cosplat_recorder::client::{RecordError, RecordOptions, Summary, record};
use cosplat_recorder::messages::{GapReason, GapRecord};
use cosplat_recorder::parts::Split;
use cosplat_recorder::reader::{Event, Recording};
use cosplat_recorder::writer::WriterOptions;

use super::synthetic::{Run, SCENE_SOURCE};

/// Long enough for a loaded machine; only a hang reaches it.
const PATIENCE: Duration = Duration::from_secs(30);
const SESSION: &str = "live";

/// A domain that no other test uses; its files go with it.
pub struct TestDomain {
    pub name: String,
    pub domain: Domain,
}

impl TestDomain {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("r{}-{number}", std::process::id());
        let domain = Domain::named(&name).unwrap();
        Self { name, domain }
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        self.domain.discard();
    }
}

/// A server without a simulation: it publishes the frames of a made-up run.
pub struct Server {
    ports: ServerPorts,
    pub run: Run,
}

impl Server {
    pub fn start(domain: &Domain, steps: u64, gaussians: usize) -> Self {
        let mut run = Run {
            steps,
            gaussians,
            epoch: 0,
        };
        let (rest, sh, objects) = (run.rest(), run.sh(), run.object_table());
        let scene = SceneBlocks {
            header: run.scene_header(),
            gaussians: &rest,
            sh: &sh,
            objects: &objects,
            features: &[],
            source: SCENE_SOURCE,
            files: &[],
        };
        let mut ports = ServerPorts::create(domain, SESSION, &PoolPlan::new(&scene)).unwrap();
        ports.publish_scene(&scene).unwrap();
        run.epoch = ports.epoch();
        Self { ports, run }
    }

    /// Publishes one step: commands, objects, status, and last the frame.
    pub fn publish(&mut self, step: u64) {
        if let Some(command) = self.run.command(step) {
            self.ports.publish_journal(step, &[command]).unwrap();
        }
        let (header, objects) = self.run.objects(step);
        self.ports.publish_objects(&header, &objects).unwrap();
        let status = Status {
            step,
            ..Default::default()
        };
        self.ports.update_status(&status).unwrap();
        // Like a server that waits for slow recorders rather than skip a frame.
        let mut loan = self
            .ports
            .loan_frame_within(self.run.gaussians, PATIENCE)
            .unwrap();
        loan.gaussians_mut().copy_from_slice(&self.run.frame(step));
        loan.send(&self.run.header(step)).unwrap();
        self.ports.maintain();
    }

    /// Publishes the first step, which is kept for late joiners, and the others once a recorder is there, never so
    /// far ahead of it that its queue of 64 frames overflows.
    pub fn publish_all(
        &mut self,
        recording: &Path,
        steps: impl Iterator<Item = u64>,
        recorded: &AtomicU64,
    ) {
        self.publish(0);
        wait_for("the recording to begin", || recording.exists());
        for (ahead_of, step) in (1..).zip(steps) {
            wait_for("the recorder to catch up", || {
                ahead_of < recorded.load(Ordering::Relaxed) + 32
            });
            self.publish(step);
        }
    }
}

pub fn wait_for(what: &str, mut is_there: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_there() {
        assert!(start.elapsed() < PATIENCE, "waited too long for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

pub fn options(domain: &Domain, output: &Path) -> RecordOptions {
    RecordOptions {
        domain: domain.clone(),
        session: SESSION.into(),
        output: output.into(),
        writer: WriterOptions {
            chunk_bytes: 200_000,
            ..Default::default()
        },
        checkpoint_every: None,
        split: Split::default(),
        wait: PATIENCE,
        duration: None,
    }
}

/// Ends the recorder when a test fails, so that the failure is shown.
struct StopOnDrop<'a>(&'a AtomicBool);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// Records in a thread of this process while `serve` publishes; it sees how many frames are recorded.
pub fn record_while(
    options: &RecordOptions,
    stop: &AtomicBool,
    serve: impl FnOnce(&AtomicU64),
) -> Summary {
    let recorded = AtomicU64::new(0);
    std::thread::scope(|scope| {
        // Said at once: the server waits for a recorder that may have given up.
        let recorder = scope.spawn(|| {
            record(options, stop, |now| {
                recorded.store(now.frames_recorded, Ordering::Relaxed)
            })
            .inspect_err(|error| eprintln!("recorder: {error}"))
        });
        let _stop = StopOnDrop(stop);
        serve(&recorded);
        recorder.join().unwrap().unwrap()
    })
}

#[test]
fn every_step_is_recorded_with_its_commands_and_objects() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut server = Server::start(&domain.domain, 1500, 100);
    let run = server.run;
    let stop = AtomicBool::new(false);
    let summary = record_while(&options(&domain.domain, &path), &stop, |recorded| {
        server.publish_all(&path, 1..run.steps, recorded);
    });
    assert_eq!(summary.frames_recorded, run.steps);
    assert_eq!(
        (summary.first_step, summary.last_step),
        (Some(0), Some(run.steps - 1))
    );
    assert_eq!(
        (summary.gaps, summary.missed_steps, summary.journal_missed),
        (0, 0, 0)
    );
    assert_eq!(summary.server_runs, 1);
    let latency = summary.latency_us;
    assert!(
        latency.p50.unwrap() > 0.0 && latency.p99 >= latency.p50,
        "{latency:?}"
    );

    assert_eq!(run.checked_steps(&path), (0..run.steps).collect::<Vec<_>>());
    let (mut objects, mut journal) = (Vec::new(), Vec::new());
    let mut frames_seen = 0;
    for event in Recording::open(&path).unwrap() {
        match event.unwrap() {
            Event::Frame(frame) => frames_seen = frame.header.step + 1,
            Event::Objects(header, states) => objects.push((header, states)),
            Event::Journal(entry) => {
                assert_eq!(
                    entry.applied.step, frames_seen,
                    "commands precede the frame that shows them"
                );
                assert_eq!(entry.epoch, Some(run.epoch));
                assert_eq!(entry.index, Some(journal.len() as u64));
                journal.push(entry.applied);
            }
            Event::Gap(gap) => panic!("{gap:?}"),
            _ => {}
        }
    }
    assert_eq!(
        journal,
        (0..run.steps)
            .filter_map(|s| run.command(s))
            .collect::<Vec<_>>()
    );
    assert_eq!(summary.journal_entries, journal.len() as u64);
    assert_eq!(
        objects,
        (0..run.steps).map(|s| run.objects(s)).collect::<Vec<_>>()
    );
}

#[test]
fn steps_that_the_server_skips_are_recorded_as_a_gap() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut server = Server::start(&domain.domain, 20, 50);
    let run = server.run;
    let summary = record_while(
        &options(&domain.domain, &path),
        &AtomicBool::new(false),
        |recorded| {
            server.publish_all(&path, (1..10).chain(15..20), recorded);
        },
    );
    assert_eq!((summary.gaps, summary.missed_steps), (1, 5));
    assert_eq!(
        run.checked_steps(&path),
        (0..10).chain(15..20).collect::<Vec<_>>()
    );
    let gaps: Vec<_> = gaps_of(&path)
        .iter()
        .map(|g| (g.from_step, g.to_step, g.reason))
        .collect();
    assert_eq!(gaps, [(10, Some(14), GapReason::Missed)]);
}

#[test]
fn a_server_started_anew_is_followed_into_the_same_file() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut first = Server::start(&domain.domain, u64::MAX, 50);
    let stop = AtomicBool::new(false);
    let mut epochs = Vec::new();
    let summary = record_while(&options(&domain.domain, &path), &stop, |recorded| {
        first.publish_all(&path, 1..100, recorded);
        epochs.push(first.run.epoch);
        drop(first);
        let mut second = Server::start(&domain.domain, 60, 80);
        epochs.push(second.run.epoch);
        (0..60).for_each(|step| second.publish(step));
        // Held until the recorder has read the scene and ended at the last frame.
        wait_for("the recorder to end", || mcap_is_finished(&path));
    });
    assert_eq!(summary.frames_recorded, 160);
    assert_eq!((summary.gaps, summary.server_runs), (1, 2));

    let (mut steps, mut scenes, mut gaps) = (Vec::new(), Vec::new(), Vec::new());
    for event in Recording::open(&path).unwrap() {
        match event.unwrap() {
            Event::Frame(frame) => steps.push((frame.header.epoch, frame.header.step)),
            Event::Metadata { values, .. } => {
                scenes.push((values["epoch"].clone(), values["gaussian_count"].clone()));
            }
            Event::Gap(gap) => gaps.push((gap.epoch.0, gap.from_step, gap.to_step, gap.reason)),
            _ => {}
        }
    }
    let expected = (0..100)
        .map(|s| (epochs[0], s))
        .chain((0..60).map(|s| (epochs[1], s)));
    assert_eq!(steps, expected.collect::<Vec<_>>());
    let scene = |epoch: u64, count: &str| (format!("{epoch:016x}"), count.to_owned());
    assert_eq!(scenes, [scene(epochs[0], "50"), scene(epochs[1], "80")]);
    assert_eq!(gaps, [(epochs[0], 100, None, GapReason::ServerRestarted)]);
}

/// Names domain and first step to the child process that serves.
const SERVER_CHILD: &str = "COSPLAT_TEST_SERVER";

/// The first one was killed.
#[test]
fn a_restarted_server_is_followed_into_the_same_file() {
    const NAME: &str = "recording::live::a_restarted_server_is_followed_into_the_same_file";
    if let Ok(domain) = std::env::var(SERVER_CHILD) {
        serve_as_child(&Domain::named(&domain).unwrap());
    }
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let serve = || {
        Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "--nocapture", NAME])
            .env(SERVER_CHILD, &domain.name)
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    };
    let options = options(&domain.domain, &path);
    let stop = AtomicBool::new(false);
    // Runs of the server, and frames of the present one.
    let (runs, frames) = (AtomicU32::new(0), AtomicU32::new(0));
    let summary = std::thread::scope(|scope| {
        let recorder = scope.spawn(|| {
            record(&options, &stop, |now| {
                if runs.swap(now.server_runs as u32, Ordering::Relaxed) != now.server_runs as u32 {
                    frames.store(0, Ordering::Relaxed);
                }
                frames.fetch_add(1, Ordering::Relaxed);
            })
        });
        let _stop = StopOnDrop(&stop);
        for run in 1..=3 {
            let mut server = serve();
            wait_for("frames of the new server", || {
                runs.load(Ordering::Relaxed) == run && frames.load(Ordering::Relaxed) >= 40
            });
            server.kill().unwrap();
            server.wait().unwrap();
        }
        stop.store(true, Ordering::Relaxed);
        recorder.join().unwrap().unwrap()
    });
    let (mut runs, mut gaps) = (
        std::collections::BTreeMap::<u64, Vec<u64>>::new(),
        Vec::new(),
    );
    let mut metadata = 0;
    for event in Recording::open(&path).unwrap() {
        match event.unwrap() {
            Event::Frame(frame) => {
                runs.entry(frame.header.epoch)
                    .or_default()
                    .push(frame.header.step);
            }
            Event::Gap(gap) => gaps.push(gap),
            Event::Metadata { .. } => metadata += 1,
            _ => {}
        }
    }
    assert_eq!((runs.len(), metadata, summary.server_runs), (3, 3, 3));
    let restarts = gaps
        .iter()
        .filter(|g| g.reason == GapReason::ServerRestarted);
    assert_eq!(restarts.count(), 2);
    assert_eq!(summary.gaps, gaps.len() as u64);
    for (epoch, steps) in runs {
        assert!(steps.len() >= 40);
        let told: Vec<_> = gaps
            .iter()
            .filter(|g| g.epoch.0 == epoch)
            .cloned()
            .collect();
        assert_holes_are_told(&steps, &told);
    }
}

/// A loaded machine may lose frames while the recorder reads the scene; then the recording says which.
pub fn assert_holes_are_told(steps: &[u64], gaps: &[GapRecord]) {
    let holes: Vec<_> = steps
        .windows(2)
        .filter(|w| w[1] != w[0] + 1)
        .map(|w| (w[0] + 1, Some(w[1] - 1)))
        .collect();
    let told: Vec<_> = gaps
        .iter()
        .filter(|g| g.reason == GapReason::Missed)
        .map(|g| (g.from_step, g.to_step))
        .collect();
    assert_eq!(holes, told);
}

pub fn gaps_of(recording: &Path) -> Vec<GapRecord> {
    Recording::open(recording)
        .unwrap()
        .filter_map(|event| match event.unwrap() {
            Event::Gap(gap) => Some(gap),
            _ => None,
        })
        .collect()
}

/// Publishes until it is killed.
fn serve_as_child(domain: &Domain) -> ! {
    let mut server = Server::start(domain, u64::MAX, 100);
    for step in 0.. {
        server.publish(step);
        std::thread::sleep(Duration::from_millis(2));
    }
    unreachable!("2^64 steps take longer than any test");
}

fn mcap_is_finished(path: &Path) -> bool {
    let bytes = std::fs::read(path).unwrap();
    matches!(mcap::Summary::read(&bytes), Ok(Some(_)))
}

#[test]
fn a_session_whose_last_frame_was_lost_ends_all_the_same() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut server = Server::start(&domain.domain, u64::MAX, 50);
    let run = server.run;
    let stop = AtomicBool::new(false);
    let summary = record_while(&options(&domain.domain, &path), &stop, |recorded| {
        server.publish_all(&path, 1..30, recorded);
        let status = Status {
            step: 31,
            server_state: SERVER_STOPPING,
            ..Default::default()
        };
        server.ports.update_status(&status).unwrap();
        drop(server);
    });
    assert_eq!(run.checked_steps(&path), (0..30).collect::<Vec<_>>());
    assert_eq!((summary.gaps, summary.missed_steps), (1, 2));
}

#[test]
fn a_stopped_recorder_leaves_a_finished_file() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut server = Server::start(&domain.domain, u64::MAX, 50);
    let run = server.run;
    let stop = AtomicBool::new(false);
    let summary = record_while(&options(&domain.domain, &path), &stop, |recorded| {
        server.publish_all(&path, 1..40, recorded);
        stop.store(true, Ordering::Relaxed);
    });
    assert_eq!(
        run.checked_steps(&path).len() as u64,
        summary.frames_recorded
    );
    assert!(mcap_is_finished(&path));

    let timed = RecordOptions {
        output: folder.path().join("timed.mcap"),
        duration: Some(Duration::from_millis(50)),
        ..options(&domain.domain, &path)
    };
    let summary = record(&timed, &AtomicBool::new(false), |_| {}).unwrap();
    assert_eq!(
        summary.first_step,
        Some(39),
        "a late joiner gets the newest frame"
    );
    assert_eq!(
        summary.latency_us.p50, None,
        "what waited for us says nothing about latency"
    );
}

#[test]
fn without_a_server_no_file_is_left_and_an_existing_one_stays() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let hasty = RecordOptions {
        wait: Duration::from_millis(50),
        ..options(&domain.domain, &path)
    };
    let error = record(&hasty, &AtomicBool::new(false), |_| {}).unwrap_err();
    assert!(
        error.to_string().contains("no server for session \"live\""),
        "{error}"
    );
    assert!(!path.exists());
    std::fs::write(&path, "precious").unwrap();
    let error = record(&hasty, &AtomicBool::new(false), |_| {}).unwrap_err();
    assert!(
        matches!(error, RecordError::Recording(RecordingError::Exists { .. })),
        "{error}"
    );
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn a_full_disk_ends_the_recording_and_not_the_server() {
    let domain = TestDomain::new();
    let mut server = Server::start(&domain.domain, 200, 2000);
    let mut to_full_disk = options(&domain.domain, "/dev/full".as_ref());
    to_full_disk.writer.overwrite = true;
    std::thread::scope(|scope| {
        let recorder = scope.spawn(|| record(&to_full_disk, &AtomicBool::new(false), |_| {}));
        // Nobody waits for a recorder that gives up.
        let recorded = AtomicU64::new(200);
        server.publish_all("/dev/full".as_ref(), 1..200, &recorded);
        let error = recorder.join().unwrap().unwrap_err();
        assert!(error.to_string().contains("No space left"), "{error}");
    });
}

/// The figures of a frame header that a server fills in itself are not those of the made-up run.
#[test]
fn the_recorded_header_is_the_published_one() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut server = Server::start(&domain.domain, 3, 10);
    let run = server.run;
    let before = cosplat_ipc::monotonic_ns();
    record_while(
        &options(&domain.domain, &path),
        &AtomicBool::new(false),
        |recorded| {
            server.publish_all(&path, 1..3, recorded);
        },
    );
    let after = cosplat_ipc::monotonic_ns();
    for event in Recording::open(&path).unwrap() {
        if let Event::Frame(frame) = event.unwrap() {
            let header = FrameHeader {
                publish_ns: 0,
                ..frame.header
            };
            let expected = FrameHeader {
                publish_ns: 0,
                ..run.header(frame.header.step)
            };
            assert_eq!(header, expected);
            assert!((before..=after).contains(&frame.header.publish_ns));
        }
    }
}
