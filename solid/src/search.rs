//! Which points of a solid's surface may touch what: listed once, and looked for again cluster by cluster, each as soon as things may
//! have come nearer by as much as its points are away.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    bonds::Bound,
    ended::Ended,
    grip::ContactWith,
    inverse::{KnownPlace, Start},
    model::SolidModel,
    stand::Stand,
    state::SolidState,
};

/// How near to what they may touch points are listed [cells].
pub(super) const MARGIN: f64 = 0.5;
/// How much a box around a cluster may have to be grown before it is looked at anew [cells].
pub(super) const LOOSE: f64 = 0.25;
/// Points of a cluster: neighbours on the surface, which are looked for together.
pub(super) const CLUSTER: usize = 32;
/// Points of a part of a cluster, which has a box of its own.
pub(super) const PART: usize = 8;
/// Parts of a cluster.
pub(super) const PARTS: usize = CLUSTER / PART;
/// Points per task at least.
pub(super) const TASK: usize = 64;

/// Smallest and largest coordinates [m].
pub type Bounds = [[f64; 3]; 2];

/// A point that may touch something.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// Its number.
    pub point: u32,
    /// The [way](CandidateList::way) of its cluster at which it is looked at again [m].
    until: f64,
    /// Which part of another solid's clusters it is nearest to, counted through: a search begins there.
    pub part: u32,
    /// Where it was in that solid last, and how far from its surface: a search begins there if that is known.
    pub known: Option<KnownPlace>,
}

/// Points that may touch some things.
#[derive(Clone, Debug, Default)]
pub struct CandidateList {
    /// Where the solid stood, and the others, when they were looked at last.
    stand: Option<Stand>,
    with: Vec<(u32, Stand)>,
    /// By how much they have come nearer at most since the list was made, but for the ways of clusters [m].
    way: f64,
    of_clusters: Vec<ClusterWay>,
    /// How fast points and what is near them come nearer to each other at most [m/s]; 0 while that is not known.
    speed: f64,
    /// Whether it was gone on with at the latest look.
    is_of_now: bool,
    /// Memory for points that were listed before.
    before: Vec<Candidate>,
}

/// How far a cluster and what is near it have moved towards each other, and when its points are looked for again.
#[derive(Clone, Debug, Default)]
struct ClusterWay {
    /// What is near it, of what has ways of its own: by the numbers of these.
    near: Vec<u32>,
    /// Way of the fastest of those [m].
    other: f64,
    /// Way of it and all near it at which its points are looked for again [m].
    until: f64,
    /// The same with what is far from it, the fastest of all.
    until_far: f64,
    /// Way of it and all near it when it was followed last [m].
    way: f64,
    /// Its points that may touch something, in ascending order.
    points: Vec<Candidate>,
    /// Way at which the first of them is looked at again [m].
    next: f64,
}

impl ClusterWay {
    /// Way of it and all near it, of those of its list and its own [m].
    fn sum(&self, list: f64, own: f64) -> f64 {
        list + own + self.other
    }

    fn follow(&mut self, others: &[f64]) {
        let ways = self.near.iter().map(|&n| others[n as usize]);
        self.other = ways.fold(0.0, f64::max);
    }

    /// Lists anew what was found at a way [m]; one that is listed still goes on from where it was. What is new or due is looked
    /// at once: it may have gone through what is thin on its way here, and be as far from it on the other side.
    fn renew(&mut self, way: f64, found: Vec<Listed>, memory: &mut Vec<Candidate>) {
        let then = std::mem::replace(&mut self.way, way);
        std::mem::swap(&mut self.points, memory);
        let mut before = memory.drain(..).peekable();
        self.points.extend(found.into_iter().map(|near| {
            while before.next_if(|p| p.point < near.point).is_some() {}
            let listed = before.next_if(|p| p.point == near.point);
            // What it was found to be away by holds as well.
            let left = listed.as_ref().map_or(0.0, |p| p.until - then);
            let until = match left > 0.0 {
                true => way + near.clear.max(left),
                false => way,
            };
            Candidate {
                point: near.point,
                until,
                part: near.part,
                known: listed.and_then(|p| p.known),
            }
        }));
        drop(before);
        self.find_next();
    }

    fn find_next(&mut self) {
        let until = self.points.iter().map(|point| point.until);
        self.next = until.fold(f64::INFINITY, f64::min);
    }
}

/// Ways since the frame began: of a solid's clusters, and of groups of what it may touch [m].
#[derive(Clone, Copy)]
pub struct Ways<'a> {
    /// Of the solid's clusters.
    pub own: &'a [f64],
    /// Of groups of what it may touch.
    pub others: &'a [f64],
}

impl Ways<'_> {
    fn farthest(&self) -> f64 {
        self.others.iter().copied().fold(0.0, f64::max)
    }
}

impl CandidateList {
    /// Goes on to where all stand now, after `moved` [s]; a new list of so many clusters knows nothing yet.
    pub fn go_on(&mut self, now: Stand, with: &[(u32, Stand)], ways: &Ways<'_>, moved: f64) {
        let Some(then) = self.stand.replace(now) else {
            (self.way, self.speed) = (0.0, 0.0);
            self.of_clusters
                .resize_with(ways.own.len(), Default::default);
            for cluster in &mut self.of_clusters {
                cluster.near.clear();
                cluster.points.clear();
                (cluster.other, cluster.until, cluster.until_far) = (0.0, 0.0, 0.0);
                (cluster.way, cluster.next) = (0.0, f64::INFINITY);
            }
            self.with.clear();
            self.with.extend_from_slice(with);
            return;
        };
        let mut nearer = 0.0_f64;
        for ((_, before), (_, other)) in self.with.iter_mut().zip(with) {
            nearer = nearer.max(Stand::nearer([&now, &then], [other, before]));
            *before = *other;
        }
        self.way += nearer;
        let mut nearer = 0.0_f64;
        for (cluster, own) in self.of_clusters.iter_mut().zip(ways.own) {
            cluster.follow(ways.others);
            let way = cluster.sum(self.way, *own);
            nearer = nearer.max(way - std::mem::replace(&mut cluster.way, way));
        }
        if moved > 0.0 {
            self.speed = nearer / moved;
        }
    }

    /// By how much points of a cluster and what is near them have come nearer to each other at most [m].
    pub fn way(&self, cluster: usize, own: &[f64]) -> f64 {
        self.of_clusters[cluster].sum(self.way, own[cluster])
    }

    /// Whether no point is listed.
    pub fn is_empty(&self) -> bool {
        self.of_clusters.iter().all(|one| one.points.is_empty())
    }

    /// Looks at the points that are due: `meet` tells how far one is from what it may touch at least [m], and adds what comes of it, which
    /// is returned cluster after cluster.
    pub fn meet<T: Send>(
        &mut self,
        own: &[f64],
        meet: impl Fn(&mut Candidate, &mut Vec<T>) -> f64 + Sync,
    ) -> Vec<Vec<T>> {
        let base = self.way;
        let clusters = self.of_clusters.par_iter_mut().zip(own);
        let met = clusters.with_min_len(TASK / CLUSTER).map(|(cluster, own)| {
            let way = cluster.sum(base, *own);
            let mut met = vec![];
            if cluster.next <= way {
                for point in cluster.points.iter_mut().filter(|p| p.until <= way) {
                    point.until = way + meet(point, &mut met).max(0.0);
                }
                cluster.find_next();
            }
            met
        });
        met.collect()
    }

    /// Clusters whose points have to be looked for, ascending.
    pub fn due(&self, ways: &Ways<'_>) -> Vec<usize> {
        let farthest = ways.farthest();
        let is_due = |&n: &usize| {
            let cluster = &self.of_clusters[n];
            cluster.until <= self.way(n, ways.own)
                || cluster.until_far <= self.way + ways.own[n] + farthest
        };
        (0..self.of_clusters.len()).filter(is_due).collect()
    }

    /// Substep in which points come no deeper than `depth` [m], after one of `drift` [s] from where they were found; as much as
    /// `most` [s] where that is less.
    fn limit(&self, own: &[f64], depth: f64, drift: f64, most: f64) -> f64 {
        if !self.is_of_now || depth >= self.speed * most {
            return most;
        }
        let clear = |(n, one): (usize, &ClusterWay)| one.until.min(one.next) - self.way(n, own);
        let of_clusters = self.of_clusters.iter().enumerate().map(clear);
        let clear = of_clusters.fold(f64::INFINITY, f64::min);
        most.min((clear / self.speed - drift).max(0.0) + depth / self.speed)
    }

    /// How far points of a cluster are from what they may touch at least [m]; 0 where some are listed.
    pub fn clear(&self, cluster: usize, own: &[f64]) -> f64 {
        let one = &self.of_clusters[cluster];
        match one.points.is_empty() {
            true => (one.until - self.way(cluster, own)).max(0.0),
            false => 0.0,
        }
    }

    /// Lists anew what was found in clusters that were due.
    pub fn renew(&mut self, due: &[usize], ways: &Ways<'_>, found: Vec<FoundInCluster>) {
        let farthest = ways.farthest();
        for (&cluster, found) in due.iter().zip(found) {
            let of_cluster = &mut self.of_clusters[cluster];
            of_cluster.near = found.near;
            of_cluster.follow(ways.others);
            of_cluster.until_far = self.way + ways.own[cluster] + farthest + found.far;
            let way = of_cluster.sum(self.way, ways.own[cluster]);
            of_cluster.until = way + found.clear;
            of_cluster.renew(way, found.points, &mut self.before);
        }
    }
}

/// A point that was found to be near something.
#[derive(Clone, Copy, Debug)]
pub struct Listed {
    /// Its number.
    pub point: u32,
    /// Which part of another solid's clusters it is nearest to, counted through.
    pub part: u32,
    /// How far it is from what it may touch at least [m].
    clear: f64,
}

/// Points of a cluster near something.
pub struct FoundInCluster {
    /// The points.
    pub points: Vec<Listed>,
    /// How far all others are at least [m].
    clear: f64,
    /// Groups of what may touch them that are near.
    pub near: Vec<u32>,
    /// How far all others are at least [m].
    pub far: f64,
}

impl FoundInCluster {
    /// None, all being so far away at least [m].
    pub fn none(clear: f64) -> Self {
        Self {
            points: vec![],
            clear,
            near: vec![],
            far: f64::INFINITY,
        }
    }

    /// Some points, those nearer than a margin [m]; `clear` tells how far one is at least [m].
    #[inline(always)]
    pub fn of(points: Range<usize>, margin: f64, clear: impl Fn(usize) -> f64) -> Self {
        let mut found = Self::none(f64::INFINITY);
        for n in points {
            let clear = clear(n);
            if clear < margin {
                found.points.push(Listed {
                    point: n as u32,
                    part: 0,
                    clear: clear.max(0.0),
                });
            } else {
                found.clear = found.clear.min(clear);
            }
        }
        found
    }
}

/// Points of the clusters that are due that are near something, as `find` tells of one.
pub(super) fn find_near(
    due: &[usize],
    find: impl Fn(usize) -> FoundInCluster + Sync,
) -> Vec<FoundInCluster> {
    let clusters = due.par_iter().with_min_len(TASK / CLUSTER);
    clusters.map(|&cluster| find(cluster)).collect()
}

/// Boxes around the points of a cluster.
#[derive(Clone, Copy, Debug)]
pub struct ClusterBox {
    /// Of every part, from the solid's frame [m]; nowhere where there is none.
    pub parts: [Bounds; PARTS],
    /// Way of the cluster when it was looked at [m].
    pub own: f64,
}

/// A box that nothing is in.
pub(super) const NOWHERE: Bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

pub(super) fn joined([a, b]: &Bounds, [c, d]: &Bounds) -> Bounds {
    [
        std::array::from_fn(|n| a[n].min(c[n])),
        std::array::from_fn(|n| b[n].max(d[n])),
    ]
}

/// What a solid knows of itself and its surroundings; begun anew in every frame, so that no frame depends on those before, and where
/// something was undone.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// Way of the fastest node of each block in the solid's frame since the latest look [m].
    pub ways: Vec<f64>,
    /// Way of the fastest point of each cluster from the first look of the frame to the latest [m].
    pub own: Vec<f64>,
    /// The same of the fastest cluster of every group of boxes.
    pub groups: Vec<f64>,
    /// Where the ends of each cluster were at the latest look, from the solid's frame [m].
    pub ends: Vec<[[f64; 3]; 2]>,
    /// Per cluster.
    pub boxes: Vec<ClusterBox>,
    /// Whether that is of the substep at hand.
    pub is_fresh: bool,
    /// Where the search for material points begins, and where it stood then, with the way of its fastest cluster.
    pub start: Option<(Start, (Stand, f64))>,
    /// Points near each thing that it may touch.
    pub lists: Vec<CandidateList>,
    /// Points that flat slip walls hold, ascending.
    pub(super) bound: Vec<Bound>,
    /// What it is in contact with.
    pub contact: ContactWith,
    /// What is taken for how fast things come nearer while that is not known [m/s].
    speed: f64,
    /// Whether anything was looked for.
    pub has_begun: bool,
    /// What acted where its latest span ended.
    pub ended: Option<Ended>,
}

impl Search {
    /// Forgets everything.
    pub fn restart(&mut self) {
        self.ends.clear();
        self.boxes.clear();
        (self.is_fresh, self.contact, self.start) = (false, ContactWith::default(), None);
        (self.has_begun, self.speed, self.ended) = (false, 0.0, None);
        self.bound.clear();
        // What was not asked for since the last time is not asked for again.
        self.lists.retain(|list| list.stand.is_some());
        self.lists.iter_mut().for_each(|list| list.stand = None);
    }

    /// Adds what nodes may have moved by, per block [m].
    pub fn move_on(&mut self, ways: impl ExactSizeIterator<Item = f64>) {
        self.ways.resize(ways.len(), 0.0);
        for (sum, way) in self.ways.iter_mut().zip(ways) {
            *sum += way;
        }
        self.is_fresh = false;
    }

    /// Way of the fastest cluster [m].
    pub fn farthest(&self) -> f64 {
        self.own.iter().copied().fold(0.0, f64::max)
    }

    /// Boxes that parts of clusters are in, from the solid's frame, after a look [m].
    pub fn grown(&self) -> impl Iterator<Item = Bounds> {
        self.boxes.iter().zip(&self.own).flat_map(|(one, own)| {
            let by = own - one.own;
            one.parts
                .map(|[min, max]| [min.map(|x| x - by), max.map(|x| x + by)])
        })
    }

    /// Where the solid stands, after a look.
    pub fn stand(&self, state: &SolidState) -> Stand {
        Stand {
            place: state.shift,
            turn: [0.0, 0.0, 0.0, 1.0],
            radius: 0.0,
        }
    }

    /// A box that all points are in, after a look [m].
    pub fn bounds(&self, state: &SolidState) -> Bounds {
        let boxes = self.grown();
        let all = boxes.fold(NOWHERE, |all, one| joined(&all, &one));
        all.map(|x| std::array::from_fn(|a| x[a] + state.shift[a]))
    }

    /// Where a search for material points begins, after a look.
    pub fn start(&mut self, model: &SolidModel, state: &SolidState) -> Start {
        let now = (self.stand(state), self.farthest());
        if let Some((start, then)) = &self.start
            && now.1 - then.1 < MARGIN * model.dx
        {
            let mut start = *start;
            for a in 0..3 {
                start.centre[0][a] += now.0.place[a] - then.0.place[a];
            }
            return start;
        }
        let start = Start::of(model, state);
        self.start = Some((start, now));
        start
    }

    /// Takes note of whether a flat slip wall holds a point.
    pub(super) fn bind(&mut self, point: usize, bound: Option<Bound>) {
        let at = self.bound.binary_search_by_key(&point, |b| b.point);
        match (at, bound) {
            (Ok(at), Some(bound)) => self.bound[at] = bound,
            (Ok(at), None) => drop(self.bound.remove(at)),
            (Err(at), Some(bound)) => self.bound.insert(at, bound),
            (Err(_), None) => {}
        }
    }

    /// Takes this for how fast things come nearer while that is not known [m/s].
    pub fn expect(&mut self, speed: f64) {
        self.speed = speed;
    }

    /// Before all lists are looked at that count.
    pub fn begin_look(&mut self) {
        self.has_begun = true;
        for list in &mut self.lists {
            list.is_of_now = false;
        }
    }

    /// Keeps a list for the next substep.
    pub fn keep(&mut self, mut list: CandidateList) {
        if list.speed == 0.0 {
            list.speed = self.speed;
        }
        list.is_of_now = true;
        self.lists.push(list);
    }

    /// Substep in which contact comes no deeper than `depth` [m], after one of `drift` [s]; as much as `most` [s] where that is less.
    pub fn limit(&self, depth: f64, drift: f64, most: f64) -> f64 {
        match self.has_begun {
            false => most.min(depth / self.speed),
            true => self
                .lists
                .iter()
                .fold(most, |most, list| list.limit(&self.own, depth, drift, most)),
        }
    }

    /// The list for these things; an empty one where there is none.
    pub fn take(&mut self, with: &[(u32, Stand)]) -> CandidateList {
        let same = |list: &CandidateList| {
            let mut pairs = list.with.iter().zip(with);
            list.with.len() == with.len() && pairs.all(|(a, b)| a.0 == b.0)
        };
        let known = self.lists.iter().position(same);
        known.map_or_else(CandidateList::default, |at| self.lists.swap_remove(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_knows_all_points_near_a_wall_all_the_way() {
        let count = 5 * CLUSTER / 2;
        let height = |n: usize| 0.04 * n as f64 + 0.3 * (0.7 * n as f64).sin().abs();
        let stand = |way: f64| Stand {
            place: [0.0, -way, 0.0],
            turn: [0.0, 0.0, 0.0, 1.0],
            radius: 0.0,
        };
        let mut list = CandidateList::default();
        let (margin, mut looked) = (0.1, 0);
        // The second cluster shakes besides.
        let shakes = |n: usize, way: f64| {
            if n / CLUSTER == 1 {
                0.02 * (50.0 * way).sin()
            } else {
                0.0
            }
        };
        for step in 0..200 {
            let way = 0.01 * f64::from(step);
            let own = [0.0, 0.02 * 50.0 * way, 0.0];
            let ways = Ways {
                own: &own,
                others: &[],
            };
            list.go_on(stand(way), &[(0, stand(0.0))], &ways, 1.0);
            let due = list.due(&ways);
            looked += due.len();
            let found = find_near(&due, |cluster| {
                let first = cluster * CLUSTER;
                let points = first..count.min(first + CLUSTER);
                FoundInCluster::of(points, margin, |n| height(n) - way + shakes(n, way))
            });
            list.renew(&due, &ways, found);
            let listed = |n: usize| list.of_clusters[n / CLUSTER].points.iter();
            for n in 0..count {
                // None that touches is left out, and none is looked at too late.
                if height(n) + shakes(n, way) < way {
                    let known = listed(n).find(|p| p.point as usize == n);
                    let is_due = |p: &Candidate| p.until <= list.way(n / CLUSTER, &own);
                    assert!(known.is_some_and(is_due), "{step}: {n}");
                }
            }
        }
        // Each at most once per margin, the far ones less often: at once in every step it would be 600.
        assert!((6..60).contains(&looked), "{looked}");
    }

    #[test]
    fn what_comes_at_a_wall_comes_no_deeper_than_asked_at_first() {
        let stand = |place: [f64; 3]| Stand {
            place,
            turn: [0.0, 0.0, 0.0, 1.0],
            radius: 0.0,
        };
        let (depth, most) = (0.05, 0.02);
        for speed in [0.1, 3.0, 70.0] {
            let (mut search, mut height, mut moved) = (Search::default(), 1.0, 0.0);
            search.own = vec![0.0];
            search.expect(speed);
            let with = [(0, stand([0.0; 3]))];
            // The first is chosen before anything is looked for.
            let mut dt = search.limit(depth, 0.0, most);
            while height >= 0.0 {
                search.begin_look();
                let mut list = search.take(&with);
                let ways = Ways {
                    own: &[0.0],
                    others: &[],
                };
                list.go_on(stand([0.0, height, 0.0]), &with, &ways, moved);
                let due = list.due(&ways);
                let found = find_near(&due, |_| FoundInCluster::of(0..1, 0.1, |_| height));
                list.renew(&due, &ways, found);
                search.keep(list);
                height -= speed * dt;
                moved = dt;
                dt = search.limit(depth, moved, most);
                assert!(dt == most || speed * most > depth);
            }
            assert!(height >= -depth - 1e-9, "{speed} m/s: {height}");
        }
    }
}
