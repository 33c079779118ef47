//! One server per session: a lock that the system gives back whatever happens to its holder.

use std::{
    fs::{File, OpenOptions},
    io::{self, Read, Seek, Write},
};

use rustix::fs::FlockOperation;

use super::CreateError;
use crate::{Domain, session::SessionName};

/// The right to make the services of a session; released when dropped.
#[derive(Debug)]
pub(super) struct SessionLock {
    _file: File,
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
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(failed)?;
        match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                let mut text = String::new();
                file.read_to_string(&mut text).map_err(failed)?;
                return Err(CreateError::AlreadyServed {
                    session: session.as_str().into(),
                    pid: text.trim().parse().unwrap_or(0),
                });
            }
            Err(error) => return Err(failed(error.into())),
        }
        file.set_len(0).map_err(failed)?;
        file.rewind().map_err(failed)?;
        writeln!(file, "{}", std::process::id()).map_err(failed)?;
        Ok(Self { _file: file })
    }
}
