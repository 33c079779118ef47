//! The reader of `changes`: whatever it hands out builds on what it handed out before.

use std::time::{Duration, Instant};

use super::{Changes, Client, ConnectError, ReadError, StreamReader};
use crate::{
    schema::{ChangeSlot, ChangesHeader},
    session,
};

/// Reads `changes`. Every message is complete by itself or builds on the one before; where messages are missing, the
/// reader asks for a complete one.
pub struct ChangesReader {
    stream: StreamReader<ChangeSlot, ChangesHeader>,
    /// Epoch and step of the message before.
    last: Option<(u64, u64)>,
    /// Messages that may come before the complete one that is on its way: the server may join a reader in the middle of one.
    may_pass: u32,
}

impl ChangesReader {
    pub(super) fn open(client: &Client, depth: usize) -> Result<Self, ConnectError> {
        Ok(Self {
            stream: StreamReader::open(client, session::CHANGES, depth)?,
            last: None,
            may_pass: 1,
        })
    }

    /// The next message, waiting up to `timeout` for it; `None` if there was none. Keep an
    /// [`Assembly`](crate::assembly::Assembly) of the whole frame with it, or look at what changed alone.
    ///
    /// # Errors
    /// As those of a [`StreamReader`].
    pub fn next(&mut self, timeout: Duration) -> Result<Option<Changes>, ReadError> {
        let deadline = super::deadline(timeout);
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let Some(message) = self.stream.next(left)? else {
                return Ok(None);
            };
            let header = *message.header();
            if header.is_complete() || self.last == Some((header.epoch, header.since)) {
                self.last = Some((header.epoch, header.step));
                self.may_pass = 0;
                return Ok(Some(message));
            }
            self.last = None;
            drop(message);
            if self.may_pass == 0 {
                self.stream.rejoin()?;
            }
            self.may_pass = 1 - self.may_pass;
        }
    }

    /// Steps missed since this reader was made.
    pub fn missed(&self) -> u64 {
        self.stream.missed()
    }

    /// Runs of the server seen, the present one included.
    pub fn runs(&self) -> u64 {
        self.stream.runs()
    }
}
