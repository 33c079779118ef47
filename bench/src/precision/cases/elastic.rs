//! What elastic matter does without contact.

use std::f64::consts::PI;

use crate::{
    precision::case::{Case, Family, relative_l2},
    trial::{Outcome, scene_text},
};

/// A bar in tension.
pub const BAR: Case = Case {
    name: "bar",
    title: "Bar, held at one end and suddenly pulled",
    error: "centre of mass, relative L2 error over two periods",
    against: "the exact solution of the wave equation",
    scene: scene_text!("precision/bar"),
    duration: 2.5,
    reference: None,
    families: || Family::of_solids(1, &["8", "16", "32", "64"], &["8", "16", "32"]),
    measure: bar,
};

/// Displacement of the centre of mass of a bar of length `l` with wave speed `c`, fixed at one end, when a load `g`
/// per mass starts at time 0 [m]: the sum over its modes.
fn bar_displacement(t: f64, l: f64, c: f64, g: f64) -> f64 {
    let mode = |n: u32| {
        let k = f64::from(2 * n + 1) * PI / (2.0 * l);
        let omega = k * c;
        2.0 * g / (l * k * omega * omega) / (l * k) * (1.0 - (omega * t).cos())
    };
    (0..200).map(mode).sum()
}

fn bar(run: &Outcome, _: Option<&Outcome>) -> anyhow::Result<f64> {
    let speed = (1e4f64 / 1000.0).sqrt();
    let path = run.series("/objects/0/com/0");
    relative_l2(path.iter().map(|(t, x)| {
        let expected = bar_displacement(*t, 1.0, speed, 0.01);
        (x - 0.5, expected)
    }))
}

/// A free cube with a spin.
pub const SPIN: Case = Case {
    name: "spin",
    title: "Cube, spinning freely",
    error: "energy, largest relative drift",
    against: "conservation of kinetic plus elastic energy since the start",
    scene: scene_text!("precision/spin"),
    duration: 0.5,
    reference: None,
    families: || Family::of_solids(1, &["6", "8", "12", "16", "24"], &["6", "8", "12"]),
    measure: |run, _| {
        let kinetic = run.series("/kinetic_energy");
        let elastic = run.series("/elastic_energy");
        let total = kinetic.iter().zip(&elastic).map(|(k, e)| k.1 + e.1);
        // Half of spin times angular momentum, which stays to round-off. Not that of a cube: particles that carry an affine
        // field have a larger moment of inertia, by 3 dx^2 / a^2, and it is not lost.
        let spin = run.series("/angular_momentum/2");
        let start = 0.5 * 6.0 * spin.first().map_or(f64::NAN, |(_, l)| *l);
        let drift = total.map(|e| (e / start - 1.0).abs()).fold(0.0, f64::max);
        anyhow::ensure!(drift > 0.0 && !kinetic.is_empty(), "no energy was reported");
        Ok(drift)
    },
};

/// A beam that bends.
pub const CANTILEVER: Case = Case {
    name: "cantilever",
    title: "Beam, held at one end, bending under its weight",
    error: "centre of mass, relative L2 error over the way down",
    against: "a run at four times the default's cells and a sixth of its step",
    scene: scene_text!("precision/cantilever"),
    duration: 1.0,
    reference: Some(&[("cells_per_object", "64"), ("cfl", "0.5")]),
    families: || Family::of_solids(1, &["8", "12", "16", "24", "32"], &["8", "12", "16", "24"]),
    measure: |run, reference| fall(run, reference, &["/objects/0/com/1"], 0.0),
};

/// Relative L2 difference of the way of some coordinates between two runs.
pub fn fall(
    run: &Outcome,
    reference: Option<&Outcome>,
    pointers: &[&str],
    start: f64,
) -> anyhow::Result<f64> {
    let mut pairs = Vec::new();
    for pointer in pointers {
        let expected = reference.map(|r| r.series(pointer)).unwrap_or_default();
        let measured = run.series(pointer);
        anyhow::ensure!(
            measured.len() == expected.len(),
            "{} frames, {} in the reference",
            measured.len(),
            expected.len()
        );
        let both = measured.iter().zip(&expected);
        pairs.extend(both.map(|(m, e)| (m.1 - start, e.1 - start)));
    }
    relative_l2(pairs.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At rest the mean stretch under its weight is g L^2 / (3 c^2), and the bar swings symmetrically about it.
    #[test]
    fn the_bar_swings_about_its_static_stretch() {
        let (l, c, g) = (1.0, 3.0, 0.01);
        let quarter = l / c;
        let still = g * l * l / (3.0 * c * c);
        for t in [0.1, 0.5] {
            let both = bar_displacement(t, l, c, g) + bar_displacement(2.0 * quarter - t, l, c, g);
            assert!((both / (2.0 * still) - 1.0).abs() < 1e-6, "{both}");
        }
        assert!(bar_displacement(4.0 * quarter, l, c, g).abs() < 1e-9);
    }
}
