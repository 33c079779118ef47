//! From masks with names to a label for every Gaussian: the closed form, then diffusion, then the nearest region.
//!
//! The closed form is the mean over pixels, weighted by opacity times transmittance (Occam's LGS, BMVC 2025; LUDVIG, ICCV
//! 2025; Splat Feature Solver, ICLR 2026). Diffusion takes the same mean again over neighbours, in which a Gaussian that
//! was hardly seen counts little and takes much. What lies in one superpoint is alike and hangs together, and mostly of one object.

pub use cosplat_scene::assets::objects::Labels;
use glam::Vec3;
use rayon::prelude::*;

use crate::{
    Splat,
    evidence::Evidence,
    neighbours::{Neighbours, Tree},
    tree as superpoints,
};

/// Neighbours of every Gaussian that it exchanges labels with.
const NEIGHBOURS: usize = 16;
/// Steps of diffusion; each reaches one neighbour further.
const STEPS: usize = 20;
/// Weight at which a Gaussian trusts the masks as much as its neighbours [pixel].
const TRUST: f32 = 4.0;
/// Weight below which a Gaussian counts as seen by no view [pixel].
const UNSEEN: f32 = 1.0;
/// Weight above which a node of the tree counts as seen [pixel].
const SEEN: f64 = 20.0;
/// Share of a mask's weight that must lie in Gaussians of its object for it to count; the same of an object's weight in masks
/// of its name. The least, for objects whose masks have bad edges in most views, and the most.
const AGREEMENT: [f64; 2] = [0.5, 0.7];
/// Part of what the better views of an object agree by that every view must.
const OF_BETTER: f64 = 0.72;
/// Share of the views that agree no more than the better ones: names that are wrong in fewer than that do not count.
const BETTER: f64 = 0.75;
/// Weight of the shares of a Gaussian's superpoint against its own. A part of more than a third of a superpoint keeps its name
/// where all masks agree on it, as `1 + 3 / 3 = 3 * 2 / 3`; a smaller one, and a Gaussian in doubt, go with the superpoint.
const SUPERPOINT: f32 = 3.0;
/// Difference of colour at which an edge weighs 1/e.
const COLOR_SCALE: f32 = 0.25;

/// Sums of weights: of every Gaussian in each named object.
#[derive(Clone, Debug)]
pub struct Lifted {
    /// Objects.
    pub objects: usize,
    /// `[gaussians][objects]` [pixel].
    pub weight: Vec<f32>,
    /// Weight in pixels that lie in no mask [pixel].
    pub unnamed: Vec<f32>,
}

impl Lifted {
    /// Nothing seen yet of `gaussians` Gaussians.
    pub fn new(gaussians: usize, objects: usize) -> Self {
        Self {
            objects,
            weight: vec![0.0; gaussians * objects],
            unnamed: vec![0.0; gaussians],
        }
    }

    /// Adds what a view says; `name` gives the object of a mask.
    pub fn add(&mut self, view: &[Evidence], name: impl Fn(i32) -> Option<usize>) {
        for e in view {
            let n = e.gaussian as usize;
            match name(e.mask).filter(|object| *object < self.objects) {
                Some(object) => self.weight[n * self.objects + object] += e.weight,
                None => self.unnamed[n] += e.weight,
            }
        }
    }

    /// Weight of a Gaussian in all objects [pixel].
    pub fn seen(&self, n: usize) -> f32 {
        self.of(n).iter().sum()
    }

    fn of(&self, n: usize) -> &[f32] {
        &self.weight[n * self.objects..(n + 1) * self.objects]
    }

    /// The closed form: shares of the objects, `[gaussians][objects]`, 0 where nothing was seen.
    pub fn shares(&self) -> Vec<f32> {
        let share = |of: &[f32]| {
            let sum: f32 = of.iter().sum();
            let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
            of.iter().map(|w| w * scale).collect::<Vec<_>>()
        };
        let rows = self.weight.par_chunks(self.objects.max(1));
        rows.flat_map_iter(share).collect()
    }
}

/// The object of largest share for each Gaussian; -1 and 0 where all shares are 0.
fn largest(shares: &[f32], objects: usize) -> Labels {
    let best = |of: &[f32]| {
        let mut best = (-1, 0.0);
        for (object, &share) in of.iter().enumerate() {
            if share > best.1 {
                best = (object as i32, share);
            }
        }
        best
    };
    let all: Vec<(i32, f32)> = shares.par_chunks(objects.max(1)).map(best).collect();
    Labels {
        object: all.iter().map(|b| b.0).collect(),
        // Features of a refinement may be more than a share.
        confidence: all.iter().map(|b| b.1.min(1.0)).collect(),
    }
}

/// The graph that labels spread over: neighbours, and how much alike they are.
pub struct Graph {
    neighbours: Neighbours,
    /// Of each edge, 0..=1.
    affinity: Vec<f32>,
}

impl Graph {
    /// Graph over the Gaussians of a splat.
    pub fn new(splat: &Splat) -> Self {
        let neighbours = Neighbours::new(&splat.position, NEIGHBOURS);
        let count = neighbours.count;
        let affinity = (0..splat.len())
            .into_par_iter()
            .flat_map_iter(|n| {
                let near = neighbours.of(n);
                // A Gaussian's own scale: splats are dense in one place and sparse in another.
                let scale = neighbours.distance[n * count + count / 2].max(f32::MIN_POSITIVE);
                near.map(move |(m, distance)| {
                    let apart = distance / scale;
                    let color = (splat.color[n] - splat.color[m]).length() / COLOR_SCALE;
                    (-0.5 * apart * apart - color * color).exp().max(1e-6)
                })
                .collect::<Vec<_>>()
            })
            .collect();
        Self {
            neighbours,
            affinity,
        }
    }

    /// Shares `[gaussians][objects]` after diffusion. Those of the masks stay in the mean with a weight that grows with
    /// `seen` [pixel]; a Gaussian that no step reached keeps zeros.
    pub fn diffuse(&self, shares: &[f32], seen: &[f32], objects: usize) -> Vec<f32> {
        let count = self.neighbours.count;
        let mut now = shares.to_vec();
        let mut next = vec![0.0; shares.len()];
        for _ in 0..STEPS {
            next.par_chunks_mut(objects.max(1))
                .enumerate()
                .for_each(|(n, out)| {
                    let trust = seen[n] / TRUST;
                    let own = &shares[n * objects..(n + 1) * objects];
                    for (out, share) in out.iter_mut().zip(own) {
                        *out = trust * share;
                    }
                    let mut total = trust;
                    let affinity = &self.affinity[n * count..(n + 1) * count];
                    let sum: f32 = affinity.iter().sum();
                    for ((m, _), &a) in self.neighbours.of(n).zip(affinity) {
                        let other = &now[m * objects..(m + 1) * objects];
                        let known: f32 = other.iter().sum();
                        let a = a / sum;
                        total += a * known;
                        for (out, share) in out.iter_mut().zip(other) {
                            *out += a * share;
                        }
                    }
                    let scale = if total > 0.0 { 1.0 / total } else { 0.0 };
                    out.iter_mut().for_each(|share| *share *= scale);
                });
            std::mem::swap(&mut now, &mut next);
        }
        now
    }
}

/// Gives every Gaussian without a label the one of the nearest Gaussian that has one.
pub fn fill_from_nearest(labels: &mut Labels, position: &[Vec3]) {
    let known: Vec<bool> = labels.object.iter().map(|&o| o >= 0).collect();
    if known.iter().all(|known| *known) || !known.contains(&true) {
        return;
    }
    let places: Vec<u32> = (0..known.len() as u32)
        .filter(|&n| known[n as usize])
        .collect();
    let points: Vec<Vec3> = places.iter().map(|&n| position[n as usize]).collect();
    let tree = Tree::new(&points);
    let found: Vec<(usize, i32)> = (0..known.len())
        .into_par_iter()
        .filter(|&n| !known[n])
        .filter_map(|n| {
            let (_, nearest) = *tree.nearest(position[n], 1, &|_| true).first()?;
            Some((n, labels.object[places[nearest as usize] as usize]))
        })
        .collect();
    for (n, object) in found {
        labels.object[n] = object;
    }
}

/// Sums of `weight` `[gaussians][objects]` over superpoints, `[superpoints][objects]`.
fn of_superpoints(tree: &superpoints::Tree, weight: &[f32], objects: usize) -> Vec<f64> {
    let mut sum = vec![0.0f64; tree.size.len() * objects];
    for (n, superpoint) in tree.superpoint.iter().enumerate() {
        let sums = &mut sum[*superpoint as usize * objects..][..objects];
        for (sum, weight) in sums.iter_mut().zip(&weight[n * objects..]) {
            *sum += f64::from(*weight);
        }
    }
    sum
}

/// Adds to the shares of every Gaussian those of its superpoint by `weight`, both `[gaussians][objects]`; they sum to 1 again.
fn join_superpoints(shares: &mut [f32], tree: &superpoints::Tree, weight: &[f32], objects: usize) {
    let sum = of_superpoints(tree, weight, objects);
    let rows = shares.par_chunks_mut(objects.max(1));
    rows.zip(&tree.superpoint).for_each(|(shares, superpoint)| {
        let sums = &sum[*superpoint as usize * objects..][..objects];
        let all: f64 = sums.iter().sum();
        if all <= SEEN {
            return;
        }
        for (share, sum) in shares.iter_mut().zip(sums) {
            *share += SUPERPOINT * (sum / all) as f32;
        }
        let total: f32 = shares.iter().sum();
        shares.iter_mut().for_each(|share| *share /= total);
    });
}

/// Gives Gaussians that no view shows the object of most weight in their superpoint, or in the first node above it that is
/// seen: a bottom that stands on the ground is of what is above it and alike, not of the ground. `weight` is
/// `[gaussians][objects]` [pixel].
pub fn fill_unseen(labels: &mut Labels, tree: &superpoints::Tree, weight: &[f32], objects: usize) {
    let of = |n: usize| &weight[n * objects..(n + 1) * objects];
    let mut sum = of_superpoints(tree, weight, objects);
    sum.resize(tree.nodes() * objects, 0.0);
    for node in tree.size.len()..tree.nodes() {
        for part in tree.children(node).into_iter().flatten() {
            for k in 0..objects {
                sum[node * objects + k] += sum[part * objects + k];
            }
        }
    }
    let parent = tree.parents();
    let object_of = |superpoint: usize| {
        let mut chain = std::iter::successors(Some(superpoint), |n| parent[*n]);
        chain.find_map(|n| {
            let sums = &sum[n * objects..(n + 1) * objects];
            let all: f64 = sums.iter().sum();
            let best = (0..objects).max_by(|&a, &b| sums[a].total_cmp(&sums[b]).then(b.cmp(&a)))?;
            (all > SEEN).then(|| (best as i32, (sums[best] / all) as f32))
        })
    };
    let found: Vec<_> = (0..tree.size.len()).map(object_of).collect();
    for (n, superpoint) in tree.superpoint.iter().enumerate() {
        let Some((object, share)) = found[*superpoint as usize] else {
            continue;
        };
        if of(n).iter().sum::<f32>() < UNSEEN {
            labels.object[n] = object;
            labels.confidence[n] = share;
        }
    }
}

/// How far masks of an object lie in Gaussians of it (first), and Gaussians of it in masks of its name (second), in a view: the
/// weight that does, and all weight.
type Agreement = [[f64; 2]; 2];

/// The object of a mask, where it names one of so many.
fn named(e: &Evidence, objects: usize) -> Option<usize> {
    usize::try_from(e.mask).ok().filter(|mask| *mask < objects)
}

fn labelled(e: &Evidence, labels: &Labels) -> Option<usize> {
    usize::try_from(labels.object[e.gaussian as usize]).ok()
}

/// Agreement of what a view says with labels, for each object.
fn agreements(view: &[Evidence], labels: &Labels, objects: usize) -> Vec<Agreement> {
    let mut sums = vec![Agreement::default(); objects];
    for e in view.iter().filter(|e| named(e, objects).is_some()) {
        let (mask, label) = (named(e, objects), labelled(e, labels));
        let weight = f64::from(e.weight);
        for (kind, object) in [mask, label].into_iter().enumerate() {
            if let Some(object) = object {
                sums[object][kind][0] += if mask == label { weight } else { 0.0 };
                sums[object][kind][1] += weight;
            }
        }
    }
    sums
}

/// What views must agree by for what they say about each object to count: a part of what its better views agree by, within
/// [`AGREEMENT`]. Where edges are good, a mask that is half wrong is wrong; where they are bad everywhere, it is the best there is.
fn least(views: &[Vec<Agreement>], objects: usize) -> Vec<[f64; 2]> {
    let of = |object: usize, kind: usize| {
        let sums = views.iter().map(|view| view[object][kind]);
        let sums = sums.filter(|[_, all]| *all > 0.0);
        let mut shares: Vec<f64> = sums.map(|[agree, all]| agree / all).collect();
        shares.sort_unstable_by(f64::total_cmp);
        let better = (BETTER * shares.len() as f64).ceil() as usize;
        let better = shares.get(better.saturating_sub(1)).copied();
        let [low, high] = AGREEMENT;
        (OF_BETTER * better.unwrap_or(1.0)).clamp(low, high)
    };
    (0..objects)
        .map(|n| [0, 1].map(|kind| of(n, kind)))
        .collect()
}

/// What a view says that agrees with labels by the `least` that each object asks for, about masks and about Gaussians. A mask with
/// the name of another object agrees by neither, also where it is small beside the right mask of that name. What says nothing is
/// believed.
fn believed(
    view: &[Evidence],
    labels: &Labels,
    agreed: &[Agreement],
    least: &[[f64; 2]],
) -> Vec<Evidence> {
    let holds = |object: usize, kind: usize| {
        let [agree, all] = agreed[object][kind];
        agree >= least[object][kind] * all
    };
    let is_believed = |e: &&Evidence| {
        named(e, agreed.len()).is_some_and(|mask| holds(mask, 0))
            && labelled(e, labels).is_none_or(|label| holds(label, 1))
    };
    view.iter().filter(is_believed).copied().collect()
}

/// Labels of all Gaussians of `splat` from masks of `views` views that name `objects` objects; `evidence` gives what those of
/// a view say, and is asked three times for each. First all masks count; then those that most of what they cover contradicts are left
/// out, and what a view says about objects that it calls something else.
///
/// # Errors
/// Those of `evidence`.
pub fn lift<E>(
    splat: &Splat,
    objects: usize,
    views: usize,
    mut evidence: impl FnMut(usize) -> Result<Vec<Evidence>, E>,
) -> Result<(Lifted, Labels), E> {
    let graph = Graph::new(splat);
    let tree = superpoints::Tree::new(splat);
    let mut all = Lifted::new(splat.len(), objects);
    for view in 0..views {
        all.add(&evidence(view)?, |mask| usize::try_from(mask).ok());
    }
    // Once more changes nothing any more where it was tried.
    let labels = label(splat, &graph, &tree, &all);
    let mut agreements_of = Vec::with_capacity(views);
    for view in 0..views {
        agreements_of.push(agreements(&evidence(view)?, &labels, objects));
    }
    let least = least(&agreements_of, objects);
    let mut agreed = Lifted::new(splat.len(), objects);
    for (view, agreement) in agreements_of.iter().enumerate() {
        let said = believed(&evidence(view)?, &labels, agreement, &least);
        agreed.add(&said, |mask| usize::try_from(mask).ok());
    }
    let mut labels = label(splat, &graph, &tree, &agreed);
    fill_unseen(&mut labels, &tree, &agreed.weight, objects);
    Ok((agreed, labels))
}

/// Labels of all Gaussians from what masks with names said: closed form, diffusion, superpoints, nearest labelled region.
fn label(splat: &Splat, graph: &Graph, tree: &superpoints::Tree, lifted: &Lifted) -> Labels {
    let objects = lifted.objects;
    let seen: Vec<f32> = (0..splat.len()).map(|n| lifted.seen(n)).collect();
    let mut shares = graph.diffuse(&lifted.shares(), &seen, objects);
    join_superpoints(&mut shares, tree, &lifted.weight, objects);
    of_shares(splat, &shares, objects)
}

/// The object of the largest share for every Gaussian; where there is none, that of the nearest Gaussian with one.
fn of_shares(splat: &Splat, shares: &[f32], objects: usize) -> Labels {
    let mut labels = largest(shares, objects);
    fill_from_nearest(&mut labels, &splat.position);
    labels
}

/// Labels of all Gaussians from shares `[gaussians][objects]` of those that are `seen` [pixel]: diffusion, nearest labelled
/// region.
pub fn spread(splat: &Splat, graph: &Graph, shares: &[f32], seen: &[f32]) -> Labels {
    let objects = shares.len() / splat.len().max(1);
    of_shares(splat, &graph.diffuse(shares, seen, objects), objects)
}

/// How far labels agree with what views say: intersection over union of weights, mean over the objects that either has.
pub fn agreement(labels: &Labels, objects: usize, views: &[Vec<Evidence>]) -> f64 {
    let (mut both, mut either) = (vec![0.0f64; objects], vec![0.0f64; objects]);
    for e in views.iter().flatten() {
        let weight = f64::from(e.weight);
        let label = usize::try_from(labels.object[e.gaussian as usize]).ok();
        let Some(mask) = usize::try_from(e.mask).ok().filter(|m| *m < objects) else {
            continue;
        };
        either[mask] += weight;
        match label.filter(|l| *l < objects) {
            Some(label) if label == mask => both[mask] += weight,
            Some(label) => either[label] += weight,
            None => {}
        }
    }
    let of = both
        .iter()
        .zip(&either)
        .filter(|(_, either)| **either > 0.0);
    let of: Vec<f64> = of.map(|(both, either)| both / either).collect();
    of.iter().sum::<f64>() / of.len().max(1) as f64
}
