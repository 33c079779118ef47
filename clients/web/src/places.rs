//! Who is connected. Those that have shown the token have places that nobody without it can take.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::task::AbortHandle;

/// Connections that have shown the token, at a time.
pub const KNOWN: usize = 32;
/// Connections that have not; one more takes the place of the one that was silent longest.
pub const STRANGERS: usize = 64;

/// All places.
#[derive(Default)]
pub struct Places(Mutex<Table>);

#[derive(Default)]
struct Table {
    /// Counts connections and requests.
    count: u64,
    visitors: Vec<Visitor>,
}

struct Visitor {
    id: u64,
    /// The count when it was last heard of.
    heard: u64,
    is_known: bool,
    task: Option<AbortHandle>,
}

/// The place of one connection; dropped, it is free.
pub struct Place {
    places: Arc<Places>,
    id: u64,
}

impl Places {
    /// A place for a newcomer. Where too many have not shown the token, the one of them that was silent longest is hung up on.
    pub fn enter(self: &Arc<Self>) -> Place {
        let mut table = self.table();
        let strangers = table.visitors.iter().filter(|v| !v.is_known);
        if strangers.clone().count() >= STRANGERS {
            let longest = strangers.min_by_key(|v| v.heard).map(|v| v.id);
            let lost = longest.and_then(|id| table.remove(id));
            if let Some(task) = lost.and_then(|visitor| visitor.task) {
                task.abort();
            }
        }
        table.count += 1;
        let id = table.count;
        table.visitors.push(Visitor {
            id,
            heard: id,
            is_known: false,
            task: None,
        });
        Place {
            places: self.clone(),
            id,
        }
    }

    /// The task that ends where this connection loses its place.
    pub fn keep(&self, id: u64, task: AbortHandle) {
        if let Some(visitor) = self.table().find(id) {
            visitor.task = Some(task);
        }
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table {
    fn find(&mut self, id: u64) -> Option<&mut Visitor> {
        self.visitors.iter_mut().find(|v| v.id == id)
    }

    fn remove(&mut self, id: u64) -> Option<Visitor> {
        let at = self.visitors.iter().position(|v| v.id == id)?;
        Some(self.visitors.remove(at))
    }
}

impl Place {
    /// Number of the connection.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Notes that a request came.
    pub fn heard(&self) {
        let mut table = self.places.table();
        table.count += 1;
        let count = table.count;
        if let Some(visitor) = table.find(self.id) {
            visitor.heard = count;
        }
    }

    /// Notes that the token was shown; false where all places of those who know it are taken.
    pub fn shows_token(&self) -> bool {
        let mut table = self.places.table();
        let others = table.visitors.iter().filter(|v| v.is_known);
        let is_full = others.count() >= KNOWN;
        match table.find(self.id) {
            Some(visitor) => {
                visitor.is_known |= !is_full;
                visitor.is_known
            }
            None => false,
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.table().remove(self.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strangers_come_and_go_and_those_who_know_the_token_stay() {
        let places = Arc::new(Places::default());
        let ids = |all: &[Place]| all.iter().map(Place::id).collect::<Vec<_>>();
        let here = || {
            let table = places.table();
            table.visitors.iter().map(|v| v.id).collect::<Vec<_>>()
        };
        let mut known: Vec<Place> = (0..KNOWN).map(|_| places.enter()).collect();
        assert!(known.iter().all(Place::shows_token));
        let first: Vec<Place> = (0..STRANGERS).map(|_| places.enter()).collect();
        assert!(!first[0].shows_token());
        assert_eq!(here(), [ids(&known), ids(&first)].concat());
        // The first is heard, so the second is silent longest.
        first[0].heard();
        let more = places.enter();
        let left = [&ids(&first)[..1], &ids(&first)[2..], &[more.id()]].concat();
        assert_eq!(here(), [ids(&known), left].concat());
        // Whoever lost a place is not let in again by it.
        known.pop();
        assert!(!first[1].shows_token());
        assert!(first[0].shows_token() && first[0].shows_token() && !more.shows_token());
        drop((known, first, more));
        assert!(here().is_empty());
    }
}
