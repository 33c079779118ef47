//! Undo and redo: states before edits are kept as checkpoints, and going back to one keeps the state that was left.

use super::World;
use crate::command::CommandError;

/// States that are kept to go back to, at most.
const MOST_STATES: usize = 16;
/// Their bytes, at most; the newest is kept however large it is.
const MOST_BYTES: usize = 256 << 20;

/// States to go back to, and states that were left so, the newest last. It belongs to no state.
#[derive(Debug, Default)]
pub(super) struct History {
    undo: Vec<Vec<u8>>,
    redo: Vec<Vec<u8>>,
}

impl History {
    /// Keeps the state before an edit.
    fn edited(&mut self, state: Vec<u8>) {
        self.redo.clear();
        self.undo.push(state);
        self.trim();
    }

    /// Forgets the oldest where there are too many.
    fn trim(&mut self) {
        let mut bytes = 0;
        let newest = self.undo.iter().rev().take(MOST_STATES);
        let kept = newest.take_while(|state| {
            let is_first = bytes == 0;
            bytes += state.len();
            is_first || bytes <= MOST_BYTES
        });
        let forgotten = self.undo.len() - kept.count();
        self.undo.drain(..forgotten);
    }
}

impl World {
    /// Whether there is a state to go back to, or forth.
    pub(super) fn can_go(&self, back: bool) -> Result<(), CommandError> {
        let states = match back {
            true => &self.history.undo,
            false => &self.history.redo,
        };
        match (states.is_empty(), back) {
            (false, _) => Ok(()),
            (true, true) => Err(CommandError::NothingToUndo),
            (true, false) => Err(CommandError::NothingToRedo),
        }
    }

    /// How many edits can be undone, and how many undone ones done again.
    pub fn undoable(&self) -> [usize; 2] {
        [self.history.undo.len(), self.history.redo.len()]
    }

    /// Keeps the state that an edit is about to change.
    pub(super) fn remember(&mut self) {
        let state = self.checkpoint();
        self.history.edited(state);
    }

    /// Goes to the state before the newest edit, or to that which the newest undo left.
    pub(super) fn go(&mut self, back: bool) {
        let left = self.checkpoint();
        let history = &mut self.history;
        let (from, to) = match back {
            true => (&mut history.undo, &mut history.redo),
            false => (&mut history.redo, &mut history.undo),
        };
        if let Some(state) = from.pop() {
            to.push(left);
            self.go_to(&state);
        }
    }

    /// Goes to a state of this scene; the step count goes on.
    pub(super) fn go_to(&mut self, state: &[u8]) {
        let steps = self.state.progress.steps;
        // It was made here, of this scene: it fits. One that does not changes nothing.
        if self.restore(state).is_ok() {
            self.state.progress.steps = steps;
            self.report.step = steps;
            self.model.rules.commanded.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_states_are_kept_as_far_as_there_is_room() {
        let mut history = History::default();
        history.edited(vec![0; MOST_BYTES + 1]);
        assert_eq!(history.undo.len(), 1, "one, however large");
        for n in 1..40_u8 {
            history.edited(vec![n]);
        }
        assert_eq!(history.undo.len(), MOST_STATES);
        assert_eq!(history.undo.last(), Some(&vec![39]));
        history.redo.push(vec![]);
        history.edited(vec![0; MOST_BYTES]);
        assert_eq!(history.undo.len(), 1);
        assert!(history.redo.is_empty(), "another way was taken");
    }
}
