//! Where two solids touch: all features with a small gap, and the few that matter.

use super::{
    edges::near_parts,
    feature::{FACE, Feature, Solid, Spot, gap},
    rims::near_rims,
    shape::Form,
    vector::{length, sub},
};
use crate::mat3::{cross, dot};

/// Features of the pair with a gap below `margin`, with the gap.
pub(super) fn near(a: &Solid<'_>, b: &Solid<'_>, margin: f64) -> Vec<(Feature, f64)> {
    let mut found = Vec::new();
    let balls = a.is_ball() && b.is_ball();
    for (second, of, other) in [(false, a, b), (true, b, a)] {
        let (shape, body) = match of {
            Solid::Body(shape, body) => (shape, body),
            Solid::Wall(wall) => {
                found.extend(near_parts(wall, other, margin));
                continue;
            }
        };
        // Of two balls one is enough, unless the second is in the first.
        if balls && second && !b.is_held_by(a) {
            continue;
        }
        match &shape.form {
            Form::Ball(_) => {
                let feature = Feature { second, point: 0 };
                found.push((feature, gap(a, b, feature)));
            }
            Form::Field(_) | Form::Cuboid(_) | Form::Cylinder(_) => {
                found.extend(near_rims(a, b, second, margin));
                for cluster in &shape.clusters {
                    let center = body.point(cluster.center);
                    if other.distance(center) > 2.0 * (cluster.radius + margin) {
                        continue;
                    }
                    for n in cluster.points.clone() {
                        let feature = Feature {
                            second,
                            point: n as u32,
                        };
                        let x = body.point(shape.points[n]);
                        let gap = other.distance(x);
                        if gap <= margin && of.counts(feature.point, x, gap, other) {
                            found.push((feature, gap));
                        }
                    }
                }
            }
        }
    }
    found.retain(|(_, gap)| *gap <= margin);
    found
}

/// The few spots that stand for all: per face those that span most of it. Deeper than `deep` the deepest stays too.
pub(super) fn reduce(a: &Solid<'_>, b: &Solid<'_>, mut spots: Vec<Spot>, deep: f64) -> Vec<Spot> {
    // A ball has one nearest point: points of the other count only where they are on another of its sides.
    if a.is_ball() != b.is_ball() {
        let second = b.is_ball();
        if let Some(own) = spots.iter().find(|s| s.feature.second == second).copied() {
            spots.retain(|s| s.feature == own.feature || dot(s.normal, own.normal) < FACE);
        }
    }
    spots.sort_by(|p, q| p.gap.total_cmp(&q.gap).then(p.feature.cmp(&q.feature)));
    let mut kept: Vec<Spot> = Vec::new();
    while let Some(first) = spots.first().copied() {
        let (face, others): (Vec<Spot>, Vec<Spot>) = spots
            .into_iter()
            .partition(|s| dot(s.normal, first.normal) > FACE);
        spots = others;
        kept.extend(span(&face, deep));
    }
    kept
}

/// Up to four of the points of a face, far from each other, and the first if it is deep.
fn span(face: &[Spot], deep: f64) -> Vec<Spot> {
    if face.len() <= 2 {
        return face.to_vec();
    }
    let count = face.len() as f64;
    let middle = [0, 1, 2].map(|a| face.iter().map(|s| s.x[a]).sum::<f64>() / count);
    // Strictly farther by more than round-off: of equals the first feature is kept, whoever moves or turns the scene,
    // and the same ones in every step.
    let mut order: Vec<usize> = (0..face.len()).collect();
    order.sort_by_key(|&n| face[n].feature);
    let best = |score: &dyn Fn(&Spot) -> f64| {
        let (mut at, mut most) = (order[0], score(&face[order[0]]));
        for &n in &order {
            let value = score(&face[n]);
            if value > most + 1e-9 * most.abs() {
                (at, most) = (n, value);
            }
        }
        at
    };
    let p = best(&|s| length(sub(s.x, middle)));
    let q = best(&|s| length(sub(s.x, face[p].x)));
    let line = sub(face[q].x, face[p].x);
    let side = cross(face[p].normal, line);
    let r = best(&|s| dot(sub(s.x, face[p].x), side));
    let t = best(&|s| -dot(sub(s.x, face[p].x), side));
    let mut chosen = vec![p, q, r, t];
    if face[0].gap < deep {
        chosen.push(0);
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|n| face[n]).collect()
}
