//! What of a splat's own numbers is suspicious: places that single precision does not tell apart, sizes and opacities that were
//! activated twice.

use cosplat_sim_core::scene::Aabb;

use super::{edit::Unplaced, select::longest_side};
use crate::assets::sigmoid;

/// Places along the longest side of an object that single precision has to tell apart at least.
const FEWEST_PLACES: f64 = 2000.0;
/// Gaussians from which on their typical size says something about their file.
const MANY: usize = 50;
/// Longest side of a Gaussian in the middle of all, over that of the splat, from which on it is too large; and the same over what covers a
/// surface.
const LARGE: [f64; 2] = [0.1, 2.0];

/// Difference of opacities from which on they are not all meant to be the same.
const SPREAD: f32 = 0.1;

/// Of a file, whose Gaussians have this box without floaters.
pub(super) fn of_file(g: &Unplaced, bounds: &Aabb) -> Vec<String> {
    let mut found = Vec::new();
    let (longest, [largest, step]) = (longest_side(bounds), step(bounds));
    if !g.is_exact && is_lossy(longest, step) {
        found.push(format!(
            "its file has places in single precision, up to {largest:.4e} units from its origin, where that tells places {step:.1e} units \
             apart, and it is {longest:.4} units long: move it to its origin in double precision, before it is written"
        ));
    }
    found.extend(activated_twice(g, longest));
    found
}

/// Of a body that is where its rotation turns about its origin, with its box without floaters.
pub(super) fn of_body(g: &Unplaced, bounds: &Aabb) -> Option<String> {
    let (longest, [largest, step]) = (longest_side(bounds), step(bounds));
    (g.is_exact && is_lossy(longest, step)).then(|| {
        format!(
            "its Gaussians are up to {largest:.4e} m from the origin, where single precision tells places {step:.1e} m apart, and it is \
             {longest:.4} m long: `anchor = \"center\"` or `\"bottom\"` brings it to the origin with all that its file tells"
        )
    })
}

fn is_lossy(longest: f64, step: f64) -> bool {
    longest > 0.0 && longest < FEWEST_PLACES * step
}

/// Largest coordinate of a box, and how far it is from the next that single precision has.
fn step(bounds: &Aabb) -> [f64; 2] {
    let ends = bounds.min.iter().chain(&bounds.max);
    let largest = ends.fold(0.0, |largest: f64, x| largest.max(x.abs()));
    let single = largest as f32;
    [largest, f64::from(single.next_up()) - f64::from(single)]
}

/// Whether scales look as if the exponential function had been applied twice, or opacities the logistic one.
fn activated_twice(g: &Unplaced, longest: f64) -> Vec<String> {
    let mut found = Vec::new();
    let looks = g.looks();
    if g.len() < MANY {
        return found;
    }
    let mut sizes: Vec<f32> = looks
        .scale
        .iter()
        .map(|s| s[0].max(s[1]).max(s[2]))
        .collect();
    let middle = sizes.len() / 2;
    let typical = f64::from(*sizes.select_nth_unstable_by(middle, f32::total_cmp).1);
    let covers = longest / (g.len() as f64).sqrt();
    if typical > LARGE[0] * longest && typical > LARGE[1] * covers {
        found.push(format!(
            "half of its {} Gaussians have a scale of more than {typical:.3} units, and all of it is {longest:.3} units long: \
             its file may have scales where their logarithms belong",
            g.len()
        ));
    }
    // What was between 0 and 1 is between these afterwards.
    let [least, most] = [sigmoid(0.0), sigmoid(1.0)];
    let far = |pick: fn(f32, f32) -> f32, none: f32| looks.opacity.iter().copied().fold(none, pick);
    let (lowest, highest) = (far(f32::min, 1.0), far(f32::max, 0.0));
    let is_varied = highest - lowest > SPREAD || lowest == most;
    if is_varied && lowest >= least && highest <= most {
        found.push(format!(
            "all of its {} Gaussians have an opacity of {least:.2} to {most:.2}: its file may have opacities where their logits belong",
            g.len()
        ));
    }
    found
}
