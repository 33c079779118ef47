//! A domain of its own for every story, and the processes that play in it.

use std::{
    ffi::OsStr,
    io::Read,
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Output, Stdio},
    sync::atomic::{AtomicU32, Ordering},
    time::{Duration, Instant},
};

use cosplat_ipc::{
    Domain,
    client::{Client, CommandSender, Frame, FrameReader},
    schema::Status,
};
use cosplat_renderer::Image;

/// Longest that any single wait may take before a story is called hung.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Starts a program with the usual mask of file modes. iceoryx2 narrows that of this whole process while it makes its own
/// files, two threads at once may leave it narrow, and a child would keep it: its folders then could not be entered.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", "umask 022 && exec \"$0\" \"$@\""]);
    command.arg(program);
    command
}

/// A small scene that steps fast: two blocks fall onto a floor.
pub const SMALL_SCENE: &str = r#"
version = 1
name = "two blocks"
frame_rate = 50
dx = 0.05

[[objects]]
name = "left"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [-0.3, 0.3, 0.0]
material = "soft_rubber"

[[objects]]
name = "right"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [0.3, 0.3, 0.0]
material = "soft_rubber"

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.4
"#;

/// One story's stage.
pub struct Stage {
    pub domain: Domain,
    domain_name: String,
    folder: tempfile::TempDir,
}

impl Stage {
    /// A fresh domain and folder.
    pub fn new() -> Stage {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let domain_name = format!("t{}-{number}", std::process::id());
        Stage {
            domain: Domain::named(&domain_name).expect("a test's domain is usable"),
            domain_name,
            folder: tempfile::tempdir().expect("a temporary folder can be made"),
        }
    }

    /// A path in the stage's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The `cosplat` program in this stage's domain.
    pub fn cosplat(&self, arguments: &[&str]) -> Command {
        let mut command = command(env!("CARGO_BIN_EXE_cosplat"));
        command
            .args(arguments)
            .env("COSPLAT_DOMAIN", &self.domain_name)
            .current_dir(self.folder.path())
            .stdin(Stdio::null());
        command
    }

    /// This test program again, playing the part of a client that takes a frame and never lets go.
    pub fn holder(&self) -> Process {
        let mut command =
            command(std::env::current_exe().expect("the test program knows its file"));
        command
            .args([
                "--exact",
                "crashes::a_held_frame_never_changes",
                "--nocapture",
            ])
            .env("COSPLAT_TEST_HOLD", &self.domain_name)
            .stdin(Stdio::null());
        Process::start(command)
    }

    /// This test program again, taking part in lock-step: see `lockstep::a_child_takes_part`.
    pub fn participant(&self, name: &str, part: &str) -> Process {
        let mut command =
            command(std::env::current_exe().expect("the test program knows its file"));
        command
            .args(["--exact", "lockstep::a_child_takes_part", "--nocapture"])
            .env("COSPLAT_TEST_DOMAIN", &self.domain_name)
            .env("COSPLAT_TEST_PARTICIPANT", name)
            .env("COSPLAT_TEST_PART", part)
            .stdin(Stdio::null());
        Process::start(command)
    }

    /// Starts a server on [`SMALL_SCENE`] and waits until clients can attach.
    pub fn serve(&self, arguments: &[&str]) -> Process {
        self.serve_scene(SMALL_SCENE, arguments)
    }

    /// Starts a server on a scene and waits until clients can attach.
    pub fn serve_scene(&self, scene: &str, arguments: &[&str]) -> Process {
        let path = self.path("scene.toml");
        std::fs::write(&path, scene).expect("the stage's folder is writable");
        let mut all = vec!["serve", path.to_str().expect("a plain path"), "--json"];
        all.extend(arguments);
        let mut process = Process::start(self.cosplat(&all));
        self.wait_for_server(&mut process);
        process
    }

    /// Waits until clients can attach to what `process` serves.
    pub fn wait_for_server(&self, process: &mut Process) {
        let deadline = Instant::now() + PATIENCE;
        while let Err(error) =
            Client::connect(&self.domain, "default", "probe", Duration::from_millis(20))
        {
            assert!(
                process.is_running(),
                "the server ended: {}",
                process.words()
            );
            assert!(Instant::now() < deadline, "no server: {error}");
        }
    }

    /// Attaches to the stage's server.
    pub fn client(&self) -> Client {
        Client::connect(&self.domain, "default", "test", PATIENCE).expect("the server is there")
    }

    /// Runs `cosplat ctl` to its end.
    pub fn ctl(&self, arguments: &[&str]) -> Output {
        let mut all = vec!["ctl"];
        all.extend(arguments);
        self.cosplat(&all).output().expect("cosplat can be run")
    }

    /// A sender of wire commands, for what the command line would not let through.
    pub fn sender(&self) -> CommandSender {
        self.client().commands().expect("the server takes commands")
    }
}

impl Drop for Stage {
    /// Nothing of a story stays in shared memory.
    fn drop(&mut self) {
        self.domain.discard();
    }
}

/// Waits for a status that satisfies `wanted`.
pub fn wait_for_status(client: &Client, wanted: impl Fn(&Status) -> bool) -> Status {
    let mut reader = client.status().expect("status is readable");
    let deadline = Instant::now() + PATIENCE;
    loop {
        let status = reader
            .next(Duration::from_millis(100))
            .expect("status is well-formed");
        if let Some(status) = status.filter(|s| wanted(s)) {
            return status;
        }
        assert!(Instant::now() < deadline, "last status: {status:?}");
    }
}

/// Waits until `count` readers of frames are attached, which `processes` belong to: the words of one that ended are the
/// failure.
pub fn wait_for_readers(client: &Client, count: u32, processes: &mut [&mut Process]) {
    let mut reader = client.status().expect("status is readable");
    let deadline = Instant::now() + PATIENCE;
    loop {
        let status = reader
            .next(Duration::from_millis(100))
            .expect("status is well-formed");
        if status.is_some_and(|s| s.frame_readers >= count) {
            return;
        }
        for process in &mut *processes {
            assert!(process.is_running(), "{}", process.words());
        }
        assert!(Instant::now() < deadline, "last status: {status:?}");
    }
}

/// The next frame, or a failure.
pub fn next_frame(reader: &mut FrameReader) -> Frame {
    reader
        .next(PATIENCE)
        .expect("frames are well-formed")
        .expect("a frame comes in time")
}

/// A running process; dropped, it is killed.
pub struct Process {
    child: Child,
}

impl Process {
    /// Starts a command with its output captured.
    pub fn start(command: Command) -> Process {
        Process::start_with(command, Stdio::piped(), Stdio::piped())
    }

    /// Starts a command whose output goes elsewhere.
    pub fn start_with(mut command: Command, output: Stdio, words: Stdio) -> Process {
        let child = command
            .stdout(output)
            .stderr(words)
            .spawn()
            .expect("the program can be started");
        Process { child }
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// SIGKILL, then reaped.
    pub fn kill(&mut self) {
        self.child.kill().expect("a running process can be killed");
        self.child.wait().expect("a killed process ends");
    }

    /// Sends a signal by name.
    pub fn signal(&self, name: &str) {
        let status = Command::new("kill")
            .args(["-s", name, &self.child.id().to_string()])
            .status()
            .expect("kill is a program everywhere");
        assert!(status.success());
    }

    /// Waits for the end.
    pub fn wait(&mut self) -> ExitStatus {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().expect("a child can be waited for") {
                return status;
            }
            assert!(Instant::now() < deadline, "the process did not end");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// What it printed on standard output, once ended.
    pub fn output(&mut self) -> String {
        read(self.child.stdout.take())
    }

    /// What it printed on standard error, once ended.
    pub fn words(&mut self) -> String {
        read(self.child.stderr.take())
    }

    /// Waits for a good end and parses the JSON object on the last line.
    pub fn result(&mut self) -> serde_json::Value {
        let status = self.wait();
        let output = self.output();
        assert!(status.success(), "{status}: {}", self.words());
        let line = output.lines().last().unwrap_or_default();
        serde_json::from_str(line).unwrap_or_else(|e| panic!("{line:?}: {e}"))
    }

    /// Reads standard output until a line contains `text`, and gives back all of it.
    pub fn wait_for_output(&mut self, text: &str) -> String {
        let pipe = self.child.stdout.as_mut().expect("output is captured");
        let (mut seen, mut byte) = (String::new(), [0]);
        while !seen.contains(text) {
            assert!(
                pipe.read(&mut byte).expect("the pipe is readable") == 1,
                "the process ended after {seen:?}"
            );
            seen.push(byte[0] as char);
        }
        seen
    }
}

fn read(pipe: Option<impl Read>) -> String {
    let mut text = String::new();
    if let Some(mut pipe) = pipe {
        pipe.read_to_string(&mut text).expect("output is text");
    }
    text
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.is_running() {
            self.kill();
        }
    }
}

/// Ends the whole test program, loudly, when a story hangs.
pub fn watchdog() -> impl Drop {
    struct Watched(std::sync::mpsc::Sender<()>);
    impl Drop for Watched {
        fn drop(&mut self) {
            let _ = self.0.send(());
        }
    }
    let (sender, receiver) = std::sync::mpsc::channel();
    let story = std::thread::current().name().unwrap_or("?").to_owned();
    std::thread::spawn(move || {
        if receiver.recv_timeout(PATIENCE * 10) == Err(std::sync::mpsc::RecvTimeoutError::Timeout) {
            eprintln!("{story} hangs");
            std::process::abort();
        }
    });
    Watched(sender)
}

/// Whether a path is a non-empty file.
pub fn has_bytes(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| m.len() > 0)
}

/// A file of the test data, or `None` with a word about the skip, which is a failure where all is required.
pub fn test_data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("COSPLAT_TEST_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    if path.exists() {
        return Some(path.canonicalize().expect("an existing path"));
    }
    let required = std::env::var_os("COSPLAT_REQUIRE_ALL").is_some();
    assert!(!required, "{} is missing", path.display());
    eprintln!("SKIPPED: {name}: not in {}", folder.display());
    None
}

/// Peak signal to noise of a picture [dB].
pub fn psnr(a: &Image, b: &Image) -> f64 {
    let squares: f64 = a
        .rgb
        .iter()
        .zip(&b.rgb)
        .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
        .sum();
    let mean = squares / a.rgb.len() as f64;
    10.0 * (255.0 * 255.0 / mean.max(1e-12)).log10()
}
