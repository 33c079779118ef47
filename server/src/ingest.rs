//! Commands between their arrival and the step they take effect at.

use cosplat_ipc::{
    schema as wire,
    server::{Asked, Departed, Reply},
};
use cosplat_pacing::{
    late::{Answers, Awaited, CheckpointFolder, LateAnswers},
    lockstep::CalledOff,
    steering::Steering,
    waiting::{self, Waiting, check_cancel},
};
use cosplat_sim_core::{Action, Command, CommandError};

use crate::convert::{Order, order_from_wire};

/// How far ahead a command may be scheduled [steps].
pub const MAX_STEPS_AHEAD: u64 = 10_000_000;

/// Why an order is not carried out that was cancelled.
const CANCELLED: &str = "it was cancelled";

/// The inbox of the simulation: checks on arrival, hands over what is due.
#[derive(Debug, Default)]
pub struct Ingest {
    /// What was ordered for the next step. It has room of its own, so that what waits for later ones never keeps it out.
    next: Waiting<Pending>,
    /// What was ordered for later steps.
    later: Waiting<Pending>,
    /// Answers to requests of which nothing is waited for any more.
    answers: Vec<Answers>,
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
        self.next.len() + self.later.len()
    }

    /// Answers to earlier requests that were cancelled.
    pub fn take_answers(&mut self) -> Vec<Answers> {
        std::mem::take(&mut self.answers)
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
        let from = origin(asked, asked.header.client);
        let (acks, due) = self.accept_all(from, asked.commands, next_step, true, check);
        if due.is_empty() {
            return Reply::Now(acks);
        }
        self.late.expect((asked.ticket, acks), &due);
        Reply::Later
    }

    /// Checks the commands of a participant and answers each of them now.
    pub fn accept_now(
        &mut self,
        asked: &Asked<'_, wire::StepRequest>,
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Vec<wire::Ack> {
        let from = origin(asked, asked.header.client);
        self.accept_all(from, asked.commands, next_step, false, check)
            .0
    }

    fn accept_all(
        &mut self,
        from: waiting::Order,
        commands: &[wire::Command],
        next_step: u64,
        may_be_late: bool,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> (Vec<wire::Ack>, Vec<(usize, waiting::Order, Awaited)>) {
        let mut due: Vec<(usize, waiting::Order, Awaited)> = Vec::new();
        let mut acks = Vec::with_capacity(commands.len());
        for (index, command) in commands.iter().enumerate() {
            let awaited = match command.kind {
                wire::COMMAND_CHECKPOINT => Some(Awaited::File),
                wire::COMMAND_STEP => Some(Awaited::Frame),
                _ => None,
            };
            let from = waiting::Order {
                sequence: command.sequence,
                ..from
            };
            let accepted = match awaited.is_some() && !may_be_late {
                true => Err("its answer comes later: send it on the service command".into()),
                false => self.accept_one(from, command, next_step, check),
            };
            if accepted.is_ok() && command.kind == wire::COMMAND_CANCEL {
                // What was ordered right before it as well.
                for (index, order, _) in due.drain(..) {
                    acks[index] = wire::Ack::refused(order.sequence, CANCELLED);
                }
            }
            acks.push(match accepted {
                Ok(step) => {
                    self.accepted += 1;
                    due.extend(
                        awaited.map(|awaited| (index, waiting::Order { step, ..from }, awaited)),
                    );
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
        from: waiting::Order,
        command: &wire::Command,
        next_step: u64,
        check: &dyn Fn(&Action) -> Result<(), CommandError>,
    ) -> Result<u64, String> {
        let client = from.client;
        let step = command.apply_at_step.max(next_step);
        if step - next_step > MAX_STEPS_AHEAD {
            return Err(format!(
                "apply_at_step is {step}, expected at most {}",
                next_step + MAX_STEPS_AHEAD
            ));
        }
        match order_from_wire(client, command).map_err(|error| error.to_string())? {
            Order::Checkpoint => self.late.check_file(from.port, step)?,
            Order::Steps(count) => {
                self.late.has_room(from.port)?;
                return self.steering.single_steps(count, step, next_step);
            }
            Order::Cancel { of_all } => {
                check_cancel(step, next_step)?;
                self.cancel(|order| of_all || order.client == client);
            }
            Order::Server(control) => {
                let order = waiting::Order { step, ..from };
                self.steering.order(order, control, next_step)?;
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
                let (queue, what) = match step == next_step {
                    true => (&mut self.next, "the next step"),
                    false => (&mut self.later, "later steps"),
                };
                queue.has_room(from.port, what)?;
                let pending = Pending {
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
                };
                queue.push(waiting::Order { step, ..from }, pending);
            }
        }
        Ok(step)
    }

    /// All that has yet to take effect.
    fn pending(&self) -> impl Iterator<Item = &Pending> {
        let pending = self.later.iter().chain(self.next.iter());
        pending.map(|(_, pending)| pending)
    }

    /// Whether a client has ordered to hold an object, and that has yet to take effect.
    fn will_hold(&self, client: u64, object: usize) -> bool {
        let mut pending = self.pending().map(|pending| &pending.applied);
        pending.any(|applied| {
            let command = &applied.command;
            command.kind == wire::COMMAND_GRAB
                && (applied.client, command.object as usize) == (client, object)
        })
    }

    /// Whether something was ordered that has yet to take effect.
    fn will(&self, what: impl Fn(&Action) -> bool) -> bool {
        self.pending().any(|pending| what(&pending.command.action))
    }

    /// Drops what waits and `is_off`, and keeps the answers to those who wait for it.
    fn cancel(&mut self, is_off: impl Fn(&waiting::Order) -> bool) {
        let dropped = self.call_off(&is_off);
        let had_steps = self.late.awaits_steps();
        let answers = self.late.call_off(&is_off, CANCELLED);
        self.answers.extend(answers);
        if had_steps && !self.late.awaits_steps() {
            self.steering.cancel_steps();
        }
        tracing::info!("{dropped} waiting orders were cancelled");
    }

    /// Drops what waits and `is_off`, and says how many that were.
    fn call_off(&mut self, is_off: impl Fn(&waiting::Order) -> bool) -> usize {
        let of_world = [&mut self.next, &mut self.later]
            .into_iter()
            .map(|queue| queue.call_off(|order, _| is_off(order)).len())
            .sum::<usize>();
        let of_server = self.steering.later();
        of_world + of_server.call_off(|order, _| is_off(order)).len()
    }

    /// A port is gone. What a dead process ordered is dropped; what one ordered that has ended waits on, as far as there is
    /// room for those who are gone: so `cosplat ctl --at-step` does not have to stay.
    pub fn depart(&mut self, departed: Departed) {
        let Departed { port, died } = departed;
        let dropped = match died {
            true => {
                let dropped = self.call_off(|order| order.port == port);
                // Nobody is there to hear it.
                self.late.call_off(|order| order.port == port, "gone");
                dropped
            }
            false => {
                self.next.leave(port).len()
                    + self.later.leave(port).len()
                    + self.steering.later().leave(port).len()
                    + self.late.leave(port)
            }
        };
        if dropped > 0 {
            tracing::warn!(
                "{dropped} waiting orders of a client that is gone were dropped: it {}",
                match died {
                    true => "died",
                    false => "left more than there is room for",
                }
            );
        }
    }

    /// What a participant ordered is not carried out any more.
    pub fn withdraw(&mut self, orders: CalledOff) {
        let dropped = self.call_off(|order| match orders {
            CalledOff::Port(port) => order.port == port,
            CalledOff::Request { port, ticket } => (order.port, order.ticket) == (port, ticket),
        });
        if dropped > 0 {
            tracing::info!("{dropped} waiting orders of a participant were dropped");
        }
    }

    /// Takes out what is due at `step`, in the order of application.
    pub fn take_due(&mut self, step: u64) -> Vec<Pending> {
        let mut due = self.later.take_due(step);
        // These came after those that were ordered for later.
        due.extend(self.next.take_due(step));
        due.sort_by_key(|(order, _)| (order.step, order.client, order.sequence));
        due.into_iter().map(|(_, pending)| pending).collect()
    }
}

/// Where the orders of a request come from.
fn origin<H>(asked: &Asked<'_, H>, client: u64) -> waiting::Order {
    waiting::Order {
        client,
        port: asked.port,
        ticket: asked.ticket,
        ..waiting::Order::default()
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
mod tests;
