//! Where and with what something was measured.

use std::{fs, process::Command};

/// Where and with what was measured.
pub struct Run {
    /// Processor and cores.
    pub machine: String,
    /// Of the working directory's repository; ends in `-dirty` with uncommitted changes.
    pub commit: String,
    /// Build profile and target.
    pub flags: String,
    /// When it started.
    pub date: String,
    /// Load average then.
    pub load: String,
}

/// First line that a program prints, or "unknown".
fn said(program: &str, args: &[&str]) -> String {
    let output = Command::new(program).args(args).output();
    let text = output.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned());
    text.ok()
        .filter(|text| !text.is_empty())
        .unwrap_or_else(|| "unknown".into())
}

impl Run {
    /// This process, here and now.
    pub fn here() -> Self {
        let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let field = |key: &str| {
            let line = cpu.lines().find(|line| line.starts_with(key));
            let value = line.and_then(|line| line.split(':').nth(1));
            value.map_or("unknown", str::trim).to_owned()
        };
        let cores = std::thread::available_parallelism().map_or(0, usize::from);
        let built = if cfg!(debug_assertions) {
            "dev profile"
        } else {
            "release profile"
        };
        let target = if cfg!(target_feature = "avx2") {
            "compiled for AVX2 or more"
        } else {
            "baseline target"
        };
        let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
        Self {
            machine: format!(
                "{} (family {}, model {}), {cores} cores",
                field("model name"),
                field("cpu family"),
                field("model\t"),
            ),
            commit: said("git", &["describe", "--always", "--dirty", "--exclude=*"]),
            flags: format!("{built}, {} {target}", std::env::consts::ARCH),
            date: said("date", &["-u", "+%Y-%m-%d %H:%M UTC"]),
            load: load.split(' ').next().unwrap_or("unknown").to_owned(),
        }
    }

    /// One line for captions.
    pub fn caption(&self, threads: &str) -> String {
        format!(
            "{}, {threads}. Commit {}, {}. {}, load average at the start {}.",
            self.machine, self.commit, self.flags, self.date, self.load
        )
    }
}
