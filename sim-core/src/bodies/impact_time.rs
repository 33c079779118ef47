//! When two surfaces meet within a step.

/// Halvings of an interval in which something may pass through and be out again.
const HALVINGS: u32 = 12;
/// Most steps of the root finder.
const STEPS: usize = 80;

/// Earliest time in `0..=end` at which `gap`, positive at 0, vanishes up to `close`, if it does. `speed` bounds how
/// fast it changes.
pub(super) fn first_contact(
    gap: &mut dyn FnMut(f64) -> f64,
    at_start: f64,
    end: f64,
    speed: f64,
    close: f64,
) -> Option<f64> {
    let at_end = gap(end);
    search(gap, [0.0, end], [at_start, at_end], speed, close, HALVINGS)
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
