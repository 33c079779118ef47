//! Standing aside for a simulation that is late.
//!
//! Drawing takes every core that it gets. At the lowest priority it still takes memory bandwidth and caches from those who
//! simulate, and where they cannot keep up with the clock, fewer pictures are the lesser evil.

use std::time::Duration;

/// Time over which the simulation's speed is averaged [s].
const MEMORY: f64 = 0.3;
/// Share of the clock that a simulation may be late: more than that is for lack of time, less is a hiccup.
const LATE: f64 = 0.01;
/// How many times as long as a picture took the next one waits at most: drawing then takes a fifth of the time.
const MOST: f64 = 4.0;
/// By how much that grows per picture for a share of the clock that the simulation is late beyond [`LATE`].
const GAIN: f64 = 25.0;
/// Bounds of what it grows by: it falls slowly.
const STEPS: [f64; 2] = [-0.25, 1.0];
/// Longest wait [s].
const LONGEST: f64 = 0.25;

/// Decides how long to wait between pictures.
#[derive(Debug, Default)]
pub(crate) struct Courtesy {
    /// Simulated time [s] and moment [ns] of the newest frame.
    newest: Option<(f64, u64)>,
    /// Simulated seconds, and seconds, of late.
    passed: [f64; 2],
    /// Length of a wait over that of a picture.
    share: f64,
}

impl Courtesy {
    /// Notes a frame of `sim_time` [s] that was published at `publish_ns`.
    pub(crate) fn note(&mut self, sim_time: f64, publish_ns: u64) {
        let Some((before, then)) = self.newest.replace((sim_time, publish_ns)) else {
            return;
        };
        let simulated = sim_time - before;
        let seconds = publish_ns.saturating_sub(then) as f64 * 1e-9;
        // After a reset, or from another run, time says nothing.
        if simulated > 0.0 && simulated.is_finite() && seconds > 0.0 {
            let kept = (-seconds / MEMORY).exp();
            self.passed[0] = self.passed[0] * kept + simulated;
            self.passed[1] = self.passed[1] * kept + seconds;
        }
    }

    /// How long to wait after a picture that took `busy`.
    pub(crate) fn wait(&mut self, busy: Duration) -> Duration {
        let [simulated, seconds] = self.passed;
        let late = match seconds > 0.0 {
            true => 1.0 - simulated / seconds,
            false => 0.0,
        };
        let step = (GAIN * (late - LATE)).clamp(STEPS[0], STEPS[1]);
        self.share = (self.share + step).clamp(0.0, MOST);
        Duration::from_secs_f64((self.share * busy.as_secs_f64()).min(LONGEST))
    }

    /// Whether pictures have to wait.
    pub(crate) fn is_standing_aside(&self) -> bool {
        self.share > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUSY: Duration = Duration::from_millis(20);

    /// Wait after each of some pictures of a simulation at this speed, one every third frame of 60 per simulated second.
    fn waits(courtesy: &mut Courtesy, speed: f64, pictures: u32) -> Vec<Duration> {
        let (mut time, mut ns) = courtesy.newest.unwrap_or((0.0, 1));
        let mut after = || {
            for _ in 0..3 {
                time += 1.0 / 60.0;
                ns += (1e9 / 60.0 / speed) as u64;
                courtesy.note(time, ns);
            }
            courtesy.wait(BUSY)
        };
        (0..pictures).map(|_| after()).collect()
    }

    #[test]
    fn a_simulation_that_keeps_up_is_drawn_without_waits() {
        for speed in [1.0, 3.0] {
            let waits = waits(&mut Courtesy::default(), speed, 20);
            assert_eq!(waits, [Duration::ZERO; 20], "at {speed}");
        }
    }

    #[test]
    fn a_late_one_gets_four_fifths_of_the_time_and_gives_them_back() {
        let mut courtesy = Courtesy::default();
        let late = waits(&mut courtesy, 0.8, 10);
        assert!(late.is_sorted());
        assert_eq!(late[9], 4 * BUSY);
        let on_time = waits(&mut courtesy, 1.05, 40);
        assert_eq!(on_time[39], Duration::ZERO);
        assert!(on_time.iter().all(|wait| *wait <= 4 * BUSY));
    }

    #[test]
    fn no_wait_is_long_whatever_the_clocks_say() {
        let mut courtesy = Courtesy::default();
        for (time, ns) in [
            (0.0, 5),
            (1e-9, 900_000_000_000),
            (f64::NAN, 900_000_000_001),
            (2.0, 3),
            (1.0, u64::MAX),
            (f64::INFINITY, 7),
        ] {
            courtesy.note(time, ns);
            let wait = courtesy.wait(Duration::from_secs(1000));
            assert!(wait <= Duration::from_millis(250), "{wait:?}");
        }
    }
}
