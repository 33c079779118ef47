//! Ctrl-C and SIGTERM as a flag that long work looks at.

use std::sync::{Arc, atomic::AtomicBool};

use anyhow::{Context, ensure};
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGINT, SIGTERM, SIGXFSZ};

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

/// A flag that SIGINT or SIGTERM sets; a second SIGINT ends the process at once.
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
    Ok(stop)
}
