//! What makes a run slow, in words: phases of a step, and the objects that take most of its time.

use std::fmt::Write as _;

/// What limits a substep, by its number on the wire.
pub const LIMITS: [&str; 4] = ["frame", "sound", "velocity", "deformation"];

/// What an object takes of the time of all.
pub struct CostShare<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its share, 0..=1.
    pub share: f64,
    /// Its substeps, with what they are counted over.
    pub substeps: String,
    /// The smallest of them; 0 where there are none [s].
    pub dt: f64,
    /// What limited that, by its number on the wire.
    pub limit: u32,
    /// Most points of its surface that touched something.
    pub points: u64,
}

/// A line for each of these objects, so far as they take any time.
pub fn of_objects<'a>(costs: impl IntoIterator<Item = CostShare<'a>>) -> String {
    let mut text = String::new();
    for cost in costs.into_iter().filter(|cost| cost.share > 0.0) {
        let (name, share) = (cost.name, 100.0 * cost.share);
        let _ = write!(text, "\n  {share:.0} % of the time of objects: `{name}`");
        if cost.dt > 0.0 {
            let limit = match LIMITS.get(cost.limit as usize) {
                Some(&"sound") => "its speed of sound",
                Some(&"velocity") => "its velocity",
                Some(&"deformation") => "its deformation",
                _ => "the frame, or what it meets",
            };
            let (substeps, dt, points) = (cost.substeps, cost.dt, cost.points);
            let _ = write!(
                text,
                ", {substeps} of at least {dt:.2e} s by {limit}, up to {points} points in contact"
            );
        }
    }
    text
}

/// The phases that take a hundredth of the time at least, the longest first.
pub fn of_phases(names: &[&str], shares: &[f64]) -> String {
    let mut phases: Vec<(&&str, &f64)> = names.iter().zip(shares).collect();
    phases.retain(|(_, share)| **share >= 0.01);
    phases.sort_by(|a, b| b.1.total_cmp(a.1));
    let phases = phases.iter();
    let texts: Vec<String> = phases
        .map(|(name, share)| format!("{name} {:.0} %", 100.0 * **share))
        .collect();
    texts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_phase_comes_first_and_short_ones_are_left_out() {
        let text = of_phases(&["grid", "sort", "solids"], &[0.2, 0.004, 0.7]);
        assert_eq!(text, "solids 70 %, grid 20 %");
    }

    #[test]
    fn an_object_without_substeps_has_its_share_alone() {
        let cost = |share: f64, dt: f64| CostShare {
            name: "ball",
            share,
            substeps: "12 substeps".into(),
            dt,
            limit: 1,
            points: 3,
        };
        let text = of_objects([cost(0.5, 0.0), cost(0.25, 1e-4), cost(0.0, 1e-4)]);
        let expected = "\n  50 % of the time of objects: `ball`\n  25 % of the time of objects: `ball`, 12 substeps of at least \
                        1.00e-4 s by its speed of sound, up to 3 points in contact";
        assert_eq!(text, expected);
    }
}
