//! One server per session: a lock that the system gives back whatever happens to its holder.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Read},
    os::unix::fs::{FileExt, MetadataExt},
    path::PathBuf,
    time::SystemTime,
};

use rustix::fs::FlockOperation;

use super::CreateError;
use crate::{Domain, session::SessionName};

/// The right to make the services of a session; released when dropped.
#[derive(Debug)]
pub(super) struct SessionLock {
    _file: File,
    /// Whoever cleans folders by age leaves those alone that are locked, as systemd-tmpfiles does.
    _root: Option<File>,
    entry: Entry,
    epoch: u64,
}

/// Where others find a session: while it is there, nobody serves another one of this name.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    path: PathBuf,
    inode: u64,
    services: PathBuf,
}

impl Entry {
    /// Whether others find the session.
    pub fn is_there(&self) -> bool {
        let found = fs::symlink_metadata(&self.path);
        found.is_ok_and(|found| found.ino() == self.inode) && self.services.is_dir()
    }
}

impl SessionLock {
    /// Takes the lock of `session`, or says who has it. The domain's root folder must exist.
    pub fn take(domain: &Domain, session: &SessionName) -> Result<Self, CreateError> {
        let path = domain
            .root()
            .join(format!("session-{}.lock", session.as_str()));
        let failed = |error: io::Error| CreateError::Transport {
            what: "lock the session",
            reason: format!("{}: {error}", path.display()),
        };
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(failed)?;
        let locked = rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive);
        let content = Content::read(&file).map_err(failed)?;
        match locked {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(CreateError::AlreadyServed {
                    session: session.as_str().into(),
                    pid: content.pid,
                });
            }
            Err(error) => return Err(failed(error.into())),
        }
        let Some(later) = content.epoch.checked_add(1) else {
            let reason = format!(
                "the last epoch is {}, expected less: remove the file",
                u64::MAX
            );
            return Err(failed(io::Error::other(reason)));
        };
        let epoch = later.max(now());
        // In one go, the length last: a server that is killed here leaves the old epoch or the new one.
        let text = format!("{}\n{epoch}\n", std::process::id());
        file.write_all_at(text.as_bytes(), 0).map_err(failed)?;
        file.set_len(text.len() as u64).map_err(failed)?;
        let inode = file.metadata().map_err(failed)?.ino();
        let root = File::open(domain.root()).ok();
        if let Some(root) = &root {
            // A cleaner that looks just now has the lock for a moment: then there is none.
            let _ = rustix::fs::flock(root, FlockOperation::NonBlockingLockShared);
        }
        Ok(Self {
            _file: file,
            _root: root,
            entry: Entry {
                path,
                inode,
                services: domain.root().join("services"),
            },
            epoch,
        })
    }

    /// Where others find the session.
    pub fn entry(&self) -> &Entry {
        &self.entry
    }

    /// Identifies this run: larger than that of any run before, wherever the clock was set to meanwhile.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }
}

/// What the lock's file says of the server that has or had it.
struct Content {
    /// Process id; 0 when unknown.
    pid: u32,
    /// Epoch; 0 when unknown.
    epoch: u64,
}

impl Content {
    fn read(file: &File) -> io::Result<Self> {
        /// Two numbers and two line feeds need fewer.
        const LONGEST: u64 = 64;
        let mut bytes = Vec::new();
        file.take(LONGEST).read_to_end(&mut bytes)?;
        let text = String::from_utf8_lossy(&bytes);
        let mut lines = text.lines();
        let mut number = || {
            lines
                .next()
                .and_then(|line| line.trim().parse::<u64>().ok())
        };
        Ok(Self {
            pid: number().and_then(|pid| pid.try_into().ok()).unwrap_or(0),
            epoch: number().unwrap_or(0),
        })
    }
}

/// Unix time [ns].
fn now() -> u64 {
    SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0, |since| since.as_nanos() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root folder with the lock's file of `session` in it.
    fn left_behind(session: &SessionName, content: &str) -> (Domain, tempfile::TempDir) {
        let folder = tempfile::tempdir().expect("a folder");
        let domain = Domain::new(folder.path(), "lock_").expect("a domain");
        let file = folder.path().join("session-clock.lock");
        assert_eq!(session.as_str(), "clock");
        fs::write(file, content).expect("written");
        (domain, folder)
    }

    #[test]
    fn epochs_grow_when_the_clock_is_set_back() {
        let session = SessionName::new("clock").expect("a name");
        // The year 2255: whatever the clock says now is earlier.
        let future = 9_000_000_000_000_000_000;
        let (domain, _folder) = left_behind(&session, &format!("1234567\n{future}\n"));
        for later in 1..=3 {
            let lock = SessionLock::take(&domain, &session).expect("free");
            assert_eq!(lock.epoch(), future + later);
            let refused = SessionLock::take(&domain, &session).expect_err("taken");
            let ours = std::process::id();
            assert!(
                matches!(refused, CreateError::AlreadyServed { pid, .. } if pid == ours),
                "{refused}"
            );
        }
    }

    #[test]
    fn an_epoch_that_cannot_be_read_is_that_of_the_clock() {
        let session = SessionName::new("clock").expect("a name");
        let before = now();
        for content in ["", "17\n", "17\nsoon\n", "\u{1f600}", "17\n-1\n"] {
            let (domain, _folder) = left_behind(&session, content);
            let lock = SessionLock::take(&domain, &session).expect("free");
            assert!((before..=now()).contains(&lock.epoch()), "{content:?}");
        }
        let (domain, _folder) = left_behind(&session, &format!("17\n{}\n", u64::MAX));
        let refused = SessionLock::take(&domain, &session).expect_err("no larger one");
        let said = refused.to_string();
        assert!(said.contains("session-clock.lock"), "{said}");
    }
}
