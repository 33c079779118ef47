//! Warnings about what may happen a thousand times a second.

use std::time::{Duration, Instant};

/// Warnings of one kind are at least this far apart.
const PERIOD: Duration = Duration::from_secs(1);

/// Counts what happens and says so once a second at most.
pub(super) struct Repeated {
    what: &'static str,
    unsaid: u64,
    said: Option<Instant>,
}

impl Repeated {
    /// Nothing yet; `what` is the sentence without its count and its example.
    pub fn new(what: &'static str) -> Self {
        Self {
            what,
            unsaid: 0,
            said: None,
        }
    }

    /// It happened `now`; `example` says what exactly.
    pub fn warn(&mut self, now: Instant, example: &str) {
        if let Some(count) = self.count(now) {
            tracing::warn!("{count} {}, the last: {example}", self.what);
        }
    }

    /// How often it happened since the last warning, when it is time for one.
    fn count(&mut self, now: Instant) -> Option<u64> {
        self.unsaid += 1;
        let is_due = self
            .said
            .is_none_or(|said| now.saturating_duration_since(said) >= PERIOD);
        is_due.then(|| {
            self.said = Some(now);
            std::mem::take(&mut self.unsaid)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_losses_are_one_warning_a_second_and_all_counted() {
        let (start, mut lost) = (Instant::now(), Repeated::new("answers were lost"));
        let said: Vec<_> = (0..=2500)
            .filter_map(|ms| lost.count(start + Duration::from_millis(ms)))
            .collect();
        assert_eq!(said, [1, 1000, 1000]);
    }
}
