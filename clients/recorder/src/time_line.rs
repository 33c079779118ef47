//! Clocks of a recording: simulated time as message time, and the wall clock.

use std::time::SystemTime;

use cosplat_ipc::monotonic_ns;

/// Simulated time as the file's time line, which never runs backwards: after a reset or a restart of the server the
/// clock goes on one frame after the last message.
#[derive(Debug, Default)]
pub(crate) struct TimeLine {
    /// Added to simulated time [ns].
    base: u64,
    /// Latest simulated time seen [ns].
    latest: u64,
    /// Time between frames [ns].
    pub(crate) period: u64,
}

impl TimeLine {
    /// Time of a message of simulated time `sim_time` [s] on the time line [ns].
    pub(crate) fn at(&mut self, sim_time: f64) -> u64 {
        if !sim_time.is_finite() {
            return self.now();
        }
        // The cast saturates: negative times become 0.
        let ns = (sim_time * 1e9).round() as u64;
        // Half a period of slack: messages of one step may carry times that differ in the last digit.
        if ns.saturating_add(self.period / 2) < self.latest {
            self.base = self
                .base
                .saturating_add(self.latest)
                .saturating_add(self.period)
                .saturating_sub(ns);
            self.latest = ns;
        }
        self.latest = self.latest.max(ns);
        self.base.saturating_add(ns)
    }

    /// Time of the newest message [ns].
    pub(crate) fn now(&self) -> u64 {
        self.base.saturating_add(self.latest)
    }
}

/// Unix time minus `CLOCK_MONOTONIC` [ns].
pub(crate) fn wall_offset() -> i64 {
    let wall = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0, |since| since.as_nanos() as i64);
    wall - monotonic_ns() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_line_never_runs_backwards() {
        let mut time = TimeLine {
            period: 10,
            ..Default::default()
        };
        let ns = |n: u64| n as f64 * 1e-9;
        assert_eq!(time.at(ns(10)), 10);
        assert_eq!(time.at(ns(20)), 20);
        assert_eq!(time.at(ns(0)), 30, "a reset goes on one period later");
        assert_eq!(time.at(ns(10)), 40);
        assert_eq!(time.at(ns(0)), 50, "and again");
        assert_eq!(time.now(), 50);
        assert_eq!(time.at(f64::NAN), 50);
        assert_eq!(time.at(-1.0), 50);
        assert_eq!(time.at(f64::INFINITY), 50);
        assert_eq!(time.at(1e300), u64::MAX);
        assert_eq!(time.at(0.0), u64::MAX);
    }
}
