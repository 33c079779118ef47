//! Rolling, collision, bouncing.

use anyhow::Context;

use crate::{
    precision::case::{Case, Family},
    trial::{Outcome, scene_text},
};

/// A ball on an inclined plane.
pub const ROLLING: Case = Case {
    name: "rolling",
    title: "Soft ball, rolling down a slope that is turned against the grid",
    error: "way, relative error",
    against: "5/7 g sin 24 t^2 / 2, a rigid ball's",
    scene: scene_text!("precision/rolling"),
    duration: 0.6,
    reference: None,
    families: || Family::of_solids(1, &["6", "8", "12", "16", "24"], &["6", "8"]),
    measure: |run, _| {
        let time = run.last("/sim_time")?;
        let x = run.series("/objects/0/com/0");
        let y = run.series("/objects/0/com/1");
        let (sin, cos) = 24f64.to_radians().sin_cos();
        let places = x.iter().zip(&y).map(|((_, x), (_, y))| x * cos - y * sin);
        let places: Vec<f64> = places.collect();
        let (Some(start), Some(end)) = (places.first(), places.last()) else {
            anyhow::bail!("it has no way");
        };
        let way = end - start;
        Ok((way / (5.0 / 14.0 * 9.81 * sin * time * time) - 1.0).abs())
    },
};

/// Two balls head-on.
pub const SPHERES: Case = Case {
    name: "spheres",
    title: "Two soft balls, meeting head-on",
    error: "COM, largest error over its way",
    against: "finite elements (docs/derivations/ball_impact.py)",
    scene: scene_text!("precision/spheres"),
    duration: 0.35,
    reference: None,
    families: || {
        let mut families = Family::of_solids(2, &["6", "8", "12", "16", "24"], &["6", "8"]);
        families.push(Family::contact());
        families
    },
    measure: |run, _| {
        let left = run.series("/objects/0/com/0");
        let right = run.series("/objects/1/com/0");
        let half = left.iter().zip(&right);
        let half: Vec<(f64, f64)> = half.map(|((t, a), (_, b))| (*t, 0.5 * (b - a))).collect();
        off(&half, &impact())
    },
};

/// Time [s] and height over the plane [m] of a ball that meets one, which is the other's mirror image.
fn impact() -> Vec<(f64, f64)> {
    let text = include_str!("../../../../docs/derivations/ball_impact.txt");
    let row = |line: &str| {
        let (time, height) = line.split_once(", ")?;
        Some((time.parse().ok()?, height.parse().ok()?))
    };
    text.lines().filter_map(row).collect()
}

/// Largest difference from what is known at the same times, over the way that is known.
fn off(way: &[(f64, f64)], known: &[(f64, f64)]) -> anyhow::Result<f64> {
    let mut most = 0.0_f64;
    for &(time, place) in way {
        let expected = known.iter().find(|(t, _)| (t - time).abs() < 1e-5);
        let (_, expected) = expected.with_context(|| format!("nothing is known at {time} s"))?;
        most = most.max((place - expected).abs());
    }
    let length: f64 = known.windows(2).map(|w| (w[1].1 - w[0].1).abs()).sum();
    Ok(most / length)
}

/// A ball on the floor.
pub const BOUNCE: Case = Case {
    name: "bounce",
    title: "Soft ball, bouncing off the floor",
    error: "height that is lost, relative",
    against: "a bounce that is perfectly elastic (vibrations keep a few per cent in truth)",
    scene: scene_text!("precision/bounce"),
    duration: 0.35,
    reference: None,
    families: || Family::of_solids(1, &["6", "8", "12", "16", "24"], &["6", "8"]),
    measure: bounce,
};

/// The height that the ball's velocity will take it to, once it flies.
fn bounce(run: &Outcome, _: Option<&Outcome>) -> anyhow::Result<f64> {
    let height = run.series("/objects/0/com/1");
    let speed = run.series("/objects/0/linear_velocity/1");
    Ok((1.0 - top(&height, &speed)? / 0.05).abs())
}

/// Height above where the ball would just touch that its velocity takes it to. The floor pushes it up for as long as they
/// touch, so that it is the largest that any moment on the way up says.
fn top(height: &[(f64, f64)], speed: &[(f64, f64)]) -> anyhow::Result<f64> {
    let up = height.iter().zip(speed).filter(|(_, (_, v))| *v > 0.0);
    up.map(|((_, y), (_, v))| y + v * v / (2.0 * 9.81) - 0.1)
        .max_by(f64::total_cmp)
        .context("the ball does not come up again")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the times of frames.
    #[test]
    fn an_impact_is_held_against_finite_elements() {
        let known = impact();
        // Every frame of 0.35 s, and the start.
        assert_eq!(known.len(), 22);
        assert_eq!(off(&known, &known).expect("the same times"), 0.0);
        // In from 0.115 m to 0.0876, out to 0.1355: 0.0754 m.
        let late: Vec<(f64, f64)> = known.iter().map(|(t, y)| (*t, y + 0.00754)).collect();
        let found = off(&late, &known).expect("the same times");
        assert!((found - 0.1).abs() < 1e-3, "{found}");
        assert!(off(&[(0.34, 0.1)], &known).is_err());
    }

    /// While it still touches the floor it is fastest, and not yet where it will fly from.
    #[test]
    fn a_bounce_is_as_high_as_what_flies_says() {
        let flight = |t: f64| (0.1 + 0.9 * t - 4.905 * t * t, 0.9 - 9.81 * t);
        let mut way = vec![(0.09, -0.5), (0.085, 0.3), (0.09, 0.92)];
        way.extend((0..15).map(|n| flight(0.01 * f64::from(n))));
        let series = |of: fn(&(f64, f64)) -> f64| -> Vec<(f64, f64)> {
            (0..).map(f64::from).zip(way.iter().map(of)).collect()
        };
        let found = top(&series(|w| w.0), &series(|w| w.1)).expect("it flies");
        assert!((found - 0.9 * 0.9 / 19.62).abs() < 1e-12, "{found}");
        assert!(top(&[(0.0, 0.1)], &[(0.0, -1.0)]).is_err());
    }
}
