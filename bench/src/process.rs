//! Processes that measurements start, and what Linux says about them.

use std::{
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use cosplat_ipc::{Client, Domain, client::ConnectError};

/// This program with other words, in a domain; silent, and without input.
///
/// # Errors
/// When this program cannot be found.
pub fn this(domain: &Domain, arguments: &[&str]) -> anyhow::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command
        .args(arguments)
        .env("COSPLAT_DOMAIN", domain.root())
        .stdin(Stdio::null())
        .stdout(Stdio::null());
    Ok(command)
}

/// Attaches to a server that was started just now.
///
/// # Errors
/// When it is not there in time.
pub fn attach(domain: &Domain, session: &str, patience: Duration) -> anyhow::Result<Client> {
    let deadline = Instant::now() + patience;
    loop {
        match Client::connect(domain, session, "bench", Duration::from_millis(100)) {
            Ok(client) => return Ok(client),
            Err(error) if error.may_pass() && Instant::now() < deadline => {}
            Err(ConnectError::NoServer { .. }) => anyhow::bail!("the server did not start"),
            Err(error) => return Err(error.into()),
        }
    }
}

/// What all threads of a process spent on processors, and waited for them, so far [ns].
pub fn processor_time(pid: u32) -> Option<[u64; 2]> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).ok()?;
    let times = tasks.flatten().filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        let mut words = text.split_whitespace().map(str::parse);
        Some([words.next()?.ok()?, words.next()?.ok()?])
    });
    Some(
        times.fold([0, 0], |[spent, waited], [more, longer]: [u64; 2]| {
            [spent + more, waited + longer]
        }),
    )
}

/// Bytes of memory that belong to a process alone.
pub fn own_memory(pid: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("RssAnon:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib << 10)
}

/// Descriptors that a process holds.
pub fn descriptors(pid: u32) -> Option<usize> {
    Some(std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count())
}
