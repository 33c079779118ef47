//! Commands between their arrival and the step they take effect at.

use cosplat_ipc::{
    schema as wire,
    server::{Asked, Reply},
};
use cosplat_pacing::{
    late::{Awaited, CheckpointFolder, LateAnswers, MAX_PENDING},
    steering::{Scheduled, Steering},
};
use cosplat_sim_core::{Action, Command, CommandError};

use crate::convert::{Order, order_from_wire};

/// How far ahead a command may be scheduled [steps].
pub const MAX_STEPS_AHEAD: u64 = 10_000_000;

/// The inbox of the simulation: checks on arrival, hands over what is due.
#[derive(Debug, Default)]
pub struct Ingest {
    pending: Vec<Pending>,
    /// Whether the server may step.
    pub steering: Steering,
    /// Answers that wait for checkpoints or steps.
    pub late: LateAnswers,
    /// Commands accepted since start.
    pub accepted: u64,
    /// Commands refused since start.
    pub refused: u64,
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
            steering: Steering::new(paused),
            late: LateAnswers::new(checkpoints),
            ..Ingest::default()
        }
    }

    /// Commands to the world that wait for their step.
    pub fn waiting(&self) -> usize {
        self.pending.len()
    }

    /// Checks one request and answers every command of it, at once or, where one orders a checkpoint or steps, when
    /// these are there; `next_step` is the first step still to come.
    ///
    /// `check` judges an action against the world. A refused command leaves no trace but the count.
    pub fn accept(
        &mut self,
        asked: &Asked<'_>,
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Reply {
        let client = asked.header.client;
        let (acks, due) = self.accept_all(client, asked.commands, next_step, true, check);
        if due.is_empty() {
            return Reply::Now(acks);
        }
        self.late.expect((asked.ticket, acks), &due);
        Reply::Later
    }

    /// Checks the commands of a participant and answers each of them now.
    pub fn accept_now(
        &mut self,
        client: u64,
        commands: &[wire::Command],
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Vec<wire::Ack> {
        self.accept_all(client, commands, next_step, false, check).0
    }

    fn accept_all(
        &mut self,
        client: u64,
        commands: &[wire::Command],
        next_step: u64,
        may_be_late: bool,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> (Vec<wire::Ack>, Vec<(usize, u64, Awaited)>) {
        let mut due = Vec::new();
        let mut acks = Vec::with_capacity(commands.len());
        for (index, command) in commands.iter().enumerate() {
            let awaited = match command.kind {
                wire::COMMAND_CHECKPOINT => Some(Awaited::File),
                wire::COMMAND_STEP => Some(Awaited::Frame),
                _ => None,
            };
            let accepted = match awaited.is_some() && !may_be_late {
                true => Err("its answer comes later: send it on the service command".into()),
                false => self.accept_one(client, command, next_step, check),
            };
            acks.push(match accepted {
                Ok(step) => {
                    self.accepted += 1;
                    due.extend(awaited.map(|awaited| (index, step, awaited)));
                    wire::Ack::accepted(command.sequence, step)
                }
                Err(reason) => {
                    self.refused += 1;
                    wire::Ack::refused(command.sequence, &reason)
                }
            });
        }
        (acks, due)
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
        match order_from_wire(client, command).map_err(|error| error.to_string())? {
            Order::Checkpoint => self.late.check_file(step)?,
            Order::Steps(count) => {
                self.late.has_room()?;
                return self.steering.single_steps(count, step, next_step);
            }
            Order::Server(control) => {
                self.has_room(step == next_step)?;
                let order = Scheduled {
                    step,
                    client,
                    sequence: command.sequence,
                    control,
                };
                self.steering.order(order, next_step)?;
            }
            Order::World(action) => {
                match check(&action) {
                    // It will be held when that takes effect which was ordered before.
                    Err(CommandError::NotHeld { object, .. }) if self.will_hold(client, object) => {
                    }
                    // It will be there, or away, when that takes effect which was ordered before.
                    Err(CommandError::Removed { .. } | CommandError::Present { .. })
                        if self.will(|action| comes_or_goes(action, command.object as usize)) => {}
                    // There will be a state to go back to, or forth.
                    Err(CommandError::NothingToUndo)
                        if self.will(|action| action.is_edit() || *action == Action::Redo) => {}
                    Err(CommandError::NothingToRedo)
                        if self.will(|action| *action == Action::Undo) => {}
                    judged => judged.map_err(|error| error.to_string())?,
                }
                self.has_room(false)?;
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

    /// Whether a client has ordered to hold an object, and that has yet to take effect.
    fn will_hold(&self, client: u64, object: usize) -> bool {
        let mut pending = self.pending.iter().map(|pending| &pending.applied);
        pending.any(|applied| {
            let command = &applied.command;
            command.kind == wire::COMMAND_GRAB
                && (applied.client, command.object as usize) == (client, object)
        })
    }

    /// Whether something was ordered that has yet to take effect.
    fn will(&self, what: impl Fn(&Action) -> bool) -> bool {
        let mut pending = self.pending.iter();
        pending.any(|pending| what(&pending.command.action))
    }

    /// Whether one more command may wait; what takes effect `at_once` need not.
    fn has_room(&self, at_once: bool) -> Result<(), String> {
        let waiting = self.pending.len() + self.steering.waiting();
        if at_once || waiting < MAX_PENDING {
            return Ok(());
        }
        Err(format!(
            "{waiting} commands are waiting already, expected fewer than {MAX_PENDING}"
        ))
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

/// Whether an action may bring an object in or take it away.
fn comes_or_goes(action: &Action, id: usize) -> bool {
    match action {
        Action::Remove { object } | Action::BringIn { object, .. } => *object == id,
        Action::Undo | Action::Redo | Action::Reset | Action::Restore { .. } => true,
        _ => false,
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

    /// The answers to a request of `client`, which come at once.
    fn accept(
        ingest: &mut Ingest,
        client: u64,
        commands: &[wire::Command],
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Vec<wire::Ack> {
        let header = wire::CommandHeader {
            client,
            ..Default::default()
        };
        let asked = Asked {
            ticket: 1,
            port: 1,
            header: &header,
            commands,
        };
        match ingest.accept(&asked, next_step, check) {
            Reply::Now(acks) => acks,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn due_commands_come_in_step_client_sequence_order() {
        let mut ingest = Ingest::default();
        let fine = |_: &Action| Ok(());
        accept(&mut ingest, 2, &[impulse(1, 5), impulse(2, 4)], 3, &fine);
        accept(
            &mut ingest,
            1,
            &[impulse(9, 5), impulse(3, 5), impulse(4, 7)],
            3,
            &fine,
        );
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
        let acks = accept(&mut ingest, 1, &[impulse(1, 0), impulse(2, 2)], 8, &|_| {
            Ok(())
        });
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
        let acks = accept(&mut ingest, 1, &[impulse(1, 0)], 1, &refuse);
        assert_eq!(acks[0].status, wire::ACK_REFUSED);
        let reason = String::from_utf8_lossy(&acks[0].reason).into_owned();
        assert!(reason.contains('7') && reason.contains('2'), "{reason}");
        assert!(ingest.take_due(u64::MAX).is_empty());
        assert_eq!((ingest.accepted, ingest.refused), (0, 1));
    }

    #[test]
    fn an_edit_that_waits_can_be_undone_already() {
        let mut ingest = Ingest::default();
        let judge = |action: &Action| match action {
            Action::Undo => Err(CommandError::NothingToUndo),
            Action::Redo => Err(CommandError::NothingToRedo),
            _ => Ok(()),
        };
        let of = |kind| wire::Command {
            kind,
            ..Default::default()
        };
        let (undo, redo) = (of(wire::COMMAND_UNDO), of(wire::COMMAND_REDO));
        let early = accept(&mut ingest, 1, &[undo, redo], 1, &judge);
        assert!(early.iter().all(|ack| !ack.is_accepted()));
        let orders = [of(wire::COMMAND_REMOVE), undo, redo];
        let acks = accept(&mut ingest, 1, &orders, 1, &judge);
        assert!(acks.iter().all(wire::Ack::is_accepted), "{acks:?}");
    }

    #[test]
    fn a_flood_is_refused_and_not_stored() {
        let mut ingest = Ingest::default();
        let flood = vec![impulse(1, 0); MAX_PENDING + 10];
        let acks = accept(&mut ingest, 1, &flood, 1, &|_| Ok(()));
        let refused = acks.iter().filter(|a| a.status == wire::ACK_REFUSED);
        assert_eq!(refused.count(), 10);
        assert_eq!(ingest.take_due(1).len(), MAX_PENDING);
    }

    #[test]
    fn an_order_for_a_checkpoint_is_answered_late_or_refused_now() {
        let checkpoint = wire::Command {
            kind: wire::COMMAND_CHECKPOINT,
            sequence: 3,
            ..Default::default()
        };
        let fine = |_: &Action| Ok(());
        let refused = accept(&mut Ingest::default(), 1, &[checkpoint], 5, &fine);
        assert_eq!(refused[0].status, wire::ACK_REFUSED);
        let folder = CheckpointFolder {
            folder: "/tmp/states".into(),
            session: "demo".into(),
        };
        let mut ingest = Ingest::new(false, Some(folder));
        let asked = Asked {
            ticket: 8,
            port: 1,
            header: &wire::CommandHeader::default(),
            commands: &[impulse(2, 0), checkpoint],
        };
        assert_eq!(ingest.accept(&asked, 5, &fine), Reply::Later);
        let answers = ingest.late.written(5, &Ok("file".into()));
        let (ticket, acks) = &answers[0];
        assert_eq!((*ticket, acks.len()), (8, 2));
        assert_eq!((acks[0].sequence, acks[0].reason()), (2, Ok("")));
        assert_eq!((acks[1].sequence, acks[1].reason()), (3, Ok("file")));
    }

    #[test]
    fn a_full_inbox_still_takes_what_acts_at_once() {
        let mut ingest = Ingest::default();
        let fine = |_: &Action| Ok(());
        let flood = vec![impulse(1, 50); MAX_PENDING];
        accept(&mut ingest, 1, &flood, 1, &fine);
        let pause = |apply_at_step| wire::Command {
            kind: wire::COMMAND_PAUSE,
            apply_at_step,
            ..Default::default()
        };
        let acks = accept(&mut ingest, 2, &[pause(7), pause(0)], 1, &fine);
        assert_eq!(acks[0].status, wire::ACK_REFUSED);
        assert_eq!(acks[1].status, wire::ACK_ACCEPTED);
        assert_eq!(
            ingest.steering.permission(),
            cosplat_pacing::steering::Permission::Wait
        );
    }

    #[test]
    fn a_step_beyond_reach_is_refused() {
        let mut ingest = Ingest::default();
        let acks = accept(&mut ingest, 1, &[impulse(1, u64::MAX)], 1, &|_| Ok(()));
        assert_eq!(acks[0].status, wire::ACK_REFUSED);
    }
}
