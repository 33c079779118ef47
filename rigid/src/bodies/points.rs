//! Points of a body's surface that meet other bodies, in clusters that can be passed over whole.

use std::collections::BTreeMap;

use super::vector::{Vec3, length, sub};

/// Points per cluster, about.
const CLUSTER: usize = 24;

/// Points near each other and a ball around them.
#[derive(Clone, Debug)]
pub(super) struct Cluster {
    pub center: Vec3,
    pub radius: f64,
    pub points: std::ops::Range<usize>,
}

/// Sorts points that are about `spacing` [m] apart into clusters.
pub(super) fn cluster(points: &[Vec3], spacing: f64) -> (Vec<Vec3>, Vec<Cluster>) {
    // A patch of n by n spacings of surface holds about n^2 points.
    let edge = (CLUSTER as f64).sqrt() * spacing;
    let mut boxes: BTreeMap<[i64; 3], Vec<Vec3>> = BTreeMap::new();
    for &x in points {
        let key = [0, 1, 2].map(|a| (x[a] / edge).floor() as i64);
        boxes.entry(key).or_default().push(x);
    }
    let (mut sorted, mut clusters) = (Vec::with_capacity(points.len()), Vec::new());
    for members in boxes.into_values() {
        let count = members.len() as f64;
        let center = [0, 1, 2].map(|a| members.iter().map(|x| x[a]).sum::<f64>() / count);
        let radius = members.iter().map(|x| length(sub(*x, center)));
        clusters.push(Cluster {
            center,
            radius: radius.fold(0.0, f64::max),
            points: sorted.len()..sorted.len() + members.len(),
        });
        sorted.extend(members);
    }
    (sorted, clusters)
}
