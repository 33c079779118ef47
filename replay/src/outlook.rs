//! The first look at a recording, before any of it is simulated again: how much there is, and where a run can be taken up.

use std::{collections::BTreeMap, path::Path};

use cosplat_recorder::{
    RecordingError,
    reader::{Event, Recording},
    runs::CommandCount,
    topics::checkpoint_of,
};
use xxhash_rust::xxh3::xxh3_64;

use crate::walk::Walk;

/// The complete state of a run after a step, as the recording keeps it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Start {
    /// The step.
    pub step: u64,
    /// The checkpoint.
    pub data: Vec<u8>,
}

/// What a recording holds of its runs, by epoch.
#[derive(Debug, Default)]
pub struct Outlook {
    /// Frames that can be read.
    pub frames: u64,
    runs: BTreeMap<u64, RunOutlook>,
}

/// What a recording holds of a run.
#[derive(Debug, Default)]
struct RunOutlook {
    first_step: Option<u64>,
    /// Commands, from the first one in the file on.
    commands: Option<CommandCount>,
    /// Step of the first command in the file, where there were others before it.
    joined_at: Option<u64>,
    /// Step of the last command in the file that others before are missing of, the first one aside.
    lacks_before: Option<u64>,
    /// Hashes of checkpoints, by step.
    checkpoints: BTreeMap<u64, u64>,
}

impl Start {
    /// Reads the checkpoint after a step of the run `epoch`; `None` where there is none.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub fn read(path: &Path, epoch: u64, step: u64) -> Result<Option<Start>, RecordingError> {
        for event in Recording::open(path)?.without_gaussians() {
            if let Event::Attachment { name, data } = event?
                && checkpoint_of(&name) == Some((epoch, step))
            {
                return Ok(Some(Start { step, data }));
            }
        }
        Ok(None)
    }
}

impl Outlook {
    /// Reads a recording up to what is damaged.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn of(path: &Path) -> Result<Outlook, RecordingError> {
        let mut outlook = Outlook::default();
        let mut walk = Walk::default();
        let sound = Recording::open(path)?.without_gaussians();
        for event in sound.map_while(Result::ok) {
            walk.next(&event);
            outlook.take(event, walk.epoch().unwrap_or_default());
        }
        Ok(outlook)
    }

    fn take(&mut self, event: Event, epoch: u64) {
        match event {
            Event::Frame(frame) => {
                self.frames += 1;
                let run = self.runs.entry(epoch).or_default();
                run.first_step.get_or_insert(frame.header.step);
            }
            Event::Journal(entry) => {
                let run = self.runs.entry(epoch).or_default();
                let step = entry.applied.step;
                let is_first = run.commands.is_none();
                let commands = run.commands.get_or_insert_with(CommandCount::default);
                match commands.take(&entry) {
                    Ok(()) => {}
                    Err(_) if is_first => run.joined_at = Some(step),
                    Err(_) => run.lacks_before = Some(step),
                }
            }
            Event::Attachment { name, data } => {
                let Some((epoch, step)) = checkpoint_of(&name) else {
                    return;
                };
                let run = self.runs.entry(epoch).or_default();
                run.checkpoints.insert(step, xxh3_64(&data));
            }
            _ => {}
        }
    }

    /// After which step to take up the run of this `epoch`: at the last checkpoint before the first frame, or where commands are
    /// missing behind that at the first one that has their effect.
    pub fn start(&self, epoch: u64) -> Option<u64> {
        let run = self.runs.get(&epoch)?;
        // A part that ends before its first frame has its checkpoint all the same.
        let first = run.first_step.unwrap_or(u64::MAX);
        let before = run.checkpoints.range(..first).next_back();
        let joined = run.joined_at.filter(|_| before.is_none());
        let missing = joined.max(run.lacks_before);
        let after = missing.and_then(|step| run.checkpoints.range(step..).next());
        after.or(before).map(|(step, _)| *step)
    }

    /// Hash of the checkpoint after a step, where there is one.
    pub fn checkpoint(&self, epoch: u64, step: u64) -> Option<u64> {
        self.runs.get(&epoch)?.checkpoints.get(&step).copied()
    }
}

#[cfg(test)]
mod tests {
    use cosplat_ipc::schema::AppliedCommand;
    use cosplat_recorder::{messages::JournalEntry, topics::checkpoint_name};

    use super::*;

    const EPOCH: u64 = 7;

    fn checkpoint(step: u64) -> Event {
        Event::Attachment {
            name: checkpoint_name(EPOCH, step),
            data: vec![1],
        }
    }

    fn command(index: u64, step: u64) -> Event {
        let applied = AppliedCommand {
            step,
            ..AppliedCommand::default()
        };
        Event::Journal(JournalEntry {
            applied,
            epoch: Some(EPOCH),
            index: Some(index),
        })
    }

    fn start(events: impl IntoIterator<Item = Event>) -> Option<u64> {
        let mut outlook = Outlook::default();
        for event in events {
            outlook.take(event, EPOCH);
        }
        outlook.start(EPOCH)
    }

    #[test]
    fn a_part_without_frames_is_taken_up_at_its_checkpoint() {
        // The recording ended between the checkpoint that a part begins with and its first frame.
        assert_eq!(start([checkpoint(39), command(23, 40)]), Some(39));
        assert_eq!(start([command(23, 40), checkpoint(40)]), Some(40));
        assert_eq!(start([command(0, 40)]), None);
    }
}
