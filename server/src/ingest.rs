//! Commands between their arrival and the step they take effect at.

use std::path::PathBuf;

use cosplat_ipc::schema as wire;
use cosplat_sim_core::{Action, Command, CommandError};

use crate::convert::{Order, order_from_wire};

/// Commands that may wait at once; more are refused, so that a runaway client cannot eat the memory.
pub const MAX_PENDING: usize = 4096;
/// How far ahead a command may be scheduled [steps].
pub const MAX_STEPS_AHEAD: u64 = 10_000_000;

/// The inbox of the simulation: checks on arrival, hands over what is due.
#[derive(Debug, Default)]
pub struct Ingest {
    pending: Vec<Pending>,
    /// Whether stepping is suspended.
    pub paused: bool,
    /// Whether a client asked the server to shut down.
    pub stop: bool,
    /// Where checkpoints go; none where they are not wanted.
    pub checkpoints: Option<CheckpointFolder>,
    /// Steps before which a checkpoint is due.
    due_checkpoints: Vec<u64>,
    /// Commands accepted since start.
    pub accepted: u64,
    /// Commands refused since start.
    pub refused: u64,
}

/// Names the files of checkpoints.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointFolder {
    /// Existing folder.
    pub folder: PathBuf,
    /// First part of the names.
    pub session: String,
}

impl CheckpointFolder {
    /// File of the state after `step` steps.
    pub fn file(&self, step: u64) -> PathBuf {
        let name = format!("{}-step-{step}.checkpoint", self.session);
        self.folder.join(name)
    }
}

/// A command that waits for its step, in both shapes: for the world and for the journal.
#[derive(Clone, Debug)]
pub struct Pending {
    /// For the world.
    pub command: Command,
    /// For the journal.
    pub applied: wire::AppliedCommand,
}

impl Ingest {
    /// An empty inbox.
    pub fn new(paused: bool, checkpoints: Option<CheckpointFolder>) -> Ingest {
        Ingest {
            paused,
            checkpoints,
            ..Ingest::default()
        }
    }

    /// Checks one request and answers every command of it; `next_step` is the first step still to come.
    ///
    /// `check` judges an action against the world. A refused command leaves no trace but the count.
    pub fn accept(
        &mut self,
        client: u64,
        commands: &[wire::Command],
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Vec<wire::Ack> {
        commands
            .iter()
            .map(|command| {
                let outcome = self.accept_one(client, command, next_step, check);
                match &outcome {
                    Ok(_) => self.accepted += 1,
                    Err(_) => self.refused += 1,
                }
                match (outcome, &self.checkpoints) {
                    (Ok(step), Some(to)) if command.kind == wire::COMMAND_CHECKPOINT => {
                        let path = to.file(step - 1).display().to_string();
                        wire::Ack::accepted_with_file(command.sequence, step, &path)
                    }
                    (Ok(step), _) => wire::Ack::accepted(command.sequence, step),
                    (Err(reason), _) => wire::Ack::refused(command.sequence, &reason),
                }
            })
            .collect()
    }

    fn accept_one(
        &mut self,
        client: u64,
        command: &wire::Command,
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Result<u64, String> {
        let step = command.apply_at_step.max(next_step);
        if step - next_step > MAX_STEPS_AHEAD {
            return Err(format!(
                "apply_at_step is {step}, expected at most {}",
                next_step + MAX_STEPS_AHEAD
            ));
        }
        match order_from_wire(command).map_err(|error| error.to_string())? {
            Order::Checkpoint => {
                self.checkpoint_at(step)?;
            }
            Order::Pause => self.paused = true,
            Order::Resume => self.paused = false,
            Order::Stop => self.stop = true,
            Order::World(action) => {
                check(&action).map_err(|error| error.to_string())?;
                if self.pending.len() >= MAX_PENDING {
                    return Err(format!(
                        "{} commands are waiting already, expected fewer than {MAX_PENDING}",
                        self.pending.len()
                    ));
                }
                self.pending.push(Pending {
                    command: Command {
                        client,
                        sequence: command.sequence,
                        apply_at_step: step,
                        action,
                    },
                    applied: wire::AppliedCommand {
                        step,
                        client,
                        command: *command,
                    },
                });
            }
        }
        Ok(step)
    }

    /// Notes that a checkpoint is wanted of the state before `step`.
    fn checkpoint_at(&mut self, step: u64) -> Result<(), String> {
        let Some(to) = &self.checkpoints else {
            return Err(
                "this server writes no checkpoints: start it with --checkpoints DIR".into(),
            );
        };
        let path = to.file(step - 1).display().to_string();
        let room = wire::Ack::accepted(0, 0).reason.len();
        if path.len() > room {
            let length = path.len();
            return Err(format!(
                "the path of the checkpoint has {length} bytes, expected at most {room}: {path}"
            ));
        }
        if self.due_checkpoints.len() >= MAX_PENDING {
            return Err(format!(
                "{MAX_PENDING} checkpoints are waiting already, expected fewer"
            ));
        }
        self.due_checkpoints.push(step);
        Ok(())
    }

    /// Takes out the checkpoint that is due before `step`; its file when there is one.
    pub fn take_checkpoint(&mut self, step: u64) -> Option<PathBuf> {
        let before = self.due_checkpoints.len();
        self.due_checkpoints.retain(|&due| due > step);
        let is_due = self.due_checkpoints.len() < before;
        self.checkpoints
            .as_ref()
            .filter(|_| is_due)
            .map(|to| to.file(step - 1))
    }

    /// Takes out what is due at `step`, in the order of application.
    pub fn take_due(&mut self, step: u64) -> Vec<Pending> {
        let (mut due, later): (Vec<_>, Vec<_>) = std::mem::take(&mut self.pending)
            .into_iter()
            .partition(|pending| pending.command.apply_at_step <= step);
        self.pending = later;
        due.sort_by_key(|pending| {
            let command = &pending.command;
            (command.apply_at_step, command.client, command.sequence)
        });
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn impulse(sequence: u64, apply_at_step: u64) -> wire::Command {
        wire::Command {
            kind: wire::COMMAND_IMPULSE,
            sequence,
            apply_at_step,
            vector: [1.0, 0.0, 0.0],
            ..Default::default()
        }
    }

    #[test]
    fn due_commands_come_in_step_client_sequence_order() {
        let mut ingest = Ingest::default();
        let fine = |_: &Action| Ok(());
        ingest.accept(2, &[impulse(1, 5), impulse(2, 4)], 3, &fine);
        ingest.accept(1, &[impulse(9, 5), impulse(3, 5), impulse(4, 7)], 3, &fine);
        let order: Vec<_> = ingest
            .take_due(5)
            .iter()
            .map(|p| (p.applied.step, p.applied.client, p.command.sequence))
            .collect();
        assert_eq!(order, [(4, 2, 2), (5, 1, 3), (5, 1, 9), (5, 2, 1)]);
        assert_eq!(ingest.take_due(7).len(), 1);
    }

    #[test]
    fn a_past_step_means_the_next_one() {
        let mut ingest = Ingest::default();
        let acks = ingest.accept(1, &[impulse(1, 0), impulse(2, 2)], 8, &|_| Ok(()));
        assert!(acks.iter().all(|ack| ack.applied_at_step == 8));
        assert!(ingest.take_due(7).is_empty());
    }

    #[test]
    fn a_refused_command_leaves_nothing_behind() {
        let mut ingest = Ingest::default();
        let refuse = |_: &Action| {
            Err(CommandError::UnknownObject {
                object: 7,
                count: 2,
            })
        };
        let acks = ingest.accept(1, &[impulse(1, 0)], 1, &refuse);
        assert_eq!(acks[0].status, wire::ACK_REFUSED);
        let reason = String::from_utf8_lossy(&acks[0].reason).into_owned();
        assert!(reason.contains('7') && reason.contains('2'), "{reason}");
        assert!(ingest.take_due(u64::MAX).is_empty());
        assert_eq!((ingest.accepted, ingest.refused), (0, 1));
    }

    #[test]
    fn a_flood_is_refused_and_not_stored() {
        let mut ingest = Ingest::default();
        let flood = vec![impulse(1, 0); MAX_PENDING + 10];
        let acks = ingest.accept(1, &flood, 1, &|_| Ok(()));
        let refused = acks.iter().filter(|a| a.status == wire::ACK_REFUSED);
        assert_eq!(refused.count(), 10);
        assert_eq!(ingest.take_due(1).len(), MAX_PENDING);
    }

    #[test]
    fn checkpoints_are_due_before_their_step_and_named_after_the_state() {
        let checkpoint = |sequence, apply_at_step| wire::Command {
            kind: wire::COMMAND_CHECKPOINT,
            sequence,
            apply_at_step,
            ..Default::default()
        };
        let mut ingest = Ingest::default();
        let fine = |_: &Action| Ok(());
        let refused = ingest.accept(1, &[checkpoint(1, 0)], 5, &fine);
        assert_eq!(refused[0].status, wire::ACK_REFUSED);
        ingest.checkpoints = Some(CheckpointFolder {
            folder: "/tmp/states".into(),
            session: "demo".into(),
        });
        let acks = ingest.accept(1, &[checkpoint(2, 0), checkpoint(3, 9)], 5, &fine);
        assert!(acks.iter().all(|ack| ack.status == wire::ACK_ACCEPTED));
        assert_eq!(acks[1].reason(), Ok("/tmp/states/demo-step-8.checkpoint"));
        assert_eq!(
            ingest.take_checkpoint(5),
            Some("/tmp/states/demo-step-4.checkpoint".into())
        );
        assert_eq!(ingest.take_checkpoint(8), None);
        assert!(ingest.take_checkpoint(9).is_some());
        assert_eq!(ingest.take_checkpoint(9), None);
    }

    #[test]
    fn a_step_beyond_reach_is_refused() {
        let mut ingest = Ingest::default();
        let acks = ingest.accept(1, &[impulse(1, u64::MAX)], 1, &|_| Ok(()));
        assert_eq!(acks[0].status, wire::ACK_REFUSED);
    }
}
