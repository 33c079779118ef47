//! When the next frame is due.

use std::time::{Duration, Instant};

/// How simulated time follows wall time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// One simulated second per wall second, slower when the machine cannot keep up.
    Realtime,
    /// As fast as possible.
    Free,
    /// As fast as participants permit; in real time while there is none.
    Lockstep,
}

/// Frames of delay that are caught up; beyond that the clock is moved instead of bursting.
const CATCH_UP_FRAMES: u32 = 3;

/// Tells how long to wait before the next frame.
#[derive(Debug)]
pub struct Pacer {
    pace: Pace,
    period: Duration,
    next: Instant,
}

impl Pacer {
    /// A pacer whose first frame is due at `now`.
    pub fn new(pace: Pace, frame_rate: f64, now: Instant) -> Pacer {
        Pacer {
            pace,
            period: Duration::from_secs_f64(1.0 / frame_rate),
            next: now,
        }
    }

    /// Time left until the next frame is due, zero when it is.
    pub fn left(&self, now: Instant) -> Duration {
        match self.pace {
            Pace::Free => Duration::ZERO,
            Pace::Realtime | Pace::Lockstep => self.next.saturating_duration_since(now),
        }
    }

    /// Books a frame made at `now`.
    pub fn frame_done(&mut self, now: Instant) {
        self.next += self.period;
        if now > self.next + self.period * CATCH_UP_FRAMES {
            self.next = now;
        }
    }

    /// Starts the clock anew, after a pause.
    pub fn restart(&mut self, now: Instant) {
        self.next = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn realtime_frames_are_due_one_period_apart() {
        let start = Instant::now();
        let mut pacer = Pacer::new(Pace::Realtime, 50.0, start);
        assert_eq!(pacer.left(start), Duration::ZERO);
        pacer.frame_done(start);
        assert_eq!(pacer.left(start), Duration::from_millis(20));
    }

    #[test]
    fn a_short_delay_is_caught_up_and_a_long_one_is_not() {
        let start = Instant::now();
        let mut pacer = Pacer::new(Pace::Realtime, 50.0, start);
        pacer.frame_done(start + Duration::from_millis(45));
        assert_eq!(
            pacer.left(start + Duration::from_millis(45)),
            Duration::ZERO
        );
        let late = start + Duration::from_secs(2);
        pacer.frame_done(late);
        pacer.frame_done(late);
        assert_eq!(pacer.left(late), Duration::from_millis(20));
    }

    #[test]
    fn free_pace_never_waits() {
        let start = Instant::now();
        let mut pacer = Pacer::new(Pace::Free, 50.0, start);
        pacer.frame_done(start);
        assert_eq!(pacer.left(start), Duration::ZERO);
    }
}
