//! Checkpoints of the running simulation in the recording: with one, what follows can be simulated again without what came before.

use std::path::Path;
use std::time::Duration;

use cosplat_ipc::client::{CommandSender, Unanswered};
use cosplat_ipc::schema::{Ack, COMMAND_CHECKPOINT, Command};

use crate::reader::LENGTH_LIMIT;

/// How long the end of a recording waits for the answer to its last order; the server answers between two steps.
const LAST_WAIT: Duration = Duration::from_secs(1);

/// The complete state after a step.
pub(crate) struct Checkpoint {
    /// The step.
    pub step: u64,
    /// Its bytes, as the server wrote them.
    pub data: Vec<u8>,
}

/// Orders checkpoints from the server, and hands over those that are there. It never waits.
pub(crate) struct Checkpoints {
    sender: CommandSender,
    /// Simulated time between two [s].
    every: f64,
    /// First step at which another one is wanted.
    due: u64,
    ordered: Option<Unanswered>,
}

/// No checkpoint will come, for this reason.
#[derive(Debug, thiserror::Error)]
#[error("the recording gets no checkpoints: {0}")]
pub(crate) struct Refused(String);

impl Checkpoints {
    /// Wants one as soon as possible, and then one each `every` [s, simulated].
    pub fn new(sender: CommandSender, every: f64) -> Self {
        Self {
            sender,
            every,
            due: 0,
            ordered: None,
        }
    }

    /// Another run of the server has begun.
    pub fn begin_anew(&mut self) {
        self.due = 0;
        self.ordered = None;
    }

    /// Wants another one now.
    pub fn want_now(&mut self) {
        self.due = 0;
    }

    /// Called after the frame of `step`, of which there are `frame_rate` in a simulated second: orders what is due, and
    /// returns the checkpoint that is there.
    ///
    /// # Errors
    /// When the server writes none.
    pub fn after(&mut self, step: u64, frame_rate: f64) -> Result<Option<Checkpoint>, Refused> {
        if self.ordered.is_none() && step >= self.due {
            let order = Command {
                kind: COMMAND_CHECKPOINT,
                ..Command::default()
            };
            // A server that is busy or away is asked again after the next frame.
            self.ordered = self.sender.submit(&[order], Duration::ZERO).ok();
        }
        let Some(ordered) = &self.ordered else {
            return Ok(None);
        };
        let acks = match self.sender.try_answers(ordered) {
            Ok(None) => return Ok(None),
            Ok(Some(acks)) => acks,
            Err(error) => {
                tracing::debug!("a checkpoint does not come: {error}");
                self.ordered = None;
                return Ok(None);
            }
        };
        self.ordered = None;
        let checkpoint = acks.first().map(read).transpose().map_err(Refused)?;
        if let Some(checkpoint) = &checkpoint {
            let steps = (self.every * frame_rate).round().max(1.0);
            self.due = checkpoint.step.saturating_add(steps as u64);
        }
        Ok(checkpoint)
    }

    /// Removes what was ordered and comes too late for the recording: nobody else knows of its file.
    pub fn end(self) {
        let Some(ordered) = self.ordered else {
            return;
        };
        match self.sender.answers(ordered, LAST_WAIT) {
            Ok(acks) => drop(acks.first().map(read)),
            Err(error) => tracing::debug!("a checkpoint does not come: {error}"),
        }
    }
}

/// Takes the file that the server wrote, which was ordered for the recording alone.
fn read(ack: &Ack) -> Result<Checkpoint, String> {
    let text = ack
        .reason()
        .map_err(|e| format!("the answer of the server is no text: {e}"))?;
    if !ack.is_accepted() {
        return Err(text.to_owned());
    }
    let path = Path::new(text);
    let unreadable = |e: std::io::Error| format!("cannot read {text}: {e}");
    // Another process named it.
    let found = std::fs::metadata(path).map_err(unreadable)?;
    if !found.is_file() || found.len() > LENGTH_LIMIT as u64 {
        return Err(format!(
            "{text} is no plain file of at most {LENGTH_LIMIT} bytes: it has {}",
            found.len()
        ));
    }
    let data = std::fs::read(path).map_err(unreadable)?;
    if let Err(error) = std::fs::remove_file(path) {
        tracing::warn!("{text} is in the recording, and cannot be removed: {error}");
    }
    Ok(Checkpoint {
        step: ack.applied_at_step.saturating_sub(1),
        data,
    })
}
