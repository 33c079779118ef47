//! What of a splat counts for its size: captures have Gaussians far away from all that was captured.

use cosplat_sim_core::scene::Aabb;

use crate::{bounds::bounds_of, components::by_cells};

/// Centres below and above these quantiles along an axis may be floaters.
const QUANTILES: [f64; 2] = [0.005, 0.995];
/// How far the rim of an object may reach beyond these, over its length along the axis, and over its longest.
const RIM: [f64; 2] = [0.1, 0.01];
/// Cells by which what is beyond the rim holds together with the rest, over the longest side: a leaf may have a long tip.
const LINK: f64 = 0.05;
/// Share of all centres that a cluster apart has from which on it is a part of the object.
const PART: f64 = 0.0025;

/// Indices of the centres that float, ascending: they are far beyond the inner 99 % along some axis, hang together with nothing there,
/// and are few. Empty where no size can be told: fewer than two points, or all at one place.
pub(crate) fn floaters(points: &[[f64; 3]]) -> Vec<usize> {
    let ranges = [0, 1, 2].map(|a| inner_range(&points.iter().map(|p| p[a]).collect::<Vec<_>>()));
    let longest = ranges.iter().map(|r| r[1] - r[0]).fold(0.0, f64::max);
    let keep = ranges.map(|[low, high]| {
        let rim = RIM[0] * (high - low) + RIM[1] * longest;
        [low - rim, high + rim]
    });
    let is_near = |p: &[f64; 3]| (0..3).all(|a| (keep[a][0]..=keep[a][1]).contains(&p[a]));
    if !(longest > 0.0 && longest.is_finite()) || points.iter().all(is_near) {
        return vec![];
    }
    let most = (PART * points.len() as f64).max(1.0);
    let clusters = by_cells(points, LINK * longest).into_iter();
    let apart = clusters.filter(|cluster| {
        cluster.len() as f64 <= most && !cluster.iter().any(|&n| is_near(&points[n]))
    });
    let mut found: Vec<usize> = apart.flatten().collect();
    found.sort_unstable();
    found
}

/// Box of all centres that do not float, and how many do; none for no points.
pub(crate) fn core(points: &[[f64; 3]]) -> Option<(Aabb, usize)> {
    let floating = floaters(points);
    let mut left = floating.iter().peekable();
    let kept = (0..points.len()).filter(|n| left.next_if_eq(&n).is_none());
    let bounds = bounds_of(kept.map(|n| points[n]))?;
    Some((bounds, floating.len()))
}

/// Smallest and largest of what is between [`QUANTILES`]; zeros for no values.
pub(crate) fn inner_range(values: &[f64]) -> [f64; 2] {
    let mut values = values.to_vec();
    let Some(last) = values.len().checked_sub(1) else {
        return [0.0; 2];
    };
    QUANTILES.map(|q| {
        let n = (q * values.len() as f64) as usize;
        *values.select_nth_unstable_by(n.min(last), f64::total_cmp).1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cloud in a box of 1 x 2 x 0.5, far from the origin.
    fn cloud(count: usize) -> Vec<[f64; 3]> {
        let golden = 0.618_033_988_749_895;
        let at =
            |n: usize, a: usize| (n as f64 * [golden, golden * golden, 0.754_877_666][a]).fract();
        (0..count)
            .map(|n| [500_000.0 + at(n, 0), -2e5 + 2.0 * at(n, 1), 0.5 * at(n, 2)])
            .collect()
    }

    #[test]
    fn what_is_far_from_all_else_counts_for_no_size() {
        for count in [300, 3000, 30_000] {
            let clean = cloud(count);
            assert_eq!(floaters(&clean), [0; 0], "{count}");
            let bounds = core(&clean).expect("points").0;
            let mut all = clean.clone();
            all.insert(7, [500_100.0, -2e5, 0.0]);
            all.push([500_000.0, -1e5, 0.0]);
            all.push([500_000.5, -2e5, -0.4]);
            assert_eq!(floaters(&all), [7, count + 1, count + 2], "{count}");
            assert_eq!(core(&all), Some((bounds, 3)));
        }
    }

    #[test]
    fn a_tip_and_a_part_that_stands_apart_count() {
        let mut all = cloud(10_000);
        // As thin as a blade of grass, and a second thing beside the first.
        all.extend((0..40).map(|n| [500_000.5, -2e5 + 2.0 + 0.04 * f64::from(n), 0.25]));
        assert_eq!(floaters(&all), [0; 0]);
        all.extend((0..40).map(|n| [500_003.0 + 0.01 * f64::from(n), -2e5, 0.25]));
        assert_eq!(core(&all).expect("points").1, 0);
        // A clump that is small.
        all.truncate(10_040);
        all.extend((0..20).map(|n| [500_003.0 + 0.01 * f64::from(n), -2e5, 0.25]));
        assert_eq!(floaters(&all), (10_040..10_060).collect::<Vec<_>>());
    }

    #[test]
    fn what_has_no_size_has_no_floaters() {
        assert_eq!(core(&[]), None);
        for few in [
            vec![[1.0, 2.0, 3.0]],
            vec![[1.0; 3]; 5],
            vec![[0.0; 3], [9.0; 3]],
        ] {
            assert_eq!(floaters(&few), [0; 0], "{few:?}");
        }
    }
}
