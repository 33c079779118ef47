//! How much of the time may go into commands, so that a flood of them does not slow the steps.

/// Part of the time of a step that commands may take: checking, answering, applying, journalling.
const SHARE: f64 = 0.02;
/// What an expensive request may take in advance, in steps: for so long the next one waits at most.
const ADVANCE: f64 = 4.0;
/// How fast a costly command is forgotten, per step with commands.
const MEMORY: f64 = 0.9;

/// Time for commands: every step adds to it, every request takes from it.
///
/// What a command costs when it is applied is not known when it is accepted, so it is taken for what the costliest of
/// late has cost, and the account is put right when it is applied.
#[derive(Debug)]
pub struct Allowance {
    /// Time left [s]; negative after something that cost more than there was.
    left: f64,
    /// Expected cost of applying one command [s].
    per_command: f64,
}

impl Allowance {
    /// Time for the first step, of `period` [s].
    pub fn new(period: f64) -> Allowance {
        Allowance {
            left: SHARE * period,
            per_command: 0.0,
        }
    }

    /// A step of `period` [s] was made, or a time in which none is made has passed.
    pub fn grant(&mut self, period: f64) {
        let share = SHARE * period;
        self.left = self.left.max(-ADVANCE * share) + share;
        // What is not used is not saved up for a flood.
        self.left = self.left.min(share);
    }

    /// Whether there is time for a request, when `seconds` were spent since the last account and `accepted` commands
    /// wait to be applied since then.
    pub fn covers(&self, seconds: f64, accepted: usize) -> bool {
        self.left > seconds + accepted as f64 * self.per_command
    }

    /// `seconds` were spent on requests, and `accepted` commands of them wait to be applied.
    pub fn answered(&mut self, seconds: f64, accepted: usize) {
        self.left -= seconds + accepted as f64 * self.per_command;
    }

    /// Applying `count` commands took `seconds`.
    pub fn applied(&mut self, seconds: f64, count: usize) {
        if count > 0 {
            self.left -= seconds - count as f64 * self.per_command;
            self.per_command = (seconds / count as f64).max(MEMORY * self.per_command);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds that go into commands per second of steps, and the longest time without any taken [steps], in a flood
    /// of requests of 32 commands, each of which costs `answer` [s] at once and `apply` [s] later.
    fn flood(period: f64, answer: f64, apply: impl Fn(u32) -> f64) -> (f64, u32) {
        let mut allowance = Allowance::new(period);
        let (mut spent, mut longest, mut since) = (0.0, 0, 0);
        let steps = 2000;
        for step in 0..steps {
            let mut accepted = 0;
            let mut seconds = 0.0;
            while allowance.covers(seconds, accepted) {
                seconds += 32.0 * answer;
                accepted += 32;
            }
            allowance.answered(seconds, accepted);
            let cost = accepted as f64 * apply(step);
            allowance.applied(cost, accepted);
            spent += seconds + cost;
            since = if accepted > 0 { 0 } else { since + 1 };
            longest = longest.max(since);
            allowance.grant(period);
        }
        (spent / (f64::from(steps) * period), longest)
    }

    #[test]
    fn a_flood_takes_its_share_of_the_time_and_never_nothing() {
        // From small scenes, where answering costs most, to large ones, where applying does.
        for apply in [0.0, 1e-6, 1e-5, 1e-4] {
            let (share, longest) = flood(0.02, 1e-6, |_| apply);
            // The last costs 3.2 ms a request, one in five steps: 3.3 %.
            assert!(share < 0.035, "{apply}: {share}");
            assert!(share > 0.015, "{apply}: {share}");
            assert!(longest <= 4, "{apply}: {longest}");
        }
    }

    #[test]
    fn a_flood_that_changes_its_mind_takes_little_more() {
        // Cheap commands until the costly ones are forgotten, then a step full of these.
        for pause in [8, 50] {
            let apply = |step| if step % pause == 0 { 1e-4 } else { 1e-7 };
            let (share, longest) = flood(0.02, 1e-6, apply);
            assert!(share < 0.035, "{pause}: {share}");
            assert!(longest <= 4, "{pause}: {longest}");
        }
    }

    #[test]
    fn what_is_not_used_is_not_saved_up() {
        let mut allowance = Allowance::new(1.0);
        for _ in 0..1000 {
            allowance.grant(1.0);
        }
        assert!(allowance.covers(0.9 * SHARE, 0));
        assert!(!allowance.covers(1.1 * SHARE, 0));
    }
}
