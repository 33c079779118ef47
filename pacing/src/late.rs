//! Answers to commands that come later: when a checkpoint is written, when the steps that were ordered are made.

use std::{collections::BTreeMap, path::PathBuf};

use cosplat_ipc::schema::Ack;

use crate::waiting::{Order, Waiting};

/// Names the files of late.
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

/// Answers to one request, complete or not, and the ticket it goes by.
pub type Answers = (u64, Vec<Ack>);

/// What an answer waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Awaited {
    /// The file of the state before a step.
    File,
    /// The frame of a step.
    Frame,
}

/// An answer that waits.
#[derive(Clone, Copy, Debug)]
struct Due {
    awaited: Awaited,
    /// Which of the request's commands.
    index: usize,
}

/// Answers that wait.
#[derive(Debug, Default)]
pub struct LateAnswers {
    /// Where checkpoints go; none where they are not wanted.
    folder: Option<CheckpointFolder>,
    /// By the step before which the file is due, or whose frame it is.
    due: Waiting<Due>,
    /// Answers to requests of which some wait, by ticket.
    answers: BTreeMap<u64, Vec<Ack>>,
}

impl LateAnswers {
    /// None yet; checkpoints go to `folder`.
    pub fn new(folder: Option<CheckpointFolder>) -> LateAnswers {
        LateAnswers {
            folder,
            ..LateAnswers::default()
        }
    }

    /// Whether a checkpoint of the state before `step` can be ordered by `port`.
    ///
    /// # Errors
    /// A sentence that says why not.
    pub fn check_file(&self, port: u128, step: u64) -> Result<(), String> {
        let Some(to) = &self.folder else {
            return Err(
                "this server writes no checkpoints: start it with --checkpoints DIR".into(),
            );
        };
        let path = to.file(step - 1).display().to_string();
        let (length, room) = (path.len(), Ack::accepted(0, 0).reason.len());
        if length > room {
            return Err(format!(
                "the path of the checkpoint has {length} bytes, expected at most {room}: {path}"
            ));
        }
        self.has_room(port)
    }

    /// Whether one more answer to `port` may wait.
    ///
    /// # Errors
    /// A sentence that says why not.
    pub fn has_room(&self, port: u128) -> Result<(), String> {
        self.due.has_room(port, "checkpoints or steps")
    }

    /// Keeps the answers to a request until what is `due` (index of the command, its order, what it waits for) has come.
    pub fn expect(&mut self, (ticket, acks): Answers, due: &[(usize, Order, Awaited)]) {
        self.answers.insert(ticket, acks);
        for &(index, order, awaited) in due {
            self.due
                .push(Order { ticket, ..order }, Due { awaited, index });
        }
    }

    /// The file that is due before `step`.
    pub fn file_due(&self, step: u64) -> Option<PathBuf> {
        let to = self.folder.as_ref()?;
        let mut due = self.due.iter().take_while(|(order, _)| order.step <= step);
        let is_due = due.any(|(_, due)| due.awaited == Awaited::File);
        is_due.then(|| to.file(step - 1))
    }

    /// The file due before `step` is there, or why not. Returns the answers that waited for nothing else.
    pub fn written(&mut self, step: u64, outcome: &Result<String, String>) -> Vec<Answers> {
        let is_due = |order: &Order, due: &Due| due.awaited == Awaited::File && order.step <= step;
        self.settle(is_due, |_| outcome.clone())
    }

    /// The frame of `step` was sent. Returns the answers that waited for nothing else.
    pub fn sent(&mut self, step: u64) -> Vec<Answers> {
        let is_due = |order: &Order, due: &Due| due.awaited == Awaited::Frame && order.step <= step;
        self.settle(is_due, |_| Ok(String::new()))
    }

    /// The steps that were ordered are not made, for this reason.
    pub fn cancel_steps(&mut self, reason: &str) -> Vec<Answers> {
        let is_step = |_: &Order, due: &Due| due.awaited == Awaited::Frame;
        self.settle(is_step, |_| Err(reason.to_owned()))
    }

    /// What `is_off` is not done, for this reason.
    pub fn call_off(&mut self, is_off: impl Fn(&Order) -> bool, reason: &str) -> Vec<Answers> {
        self.settle(|order, _| is_off(order), |_| Err(reason.to_owned()))
    }

    /// `port` is gone: see [`Waiting::leave`].
    pub fn leave(&mut self, port: u128) -> usize {
        let dropped = self.due.leave(port);
        for (order, _) in &dropped {
            // Nobody is there to hear it.
            self.answers.remove(&order.ticket);
        }
        dropped.len()
    }

    /// Whether steps are waited for.
    pub fn awaits_steps(&self) -> bool {
        self.due
            .iter()
            .any(|(_, due)| due.awaited == Awaited::Frame)
    }

    /// The server ends: what has not come yet never does.
    pub fn give_up(&mut self) -> Vec<Answers> {
        let never = |order: &Order| Err(format!("the server ended before step {}", order.step));
        self.settle(|_, _| true, never)
    }

    /// Answers what `is_settled`, with its outcome.
    fn settle(
        &mut self,
        is_settled: impl Fn(&Order, &Due) -> bool,
        outcome: impl Fn(&Order) -> Result<String, String>,
    ) -> Vec<Answers> {
        let mut touched = Vec::new();
        for (order, due) in self.due.call_off(is_settled) {
            let answers = self.answers.get_mut(&order.ticket);
            if let Some(ack) = answers.and_then(|acks| acks.get_mut(due.index)) {
                *ack = match outcome(&order) {
                    Ok(file) => Ack::accepted_with_file(ack.sequence, order.step, &file),
                    Err(reason) => Ack::refused(ack.sequence, &reason),
                };
            }
            touched.push(order.ticket);
        }
        touched.retain(|ticket| self.due.iter().all(|(order, _)| order.ticket != *ticket));
        touched
            .into_iter()
            .filter_map(|ticket| Some((ticket, self.answers.remove(&ticket)?)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use cosplat_ipc::schema::{ACK_ACCEPTED, ACK_REFUSED};

    use super::*;

    fn at(step: u64) -> Order {
        Order {
            step,
            ..Order::default()
        }
    }

    fn folder() -> LateAnswers {
        LateAnswers::new(Some(CheckpointFolder {
            folder: "/tmp/states".into(),
            session: "demo".into(),
        }))
    }

    #[test]
    fn a_checkpoint_is_due_before_its_step_and_named_for_the_state() {
        let mut late = folder();
        assert!(LateAnswers::default().check_file(1, 5).is_err());
        assert_eq!(late.check_file(1, 5), Ok(()));
        assert_eq!(late.file_due(u64::MAX), None);
        late.expect((1, vec![Ack::accepted(7, 9)]), &[(0, at(9), Awaited::File)]);
        assert_eq!(late.file_due(8), None);
        let file = late.file_due(9).expect("due");
        assert_eq!(file, PathBuf::from("/tmp/states/demo-step-8.checkpoint"));
    }

    #[test]
    fn an_answer_waits_for_the_last_of_its_files() {
        let mut late = folder();
        let acks = (1..=3).map(|sequence| Ack::accepted(sequence, 5)).collect();
        late.expect(
            (4, acks),
            &[(0, at(5), Awaited::File), (2, at(9), Awaited::File)],
        );
        let written = Ok("here".to_owned());
        assert_eq!(late.written(5, &written), []);
        let full = Err("no space is left".to_owned());
        let answers = late.written(9, &full);
        assert_eq!(answers.len(), 1);
        let (ticket, acks) = &answers[0];
        assert_eq!((*ticket, acks[0].reason()), (4, Ok("here")));
        assert_eq!((acks[1].status, acks[1].reason()), (ACK_ACCEPTED, Ok("")));
        assert_eq!(acks[2].status, ACK_REFUSED);
        assert_eq!(acks[2].reason(), Ok("no space is left"));
        assert_eq!(late.written(u64::MAX, &written), []);
    }

    #[test]
    fn what_a_server_that_ends_has_not_written_is_said() {
        let mut late = folder();
        late.expect(
            (4, vec![Ack::accepted(1, 70)]),
            &[(0, at(70), Awaited::File)],
        );
        let answers = late.give_up();
        assert_eq!(answers[0].1[0].status, ACK_REFUSED);
        assert_eq!(
            answers[0].1[0].reason(),
            Ok("the server ended before step 70")
        );
    }

    #[test]
    fn steps_are_answered_by_their_last_frame_or_called_off() {
        let mut late = folder();
        let acks = || vec![Ack::accepted(1, 5), Ack::accepted(2, 7)];
        late.expect((4, acks()), &[(1, at(7), Awaited::Frame)]);
        late.expect((5, acks()), &[(1, at(9), Awaited::Frame)]);
        assert_eq!(late.file_due(u64::MAX), None);
        assert_eq!(late.sent(6), []);
        let answers = late.sent(7);
        assert_eq!((answers.len(), answers[0].0), (1, 4));
        assert_eq!(answers[0].1[1].applied_at_step, 7);
        let answers = late.cancel_steps("the server paused itself");
        assert_eq!((answers[0].0, answers[0].1[1].status), (5, ACK_REFUSED));
    }
}
