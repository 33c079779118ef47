//! From masks without names to objects: what two neighbours are called in each view, then what regions are called together.
//!
//! Votes: a view in which two neighbours lie in one mask joins them, one in which they lie in two parts them; likeness of
//! colour and normal votes too. Greedy average linkage over neighbours makes regions. Regions that the same masks cover,
//! adjacent or not, are one object: leaves of a plant hang together by nothing that is adjacent. The two ideas are those of
//! THGS (arXiv 2504.13153) and PairGS (arXiv 2607.01140); in turn, with one default, they hold where each alone fails.

use std::{cmp::Reverse, collections::BTreeMap};

use rayon::prelude::*;

use crate::{
    Evidence, Splat,
    lift::Labels,
    linkage::{Linkage, Votes, unlike},
    neighbours::Neighbours,
};

/// Neighbours of every Gaussian that views vote about.
const NEIGHBOURS: usize = 12;
/// Share of a Gaussian's weight in a view that must lie in one mask for it to vote.
const DECIDED: f32 = 0.7;
/// Votes that colour and normal have.
const PRIOR: f32 = 2.0;
/// Regions join while less than this share of the votes between them parts them.
const PARTED: f32 = 0.3;
/// Objects join while their regions share masks at least as much as this.
const SHARED: f32 = 0.5;
/// Smaller regions join a neighbour.
const MIN_REGION: usize = 50;
/// Most regions whose masks are compared, each with each; the smallest beyond join a neighbour.
const MAX_REGIONS: usize = 3000;

/// Which mask each Gaussian lies in, with its weight in them, in one view; -1 where it is not decided.
fn decided(view: &[Evidence], gaussians: usize) -> Vec<(i32, f32)> {
    let mut found = vec![(-1, 0.0); gaussians];
    for of in view.chunk_by(|a, b| a.gaussian == b.gaussian) {
        let all: f32 = of.iter().map(|e| e.weight).sum();
        let most = of.iter().max_by(|a, b| a.weight.total_cmp(&b.weight));
        if let Some(most) = most.filter(|m| m.mask >= 0 && m.weight > DECIDED * all) {
            found[most.gaussian as usize] = (most.mask, most.weight);
        }
    }
    found
}

/// Each pair of neighbours once, with what views and looks say about it.
fn edges<E>(
    splat: &Splat,
    views: usize,
    evidence: &mut impl FnMut(usize) -> Result<Vec<Evidence>, E>,
) -> Result<Vec<(u32, u32, Votes)>, E> {
    let pairs = Neighbours::new(&splat.position, NEIGHBOURS).pairs();
    let looks = |&(a, b): &(u32, u32)| Votes {
        parted: PRIOR * unlike(splat, a as usize, b as usize),
        all: PRIOR,
    };
    let mut votes: Vec<Votes> = pairs.par_iter().map(looks).collect();
    for view in 0..views {
        let mask = decided(&evidence(view)?, splat.len());
        votes
            .par_iter_mut()
            .zip(&pairs)
            .for_each(|(votes, &(a, b))| {
                let ((one, weight), (other, also)) = (mask[a as usize], mask[b as usize]);
                if one >= 0 && other >= 0 {
                    // What covers a pixel or more has a whole vote.
                    let vote = weight.min(also).min(1.0);
                    votes.add(Votes {
                        parted: if one == other { 0.0 } else { vote },
                        all: vote,
                    });
                }
            });
    }
    Ok(pairs
        .iter()
        .zip(votes)
        .map(|(&(a, b), v)| (a, b, v))
        .collect())
}

/// How much two regions share masks: mean over views of the chance that a pixel of each lies in the same mask.
#[derive(Clone, Copy, Debug, Default)]
struct Overlap {
    same: f32,
    seen: f32,
}

/// Weights of regions in the masks of one view, as shares, with how well each region is seen.
struct Coverage {
    share: Vec<BTreeMap<i32, f32>>,
    seen: Vec<f32>,
}

fn coverage(view: &[Evidence], region: &[u32], regions: usize) -> Coverage {
    let mut share = vec![BTreeMap::<i32, f32>::new(); regions];
    for e in view.iter().filter(|e| e.mask >= 0) {
        let of = &mut share[region[e.gaussian as usize] as usize];
        *of.entry(e.mask).or_default() += e.weight;
    }
    let seen: Vec<f32> = share.iter().map(|of| of.values().sum()).collect();
    for (of, seen) in share.iter_mut().zip(&seen) {
        of.values_mut()
            .for_each(|w| *w /= seen.max(f32::MIN_POSITIVE));
    }
    Coverage { share, seen }
}

/// Objects of regions: those that share masks, by average linkage.
fn share_masks(views: &[Coverage], size: &[usize]) -> Vec<u32> {
    let count = size.len();
    let best: Vec<f32> = (0..count)
        .map(|r| {
            views
                .iter()
                .map(|v| v.seen[r])
                .fold(f32::MIN_POSITIVE, f32::max)
        })
        .collect();
    // Each pair once: row `a` has the regions after it.
    let rows = (0..count).into_par_iter().map(|a| {
        let mut row = vec![Overlap::default(); count];
        for view in views.iter().filter(|v| v.seen[a] > 1.0) {
            for (b, overlap) in row.iter_mut().enumerate().filter(|(b, _)| *b != a) {
                if view.seen[b] <= 1.0 {
                    continue;
                }
                let weight = (view.seen[a] / best[a]) * (view.seen[b] / best[b]);
                let of = &view.share[b];
                let both = view.share[a]
                    .iter()
                    .filter_map(|(m, w)| Some(w * of.get(m)?));
                overlap.same += weight * both.sum::<f32>();
                overlap.seen += weight;
            }
        }
        row.iter()
            .map(|o| o.same / o.seen.max(f32::MIN_POSITIVE))
            .collect()
    });
    let mut affinity: Vec<Vec<f32>> = rows.collect();
    let mut size: Vec<f32> = size.iter().map(|s| *s as f32).collect();
    let mut left: Vec<usize> = (0..count).collect();
    let mut object: Vec<u32> = (0..count as u32).collect();
    // The nearest of each region, kept; most stay what they are when two others join.
    let nearest = |affinity: &[Vec<f32>], left: &[usize], a: usize| {
        let others = left.iter().filter(|b| **b != a);
        others.fold((0.0, a), |best, &b| match affinity[a][b] > best.0 {
            true => (affinity[a][b], b),
            false => best,
        })
    };
    let mut closest: Vec<(f32, usize)> = (0..count).map(|a| nearest(&affinity, &left, a)).collect();
    while let Some(&a) = left.iter().max_by(|&&a, &&b| {
        let by_share = closest[a].0.total_cmp(&closest[b].0);
        by_share.then(b.cmp(&a))
    }) {
        let (share, b) = closest[a];
        if share < SHARED || a == b {
            break;
        }
        let (kept, gone) = (a.min(b), a.max(b));
        left.retain(|r| *r != gone);
        let (mine, theirs) = (size[kept], size[gone]);
        for &r in left.iter().filter(|r| **r != kept) {
            let mean = (affinity[kept][r] * mine + affinity[gone][r] * theirs) / (mine + theirs);
            affinity[kept][r] = mean;
            affinity[r][kept] = mean;
        }
        size[kept] += theirs;
        object
            .iter_mut()
            .filter(|o| **o == gone as u32)
            .for_each(|o| *o = kept as u32);
        for &r in &left {
            if r == kept || closest[r].1 == kept || closest[r].1 == gone {
                closest[r] = nearest(&affinity, &left, r);
            } else if affinity[r][kept] > closest[r].0 {
                closest[r] = (affinity[r][kept], kept);
            }
        }
    }
    object
}

/// Objects of all Gaussians of `splat` from masks of `views` views whose numbers mean nothing beyond their view; `evidence`
/// gives what those of a view say, and is asked twice for each. Objects are numbered by their Gaussians, most first.
///
/// Confidence is the share of a Gaussian's neighbours that belong to its object. Any number of threads gives the same bits.
///
/// # Errors
/// Those of `evidence`.
pub fn group<E>(
    splat: &Splat,
    views: usize,
    mut evidence: impl FnMut(usize) -> Result<Vec<Evidence>, E>,
) -> Result<Labels, E> {
    let edges = edges(splat, views, &mut evidence)?;
    let mut linkage = Linkage::new(splat.len(), &edges);
    linkage.run(PARTED);
    linkage.absorb(MIN_REGION);
    if let Some(size) = linkage.sizes().get(MAX_REGIONS) {
        linkage.absorb(size + 1);
    }
    let (region, size) = linkage.regions();
    let mut covered = Vec::with_capacity(views);
    for view in 0..views {
        covered.push(coverage(&evidence(view)?, &region, size.len()));
    }
    let mut object = share_masks(&covered, &size);
    let unknown = unknown(&object, &covered);
    join_unknown(&mut object, unknown, &region, &edges);
    Ok(labels(&region, &object, &edges))
}

/// Regions that no view shows, and those of objects that are most of no mask: what is seen of them leaks through others.
fn unknown(object: &[u32], covered: &[Coverage]) -> Vec<bool> {
    let mut is_most = vec![false; object.len()];
    for view in covered {
        let mut masks = BTreeMap::<i32, BTreeMap<u32, f32>>::new();
        for ((of, seen), object) in view.share.iter().zip(&view.seen).zip(object) {
            for (mask, share) in of {
                *masks.entry(*mask).or_default().entry(*object).or_default() += share * seen;
            }
        }
        for of in masks.values() {
            let all: f32 = of.values().sum();
            let most = of.iter().find(|(_, weight)| **weight > 0.5 * all);
            most.iter().for_each(|(o, _)| is_most[**o as usize] = true);
        }
    }
    let is_seen = |r: usize| covered.iter().any(|view| view.seen[r] > 1.0);
    let regions = object.iter().enumerate();
    regions
        .map(|(r, o)| !is_seen(r) || !is_most[*o as usize])
        .collect()
}

/// Gives each region of which nothing is known the object of the neighbour that most speaks for.
fn join_unknown(
    object: &mut [u32],
    mut unknown: Vec<bool>,
    region: &[u32],
    edges: &[(u32, u32, Votes)],
) {
    let mut links = BTreeMap::<(u32, u32), f32>::new();
    for (a, b, votes) in edges {
        let (a, b) = (region[*a as usize], region[*b as usize]);
        if a != b {
            *links.entry((a, b)).or_default() += votes.all - votes.parted;
            *links.entry((b, a)).or_default() += votes.all - votes.parted;
        }
    }
    // What hangs on an unknown region alone waits for it.
    loop {
        let mut best = BTreeMap::<u32, (f32, u32)>::new();
        for (&(a, b), &votes) in &links {
            if unknown[a as usize] && !unknown[b as usize] {
                let known = best.entry(a).or_default();
                if votes > known.0 {
                    *known = (votes, b);
                }
            }
        }
        best.retain(|_, (votes, _)| *votes > 0.0);
        if best.is_empty() {
            return;
        }
        for (a, (_, b)) in best {
            object[a as usize] = object[b as usize];
            unknown[a as usize] = false;
        }
    }
}

fn labels(region: &[u32], object: &[u32], edges: &[(u32, u32, Votes)]) -> Labels {
    let of: Vec<u32> = region.iter().map(|r| object[*r as usize]).collect();
    let mut count = BTreeMap::<u32, usize>::new();
    of.iter().for_each(|o| *count.entry(*o).or_default() += 1);
    let mut order: Vec<u32> = count.keys().copied().collect();
    order.sort_by_key(|o| (Reverse(count[o]), *o));
    let number: BTreeMap<u32, i32> = (0..).zip(order).map(|(n, o)| (o, n)).collect();
    let mut same = vec![[0u32; 2]; of.len()];
    for &(a, b, _) in edges {
        let (a, b) = (a as usize, b as usize);
        let alike = u32::from(of[a] == of[b]);
        for n in [a, b] {
            same[n][0] += alike;
            same[n][1] += 1;
        }
    }
    Labels {
        object: of.iter().map(|o| number[o]).collect(),
        confidence: same
            .iter()
            .map(|[same, all]| *same as f32 / (*all).max(1) as f32)
            .collect(),
    }
}
