//! Sliding, collision, bouncing.

use anyhow::Context;

use crate::{
    bench_precision::case::{Case, Family},
    trial::{Outcome, scene_text},
};

/// A block on an inclined plane.
pub const INCLINE: Case = Case {
    name: "incline",
    title: "Block, sliding down a plane with friction",
    error: "acceleration, relative error",
    against: "g (sin 24 - tan 15 cos 24), fitted after 0.3 s, when all of its weight is there",
    scene: scene_text!("precision/incline"),
    duration: 0.6,
    reference: None,
    families: || Family::usual(&["6", "8", "12", "16", "24"], &["6", "8"]),
    measure: incline,
};

/// Acceleration along the plane once the block has its weight.
fn incline(run: &Outcome, _: Option<&Outcome>) -> anyhow::Result<f64> {
    let (sin, cos) = 24f64.to_radians().sin_cos();
    let expected = 9.81 * (sin - 15f64.to_radians().tan() * cos);
    let x = run.series("/objects/0/com/0");
    let y = run.series("/objects/0/com/1");
    let way = x.iter().zip(&y);
    let way: Vec<(f64, f64)> = way
        .map(|((t, x), (_, y))| (*t, x * cos - y * sin))
        .filter(|(t, _)| *t > 0.3)
        .collect();
    let error = (acceleration(&way) / expected - 1.0).abs();
    anyhow::ensure!(error.is_finite(), "the way is not a number");
    Ok(error)
}

/// Twice the quadratic coefficient of the parabola nearest to points at equal distances in time.
fn acceleration(way: &[(f64, f64)]) -> f64 {
    let count = way.len() as f64;
    let middle = way.iter().map(|(t, _)| t).sum::<f64>() / count;
    let square = |t: &f64| (t - middle) * (t - middle);
    let mean = way.iter().map(|(t, _)| square(t)).sum::<f64>() / count;
    // Squares less their mean are orthogonal to constants and lines.
    let shape = |t: &f64| square(t) - mean;
    let above: f64 = way.iter().map(|(t, s)| s * shape(t)).sum();
    let below: f64 = way.iter().map(|(t, _)| shape(t) * shape(t)).sum();
    2.0 * above / below
}

/// Two balls head-on.
pub const SPHERES: Case = Case {
    name: "spheres",
    title: "Two soft balls, meeting head-on",
    error: "relative speed that is lost",
    against: "a collision that is perfectly elastic (vibrations keep a few per mille in truth)",
    scene: scene_text!("precision/spheres"),
    duration: 0.35,
    reference: None,
    families: || {
        let mut families = Family::usual(&["6", "8", "12", "16", "24"], &["6", "8"]);
        families.push(Family::contact());
        families
    },
    measure: |run, _| {
        let left = run.last("/objects/0/linear_velocity/0")?;
        let right = run.last("/objects/1/linear_velocity/0")?;
        anyhow::ensure!(right > left, "they have not separated");
        Ok((1.0 - (right - left) / 0.5).abs())
    },
};

/// A ball on the floor.
pub const BOUNCE: Case = Case {
    name: "bounce",
    title: "Soft ball, bouncing off the floor",
    error: "height that is lost, relative",
    against: "a bounce that is perfectly elastic (vibrations keep a few per cent in truth)",
    scene: scene_text!("precision/bounce"),
    duration: 0.35,
    reference: None,
    families: || Family::usual(&["6", "8", "12", "16", "24"], &["6", "8"]),
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

    #[test]
    fn the_acceleration_of_a_parabola_is_found_whatever_its_start() {
        let way = |n: u32| {
            let t = 0.1 + f64::from(n) / 60.0;
            (t, 0.3 - 0.2 * t + 0.5 * 1.6 * t * t)
        };
        let found = acceleration(&(0..25).map(way).collect::<Vec<_>>());
        assert!((found - 1.6).abs() < 1e-9, "{found}");
    }
}
