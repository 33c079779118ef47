//! Standing aside for a simulation that is late.
//!
//! Drawing takes every core that it gets. At the lowest priority it still takes memory bandwidth and caches from those who
//! simulate, and where they cannot keep up with the clock, fewer pictures are the lesser evil.

use std::time::Duration;

use cosplat_ipc::schema::{FRAME_FLAG_PAUSED, FrameHeader};

/// Time over which the simulation's speed is averaged [s]. With [`LATE`], 15 ms are not late: a server catches that up within a frame.
const MEMORY: f64 = 1.5;
/// Share of the clock that a simulation may be late: more than that is for lack of time, less is a hiccup.
const LATE: f64 = 0.01;
/// Simulated times of a frame that one counts at most: what takes longer is not the speed of a simulation.
const HELD_UP: f64 = 2.0;
/// How many times as long as a picture took the next one waits at most: drawing then takes a fifth of the time.
const MOST: f64 = 4.0;
/// By how much that grows per picture for a share of the clock that the simulation is late beyond [`LATE`].
const GAIN: f64 = 100.0;
/// Bounds of what it grows by: it falls more slowly.
const STEPS: [f64; 2] = [-0.5, 1.0];
/// Longest wait [s].
const LONGEST: f64 = 0.25;

/// Decides how long to wait between pictures.
#[derive(Debug)]
pub(crate) struct Courtesy {
    /// Simulated time [s] and moment [ns] of the newest frame, if it was not the last one before a pause.
    newest: Option<(f64, u64)>,
    /// Simulated seconds, and seconds, of late.
    passed: [f64; 2],
    /// Length of a wait over that of a picture.
    share: f64,
}

impl Default for Courtesy {
    /// A simulation that was on time so far: one late frame says little.
    fn default() -> Self {
        Self {
            newest: None,
            passed: [MEMORY; 2],
            share: 0.0,
        }
    }
}

impl Courtesy {
    /// Notes a frame. The time of a pause does not count.
    pub(crate) fn note(&mut self, frame: &FrameHeader) {
        let is_paused = frame.flags & FRAME_FLAG_PAUSED != 0;
        let noted = (!is_paused).then_some((frame.sim_time, frame.publish_ns));
        let Some((before, then)) = std::mem::replace(&mut self.newest, noted) else {
            return;
        };
        let simulated = frame.sim_time - before;
        let seconds = frame.publish_ns.saturating_sub(then) as f64 * 1e-9;
        // After a reset, or from another run, time says nothing.
        if simulated > 0.0 && simulated.is_finite() && seconds > 0.0 {
            let seconds = seconds.min(HELD_UP * simulated);
            let kept = (-seconds / MEMORY).exp();
            self.passed[0] = self.passed[0] * kept + simulated;
            self.passed[1] = self.passed[1] * kept + seconds;
        }
    }

    /// How long to wait after a picture that took `busy`.
    pub(crate) fn wait(&mut self, busy: Duration) -> Duration {
        let [simulated, seconds] = self.passed;
        let late = 1.0 - simulated / seconds;
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
    use bytemuck::Zeroable;

    use super::*;

    const BUSY: Duration = Duration::from_millis(20);
    const FRAME: f64 = 1.0 / 60.0;

    fn frame(sim_time: f64, publish_ns: u64, flags: u32) -> FrameHeader {
        FrameHeader {
            sim_time,
            publish_ns,
            flags,
            ..FrameHeader::zeroed()
        }
    }

    /// Wait after each of some pictures, one every third frame of 60 per simulated second; frame `n` takes `seconds(n)`.
    fn waits(
        courtesy: &mut Courtesy,
        pictures: u64,
        seconds: impl Fn(u64) -> f64,
    ) -> Vec<Duration> {
        let (mut time, mut ns) = courtesy.newest.unwrap_or((0.0, 1));
        let mut after = |n| {
            for n in 3 * n..3 * n + 3 {
                time += FRAME;
                ns += (1e9 * seconds(n)) as u64;
                courtesy.note(&frame(time, ns, 0));
            }
            courtesy.wait(BUSY)
        };
        (0..pictures).map(&mut after).collect()
    }

    #[test]
    fn a_simulation_that_keeps_up_is_drawn_without_waits() {
        for speed in [1.0, 3.0] {
            let waits = waits(&mut Courtesy::default(), 20, |_| FRAME / speed);
            assert_eq!(waits, [Duration::ZERO; 20], "at {speed}");
        }
    }

    #[test]
    fn a_late_one_gets_four_fifths_of_the_time_and_gives_them_back() {
        let mut courtesy = Courtesy::default();
        let late = waits(&mut courtesy, 10, |_| FRAME / 0.8);
        assert!(late.is_sorted());
        assert_eq!(late[9], 4 * BUSY);
        let on_time = waits(&mut courtesy, 40, |_| FRAME / 1.05);
        assert_eq!(on_time[39], Duration::ZERO);
        assert!(on_time.iter().all(|wait| *wait <= 4 * BUSY));
    }

    #[test]
    fn what_is_caught_up_is_not_late() {
        // Every tenth frame takes 10 ms too long, and the next five make up for it.
        let uneven = |n: u64| match n % 10 {
            0 => FRAME + 0.01,
            1..=5 => FRAME - 0.002,
            _ => FRAME,
        };
        let waits = waits(&mut Courtesy::default(), 40, uneven);
        assert_eq!(waits, [Duration::ZERO; 40]);
    }

    #[test]
    fn a_pause_is_not_late() {
        let mut courtesy = Courtesy::default();
        courtesy.note(&frame(0.0, 1, FRAME_FLAG_PAUSED));
        courtesy.note(&frame(FRAME, 5_000_000_000, 0));
        assert_eq!(courtesy.wait(BUSY), Duration::ZERO);
        // One that came after its frame was sent, and so is not known as one, counts as one frame of delay.
        courtesy.note(&frame(2.0 * FRAME, 95_000_000_000, 0));
        assert!(courtesy.wait(BUSY) <= BUSY);
        let waits = waits(&mut courtesy, 40, |_| FRAME);
        assert_eq!(waits[39], Duration::ZERO);
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
            courtesy.note(&frame(time, ns, 0));
            let wait = courtesy.wait(Duration::from_secs(1000));
            assert!(wait <= Duration::from_millis(250), "{wait:?}");
        }
    }
}
