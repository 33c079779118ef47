//! The loop's side of lock-step: requests in, permission, answers out.

use std::{
    collections::BTreeSet,
    time::{Duration, Instant},
};

use cosplat_ipc::{
    schema::{self as wire, Ack},
    server::Reply,
};
use cosplat_pacing::{
    lockstep::{Answer, Lockstep, Now, refusal},
    outcome::StepOutcome,
};
use cosplat_sim_core::{Action, Command, StepReport};

use super::Server;

impl Server<'_> {
    /// The state that was published last.
    fn now(&self) -> Now {
        let report = self.world.report();
        Now {
            step: report.step,
            sim_time: report.sim_time,
            state_hash: report.state_hash,
        }
    }

    /// Whether participants say when a step is made.
    pub(super) fn is_locked(&self) -> bool {
        let lockstep = self.lockstep.as_ref();
        lockstep.is_some_and(|lockstep| !lockstep.freewheels())
    }

    /// Hears what participants ask for; says whether there was anything. They wait for nothing: the simulation waits
    /// for them.
    pub(super) fn hear_participants(&mut self) -> bool {
        let now = self.now();
        let (world, ingest, lockstep) = (&self.world, &mut self.ingest, &mut self.lockstep);
        let mut heard = false;
        self.ports.poll_steps(|asked| {
            heard = true;
            let header = asked.header;
            let said = match lockstep {
                None => Some(refusal(
                    "the server does not wait for participants: start it with --pace lockstep",
                    now,
                )),
                Some(lockstep) => lockstep.hear(asked.ticket, asked.port, header, now, || {
                    ingest.accept_now(&asked, now.step + 1, &|action| world.check(action))
                }),
            };
            let Some((done, acks)) = said else {
                return Reply::Later;
            };
            if done.cause != wire::RETURN_REFUSED {
                return Reply::Now((done, acks));
            }
            let reason = done.reason().unwrap_or_default();
            let refused = asked
                .commands
                .iter()
                .map(|c| Ack::refused(c.sequence, reason));
            Reply::Now((done, refused.collect()))
        });
        self.withdraw_orders();
        self.summary.commands_accepted = self.ingest.accepted;
        self.summary.commands_refused = self.ingest.refused;
        heard
    }

    /// Deals with participants who are late or gone.
    pub(super) fn watch_participants(&mut self, paused: bool) {
        let at = self.now();
        let Some(lockstep) = &mut self.lockstep else {
            return;
        };
        let ports: BTreeSet<u128> = self.ports.participant_ports().collect();
        let waits = |ticket| self.ports.participant_waits(ticket);
        let answers = lockstep.tick(Instant::now(), paused, &ports, waits, at);
        self.withdraw_orders();
        self.answer_participants(answers);
    }

    /// Drops what is left of requests that ended before their last step, and of participants who are gone.
    fn withdraw_orders(&mut self) {
        let called_off = self.lockstep.as_mut().map(Lockstep::called_off);
        for orders in called_off.into_iter().flatten() {
            self.ingest.withdraw(orders);
        }
    }

    /// Answers those whose last step this was, once its frame is sent.
    pub(super) fn tell_participants(
        &mut self,
        report: &StepReport,
        events: Vec<String>,
        spent: Duration,
    ) {
        let at = self.now();
        let Some(lockstep) = &mut self.lockstep else {
            return;
        };
        let outcome = StepOutcome {
            contacts: std::mem::take(&mut self.contacts),
            objects: &self.names.0,
            colliders: &self.names.1,
            events,
            quarantined: report.quarantined.len(),
        };
        let answers = lockstep.stepped(&outcome, spent, at);
        self.withdraw_orders();
        self.answer_participants(answers);
    }

    /// Tells all who still wait that no step follows.
    pub(super) fn dismiss_participants(&mut self) {
        let at = self.now();
        if let Some(lockstep) = &mut self.lockstep {
            let answers = lockstep.give_up(at);
            self.answer_participants(answers);
        }
    }

    fn answer_participants(&mut self, answers: Vec<Answer>) {
        for (ticket, said) in answers {
            self.ports.answer_steps(ticket, said);
        }
    }
}

/// What happened in a step that somebody may want to hear of, in sentences.
pub(super) fn events(
    notices: Vec<String>,
    report: &StepReport,
    commands: &[Command],
) -> Vec<String> {
    let mut events = notices;
    let left = report.left_domain.len();
    if report.stopped {
        events.push(format!(
            "{left} particles would leave the domain: the server has paused"
        ));
    } else if left > 0 {
        events.push(format!("{left} particles left the domain"));
    }
    for command in commands {
        match command.action {
            Action::Reset => events.push("the state was set back to the initial one".into()),
            Action::Restore { snapshot } => {
                events.push(format!("the state was set back to snapshot {snapshot}"));
            }
            Action::Undo => events.push("the newest edit was undone".into()),
            Action::Redo => events.push("the edit that was undone was done again".into()),
            _ => {}
        }
    }
    events
}
