//! The shared-memory mount: what is free, and taking it for good.
//!
//! iceoryx2 only reserves addresses. Without the steps here the first write to a full mount kills the process
//! with SIGBUS.

use std::{fs, io, path::PathBuf};

use rustix::fs::FallocateFlags;

/// Where Linux keeps POSIX shared memory.
pub(crate) const SHM_DIR: &str = "/dev/shm";

/// Why memory cannot be set aside.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReserveError {
    /// The mount or the machine is full.
    #[error("{required} bytes required, {available} available in {SHM_DIR}")]
    TooSmall { required: u64, available: u64 },
    /// The port's memory is somewhere else.
    #[error("no file of port {id} in {SHM_DIR}")]
    NotFound { id: u128 },
    /// The system refuses.
    #[error("{}: {cause}", path.display())]
    Io { path: PathBuf, cause: io::Error },
}

/// Shared memory that can be taken now [byte]: free space of the mount, but no more than free memory.
pub(crate) fn available_bytes() -> u64 {
    let mount = rustix::fs::statvfs(SHM_DIR).map_or(u64::MAX, |s| s.f_bavail * s.f_frsize);
    mount.min(free_memory().unwrap_or(u64::MAX))
}

fn free_memory() -> Option<u64> {
    let meminfo = fs::read_to_string("/proc/meminfo").ok()?;
    let line = meminfo.lines().find(|l| l.starts_with("MemAvailable:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

/// Makes the system set aside every page of the data segment of the port `id`.
pub(crate) fn reserve(id: u128) -> Result<(), ReserveError> {
    let path = data_file(id).ok_or(ReserveError::NotFound { id })?;
    let io = |cause| ReserveError::Io {
        path: path.clone(),
        cause,
    };
    let file = fs::OpenOptions::new()
        .read(true)
        .write(true)
        .open(&path)
        .map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    match rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, length) {
        Ok(()) => Ok(()),
        Err(rustix::io::Errno::NOSPC) => Err(ReserveError::TooSmall {
            required: length,
            available: available_bytes(),
        }),
        Err(error) => Err(io(error.into())),
    }
}

fn data_file(id: u128) -> Option<PathBuf> {
    let suffix = format!("_{id}.data");
    let files = fs::read_dir(SHM_DIR).ok()?;
    files
        .filter_map(Result::ok)
        .find(|file| file.file_name().to_string_lossy().ends_with(&suffix))
        .map(|file| file.path())
}
