//! Ctrl-C, SIGTERM and SIGHUP as a flag that long work looks at.

use std::{
    fs,
    sync::{Arc, atomic::AtomicBool},
};

use anyhow::{Context, ensure};
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};

/// Asks this process to finish, as SIGTERM does, when the one that started it ends, even when that is killed.
///
/// # Errors
/// When `parent` [process id] has ended already, or the operating system refuses.
pub fn end_with(parent: i32) -> anyhow::Result<()> {
    set_parent_process_death_signal(Some(Signal::TERM))
        .context("cannot be told when the process that started this one ends")?;
    ensure!(
        getppid().is_some_and(|pid| pid.as_raw_pid() == parent),
        "process {parent}, which should have started this one, has ended or did not"
    );
    Ok(())
}

/// Makes writing beyond the largest file that `ulimit -f` allows an error of that write, like a full disk; the signal that
/// comes with it would end the process without a word.
///
/// # Errors
/// When the operating system refuses the handler.
pub fn outlive_full_files() -> anyhow::Result<()> {
    signal_hook::flag::register(SIGXFSZ, Arc::default())
        .context("cannot install a signal handler")?;
    Ok(())
}

/// A flag that SIGINT, SIGTERM or SIGHUP sets; a second SIGINT or SIGTERM ends the process at once. Of a terminal that closes
/// several SIGHUP come, from the system and from the shell, and whoever started the process with `nohup` wants none of them.
///
/// # Errors
/// When the operating system refuses the handlers.
pub fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // Order matters: the conditional exit looks at the flag before this very signal sets it.
        signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop))
            .context("cannot install a signal handler")?;
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .context("cannot install a signal handler")?;
    }
    if !is_ignored(SIGHUP) {
        signal_hook::flag::register(SIGHUP, Arc::clone(&stop))
            .context("cannot install a signal handler")?;
    }
    Ok(stop)
}

/// Whether this process was started with `signal` ignored.
fn is_ignored(signal: i32) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignored_signals(&status) >> (signal - 1) & 1 == 1
}

/// The mask of ignored signals in the text of a process's `status`; none where it says nothing.
fn ignored_signals(status: &str) -> u64 {
    let mask = status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_process_status() {
        let status = "SigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\nSigCgt:\t0\n";
        assert_eq!(ignored_signals(status), 0x1001);
        assert_eq!(ignored_signals("Name:\tcosplat\n"), 0);
        assert!(!is_ignored(SIGXFSZ));
    }
}
