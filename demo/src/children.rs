//! The processes of a demo: started from this very program, watched, stopped together.

use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, channel},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use anyhow::{Context, bail};
use serde::de::DeserializeOwned;

/// How long a process may take to finish its files once told to stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(30);

/// One process, its log and what it printed.
pub struct Process {
    role: &'static str,
    child: Child,
    output: Option<JoinHandle<String>>,
    first_line: Receiver<String>,
    log: PathBuf,
}

impl Process {
    /// Starts `cosplat` with `arguments`; its standard error goes to `folder/role.log`. It ends with the thread that calls
    /// this, even when this process is killed.
    ///
    /// # Errors
    /// When the log cannot be written or the process cannot be started.
    pub fn start(role: &'static str, folder: &Path, arguments: &[&str]) -> anyhow::Result<Process> {
        Self::start_at(role, folder, Path::new("."), arguments)
    }

    /// As [`start`](Self::start), in `folder`: relative paths of the arguments begin there.
    ///
    /// # Errors
    /// When the log cannot be written or the process cannot be started.
    pub fn start_in(
        role: &'static str,
        folder: &Path,
        arguments: &[&str],
    ) -> anyhow::Result<Process> {
        Self::start_at(role, folder, folder, arguments)
    }

    fn start_at(
        role: &'static str,
        folder: &Path,
        place: &Path,
        arguments: &[&str],
    ) -> anyhow::Result<Process> {
        let log = folder.join(format!("{role}.log"));
        let log_file =
            File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
        let program = std::env::current_exe().context("cannot find this program's own file")?;
        let mut child = Command::new(&program)
            .arg(format!("--parent={}", std::process::id()))
            .args(arguments)
            .current_dir(place)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log_file)
            .spawn()
            .with_context(|| format!("cannot start the {role}, {}", program.display()))?;
        let pipe = child.stdout.take().context("the pipe was just made")?;
        let (told, first_line) = channel();
        let output = std::thread::spawn(move || {
            let mut text = String::new();
            let mut pipe = BufReader::new(pipe);
            // A broken pipe ends the text; what came before it is still wanted.
            let _ = pipe.read_line(&mut text);
            // Most processes are asked for their last line only.
            let _ = told.send(text.trim_end().to_owned());
            let _ = pipe.read_to_string(&mut text);
            text
        });
        Ok(Process {
            role,
            child,
            output: Some(output),
            first_line,
            log,
        })
    }

    /// Fails, with the end of its log, if the process has ended already with an error.
    ///
    /// # Errors
    /// When it has failed.
    pub fn check(&mut self) -> anyhow::Result<bool> {
        match self.child.try_wait()? {
            None => Ok(true),
            Some(status) if status.success() => Ok(false),
            Some(status) => bail!(
                "the {} ended with {status}: {}",
                self.role,
                self.last_words()
            ),
        }
    }

    /// Waits for the first line that the process prints.
    ///
    /// # Errors
    /// When it ends without one.
    pub fn first_line(&mut self) -> anyhow::Result<String> {
        match self.first_line.recv() {
            Ok(line) if !line.is_empty() => Ok(line),
            _ => bail!("the {} printed nothing: {}", self.role, self.last_words()),
        }
    }

    /// Asks the process to finish.
    pub fn terminate(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            let pid = rustix::process::Pid::from_child(&self.child);
            // Gone in between is fine: that is what was asked for.
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
    }

    /// Waits for the end and reads the JSON object on the last line of its output.
    ///
    /// # Errors
    /// When it fails, does not end within `timeout`, or prints something else.
    pub fn result<T: DeserializeOwned>(&mut self, timeout: Duration) -> anyhow::Result<T> {
        let deadline = Instant::now() + timeout;
        while self.check()? {
            if Instant::now() > deadline {
                bail!("the {} did not end within {timeout:?}", self.role);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let text = self.output()?;
        let line = text.lines().last().unwrap_or_default();
        serde_json::from_str(line)
            .with_context(|| format!("the {} ended with unexpected output: {line:?}", self.role))
    }

    /// What the process printed, once it has ended.
    ///
    /// # Errors
    /// When it was taken already.
    pub fn output(&mut self) -> anyhow::Result<String> {
        let output = self.output.take().context("the result was taken already")?;
        Ok(output.join().unwrap_or_default())
    }

    fn last_words(&self) -> String {
        let text = std::fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<_> = text.lines().collect();
        let tail = lines[lines.len().saturating_sub(5)..].join("\n");
        format!("{tail}\n(log: {})", self.log.display())
    }
}

impl Drop for Process {
    /// No process outlives the demo, however it ends.
    fn drop(&mut self) {
        self.terminate();
        let deadline = Instant::now() + STOP_TIMEOUT;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() > deadline {
                // Nothing more can be done when even this fails.
                let _ = self.child.kill();
                let _ = self.child.wait();
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
