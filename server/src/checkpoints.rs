//! Checkpoints that clients ordered, and the answers that wait for their files.

use std::{collections::BTreeMap, path::PathBuf};

use cosplat_ipc::schema::Ack;

use crate::ingest::MAX_PENDING;

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

/// Answers to one request, complete or not, and the ticket it goes by.
pub type Answers = (u64, Vec<Ack>);

/// An answer that waits for a file.
#[derive(Clone, Copy, Debug)]
struct Due {
    /// Step before which the file is due.
    step: u64,
    /// The request.
    ticket: u64,
    /// Which of its commands.
    index: usize,
}

/// Checkpoints that are not written yet.
#[derive(Debug, Default)]
pub struct Checkpoints {
    /// Where they go; none where they are not wanted.
    folder: Option<CheckpointFolder>,
    due: Vec<Due>,
    /// Answers to requests of which some wait, by ticket.
    answers: BTreeMap<u64, Vec<Ack>>,
}

impl Checkpoints {
    /// None ordered yet.
    pub fn new(folder: Option<CheckpointFolder>) -> Checkpoints {
        Checkpoints {
            folder,
            ..Checkpoints::default()
        }
    }

    /// Whether a checkpoint of the state before `step` can be ordered.
    ///
    /// # Errors
    /// A sentence that says why not.
    pub fn check(&self, step: u64) -> Result<(), String> {
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
        if self.due.len() >= MAX_PENDING {
            return Err(format!(
                "{MAX_PENDING} checkpoints are waiting already, expected fewer"
            ));
        }
        Ok(())
    }

    /// Keeps the answers to a request until the checkpoints at `due` (index of the command, step) are written.
    pub fn expect(&mut self, (ticket, acks): Answers, due: &[(usize, u64)]) {
        self.answers.insert(ticket, acks);
        self.due.extend(due.iter().map(|&(index, step)| Due {
            step,
            ticket,
            index,
        }));
    }

    /// The file that is due before `step`.
    pub fn file_due(&self, step: u64) -> Option<PathBuf> {
        let to = self.folder.as_ref()?;
        let is_due = self.due.iter().any(|due| due.step <= step);
        is_due.then(|| to.file(step - 1))
    }

    /// The file due before `step` is there, or why not. Returns the answers that waited for nothing else.
    pub fn written(&mut self, step: u64, outcome: &Result<String, String>) -> Vec<Answers> {
        self.settle(|due| (due.step <= step).then(|| outcome.clone()))
    }

    /// The server ends: what is not written yet never is.
    pub fn give_up(&mut self) -> Vec<Answers> {
        self.settle(|due| Some(Err(format!("the server ended before step {}", due.step))))
    }

    fn settle(&mut self, outcome: impl Fn(&Due) -> Option<Result<String, String>>) -> Vec<Answers> {
        let mut touched = Vec::new();
        self.due.retain(|due| {
            let Some(outcome) = outcome(due) else {
                return true;
            };
            let answers = self.answers.get_mut(&due.ticket);
            if let Some(ack) = answers.and_then(|acks| acks.get_mut(due.index)) {
                *ack = match outcome {
                    Ok(file) => Ack::accepted_with_file(ack.sequence, due.step, &file),
                    Err(reason) => Ack::refused(ack.sequence, &reason),
                };
            }
            touched.push(due.ticket);
            false
        });
        touched.retain(|ticket| self.due.iter().all(|due| due.ticket != *ticket));
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

    fn checkpoints() -> Checkpoints {
        Checkpoints::new(Some(CheckpointFolder {
            folder: "/tmp/states".into(),
            session: "demo".into(),
        }))
    }

    #[test]
    fn a_checkpoint_is_due_before_its_step_and_named_for_the_state() {
        let mut checkpoints = checkpoints();
        assert!(Checkpoints::default().check(5).is_err());
        assert_eq!(checkpoints.check(5), Ok(()));
        assert_eq!(checkpoints.file_due(u64::MAX), None);
        checkpoints.expect((1, vec![Ack::accepted(7, 9)]), &[(0, 9)]);
        assert_eq!(checkpoints.file_due(8), None);
        let file = checkpoints.file_due(9).expect("due");
        assert_eq!(file, PathBuf::from("/tmp/states/demo-step-8.checkpoint"));
    }

    #[test]
    fn an_answer_waits_for_the_last_of_its_files() {
        let mut checkpoints = checkpoints();
        let acks = (1..=3).map(|sequence| Ack::accepted(sequence, 5)).collect();
        checkpoints.expect((4, acks), &[(0, 5), (2, 9)]);
        let written = Ok("here".to_owned());
        assert_eq!(checkpoints.written(5, &written), []);
        let full = Err("no space is left".to_owned());
        let answers = checkpoints.written(9, &full);
        assert_eq!(answers.len(), 1);
        let (ticket, acks) = &answers[0];
        assert_eq!((*ticket, acks[0].reason()), (4, Ok("here")));
        assert_eq!((acks[1].status, acks[1].reason()), (ACK_ACCEPTED, Ok("")));
        assert_eq!(acks[2].status, ACK_REFUSED);
        assert_eq!(acks[2].reason(), Ok("no space is left"));
        assert_eq!(checkpoints.written(u64::MAX, &written), []);
    }

    #[test]
    fn what_a_server_that_ends_has_not_written_is_said() {
        let mut checkpoints = checkpoints();
        checkpoints.expect((4, vec![Ack::accepted(1, 70)]), &[(0, 70)]);
        let answers = checkpoints.give_up();
        assert_eq!(answers[0].1[0].status, ACK_REFUSED);
        assert_eq!(
            answers[0].1[0].reason(),
            Ok("the server ended before step 70")
        );
    }
}
