//! When two surfaces meet within a step.

/// Halvings of an interval in which something may pass through and be out again.
const HALVINGS: u32 = 12;
/// Steps of a turn that the search has in full; it is the coarser, the more a body turns beyond that, so that what is searched
/// for takes a bounded time at any spin.
const TURN_STEPS: f64 = 32.0;
/// Most steps of the root finder.
const STEPS: usize = 80;
/// Steps of turns that the search may take per body and [`SPAN`] of a frame.
const ALLOWED: f64 = 100_000.0;
/// Time for which those are [s]; a frame counts as one span at least.
const SPAN: f64 = 1.0 / 240.0;

/// What the search for impacts takes in a frame, tries that were undone included. A count, so that it ends at the same place
/// on every machine. What it finds is late where it ends: bodies then touch where they are at the start of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SearchEffort {
    /// Steps of turns that it may take in the frame.
    pub allowed: u64,
    /// Those that it took: one at least per body that it placed at a moment.
    pub taken: u64,
    /// Searches that were left off, or not begun.
    pub unfinished: u32,
}

impl SearchEffort {
    /// Allows what so many bodies may take in a frame of this length [s].
    pub fn allow(&mut self, bodies: usize, frame: f64) {
        self.allowed = (ALLOWED * bodies as f64 * (frame / SPAN).max(1.0)) as u64;
    }

    /// Takes note of a body that was placed with so many steps of its turn.
    pub fn place(&mut self, turn_steps: f64) {
        self.taken += turn_steps.max(1.0) as u64;
    }

    /// Whether no search may begin; then that is noted.
    pub fn ends(&mut self) -> bool {
        let ends = self.taken >= self.allowed;
        self.unfinished += u32::from(ends);
        ends
    }
}

/// Earliest time in `0..=end` at which `gap`, positive at 0, vanishes up to `close`, if it does. `speed` bounds how
/// fast it changes; `turn_steps` is what a value of it takes.
pub(super) fn first_contact(
    gap: &mut dyn FnMut(f64) -> f64,
    at_start: f64,
    end: f64,
    speed: f64,
    close: f64,
    turn_steps: f64,
) -> Option<f64> {
    let at_end = gap(end);
    let coarser = (turn_steps / TURN_STEPS).max(1.0).log2().ceil();
    let halvings = HALVINGS.saturating_sub(coarser as u32);
    search(gap, [0.0, end], [at_start, at_end], speed, close, halvings)
}

fn search(
    gap: &mut dyn FnMut(f64) -> f64,
    [t0, t1]: [f64; 2],
    [g0, g1]: [f64; 2],
    speed: f64,
    close: f64,
    halvings: u32,
) -> Option<f64> {
    if g0 <= 0.0 {
        return Some(t0);
    }
    if g1 <= 0.0 {
        return Some(root(gap, [t0, t1], [g0, g1], close));
    }
    // It would have to go down by `g0` and up by `g1`.
    if g0 + g1 >= speed * (t1 - t0) || halvings == 0 {
        return None;
    }
    let middle = 0.5 * (t0 + t1);
    let there = gap(middle);
    search(gap, [t0, middle], [g0, there], speed, close, halvings - 1)
        .or_else(|| search(gap, [middle, t1], [there, g1], speed, close, halvings - 1))
}

/// Root between a positive and a negative value: false position that halves the weight of an end that stays
/// (Illinois), from outside as far as it goes.
fn root(
    gap: &mut dyn FnMut(f64) -> f64,
    [mut t0, mut t1]: [f64; 2],
    [mut g0, mut g1]: [f64; 2],
    close: f64,
) -> f64 {
    let mut side = 0;
    for _ in 0..STEPS {
        if g0 <= close || t1 - t0 <= 1e-16 * t1 {
            break;
        }
        let t = (t0 + (t1 - t0) * g0 / (g0 - g1)).clamp(t0, t1);
        let g = gap(t);
        if g.abs() <= close {
            return t;
        }
        if g > 0.0 {
            (t0, g0) = (t, g);
            if side == 1 {
                g1 *= 0.5;
            }
            side = 1;
        } else {
            (t1, g1) = (t, g);
            if side == -1 {
                g0 *= 0.5;
            }
            side = -1;
        }
    }
    t0
}
