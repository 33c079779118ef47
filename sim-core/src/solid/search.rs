//! Which points of a solid's surface may touch what: listed once, and looked for again cluster by cluster, each as soon as things may
//! have come nearer by as much as its points are away.

use std::ops::Range;

use rayon::prelude::*;

use super::inverse::Start;
use crate::mat3::length;

/// How near to what they may touch points are listed [cells].
pub(super) const MARGIN: f64 = 0.5;
/// Points of a cluster: neighbours on the surface, which are looked for together.
const CLUSTER: usize = 32;
/// Points per task at least.
pub(super) const TASK: usize = 64;

/// Smallest and largest coordinates [m].
pub(crate) type Bounds = [[f64; 3]; 2];

/// Where something that moves is, and how far anything of it may have moved besides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stand {
    /// [m]
    pub place: [f64; 3],
    /// Unit quaternion.
    pub turn: [f64; 4],
    /// How far from the place anything counts that turns [m].
    pub radius: f64,
    /// Way of what moves fastest in that frame [m].
    pub own: f64,
}

impl Stand {
    /// How far any point of two things may have come nearer to the other since they stood elsewhere [m].
    fn nearer([now, then]: [&Self; 2], [other, other_then]: [&Self; 2]) -> f64 {
        let mut apart = [0.0; 3];
        for a in 0..3 {
            let way = now.place[a] - then.place[a];
            apart[a] = way - (other.place[a] - other_then.place[a]);
        }
        length(apart) + now.swept(then) + other.swept(other_then)
    }

    fn swept(&self, then: &Self) -> f64 {
        let norm = |sign: f64| -> f64 {
            let parts = self.turn.iter().zip(&then.turn);
            parts.map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>()
        };
        // A chord of a turn is at most twice as long as the difference of the quaternions times the radius.
        let turn = norm(1.0).min(norm(-1.0)).sqrt();
        2.0 * turn * self.radius + (self.own - then.own)
    }
}

/// A point that may touch something.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    /// Its number.
    pub point: u32,
    /// The [way](CandidateList::way) at which it is looked at again [m].
    pub until: f64,
}

impl Candidate {
    /// A point so far from what it may touch [m].
    pub fn new(point: usize, clear: f64) -> Self {
        Self {
            point: point as u32,
            until: clear.max(0.0),
        }
    }
}

/// Points that may touch some things.
#[derive(Clone, Debug, Default)]
pub(crate) struct CandidateList {
    /// Where the solid stood, and the others, when they were looked at last.
    stand: Option<Stand>,
    with: Vec<(u32, Stand)>,
    /// By how much they have come nearer at most since the list was made [m].
    pub way: f64,
    /// The way at which points of a cluster that are not listed are looked for again, per cluster [m].
    until: Vec<f64>,
    /// In ascending order.
    pub points: Vec<Candidate>,
}

impl CandidateList {
    /// Goes on to where all stand now; a new list of so many points knows nothing yet.
    pub fn go_on(&mut self, now: Stand, with: &[(u32, Stand)], points: usize) {
        let Some(then) = self.stand.replace(now) else {
            self.way = 0.0;
            self.points.clear();
            self.until.clear();
            self.until.resize(points.div_ceil(CLUSTER), 0.0);
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
    }

    /// Clusters whose points have to be looked for, ascending.
    pub fn due(&self) -> Vec<usize> {
        let clusters = 0..self.until.len();
        clusters.filter(|&n| self.until[n] <= self.way).collect()
    }

    /// Lists anew what was found in clusters that were due.
    pub fn renew(&mut self, due: &[usize], found: Vec<FoundInCluster>) {
        let before = std::mem::take(&mut self.points);
        let mut before = before.into_iter().peekable();
        let way = self.way;
        for (&cluster, found) in due.iter().zip(found) {
            let first = cluster * CLUSTER;
            while let Some(point) = before.next_if(|p| (p.point as usize) < first + CLUSTER) {
                if (point.point as usize) < first {
                    self.points.push(point);
                }
            }
            self.points
                .extend(found.points.into_iter().map(|p| Candidate {
                    until: way + p.until,
                    ..p
                }));
            self.until[cluster] = way + found.clear;
        }
        self.points.extend(before);
    }
}

/// Points of a cluster near something, and how far all others of it are at least [m].
pub(crate) struct FoundInCluster {
    points: Vec<Candidate>,
    clear: f64,
}

impl FoundInCluster {
    /// None, all being so far away at least [m].
    pub fn none(clear: f64) -> Self {
        Self {
            points: vec![],
            clear,
        }
    }

    fn of(points: Range<usize>, margin: f64, clear: impl Fn(usize) -> f64) -> Self {
        let mut found = Self::none(f64::INFINITY);
        for n in points {
            let clear = clear(n);
            if clear < margin {
                found.points.push(Candidate::new(n, clear));
            } else {
                found.clear = found.clear.min(clear);
            }
        }
        found
    }
}

/// Points of the clusters that are due, of so many points, that are nearer than a margin [m] to something; `clear` tells how far one
/// is at least [m].
pub(super) fn find_near(
    due: &[usize],
    points: usize,
    margin: f64,
    clear: impl Fn(usize) -> f64 + Sync,
) -> Vec<FoundInCluster> {
    let clusters = due.par_iter().with_min_len(TASK / CLUSTER);
    let found = clusters.map(|&cluster| {
        let first = cluster * CLUSTER;
        FoundInCluster::of(first..points.min(first + CLUSTER), margin, &clear)
    });
    found.collect()
}

/// What a solid knows of its surroundings; begun anew in every frame, so that no frame depends on those before, and where
/// something was undone.
#[derive(Clone, Debug, Default)]
pub(crate) struct Search {
    /// Way of the fastest node in the solid's frame since the frame began [m].
    pub own: f64,
    /// Box around the points of the surface, where the search for material points begins, and when.
    pub seen: Option<(Bounds, Start, Stand)>,
    pub lists: Vec<CandidateList>,
}

impl Search {
    /// Forgets everything.
    pub fn restart(&mut self) {
        (self.own, self.seen) = (0.0, None);
        // What was not asked for since the last time is not asked for again.
        self.lists.retain(|list| list.stand.is_some());
        self.lists.iter_mut().for_each(|list| list.stand = None);
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
            own: 0.0,
        };
        let mut list = CandidateList::default();
        let (margin, mut looked) = (0.1, 0);
        for step in 0..200 {
            let way = 0.01 * f64::from(step);
            list.go_on(stand(way), &[(0, stand(0.0))], count);
            let due = list.due();
            looked += due.len();
            let found = find_near(&due, count, margin, |n| height(n) - way);
            list.renew(&due, found);
            assert!(list.points.is_sorted_by_key(|p| p.point));
            for n in 0..count {
                // None that touches is left out, and none is looked at too late.
                if height(n) < way {
                    let known = list.points.iter().find(|p| p.point as usize == n);
                    assert!(known.is_some_and(|p| p.until <= list.way), "{step}: {n}");
                }
            }
        }
        // Two and a half clusters, each at most once per margin, the far ones less often: at once in every step it would be 600.
        assert!((6..60).contains(&looked), "{looked}");
    }

    #[test]
    fn things_that_move_together_come_no_nearer() {
        let rest = Stand {
            place: [0.0; 3],
            turn: [0.0, 0.0, 0.0, 1.0],
            radius: 2.0,
            own: 0.0,
        };
        let moved = Stand {
            place: [0.3, 0.0, 0.0],
            ..rest
        };
        assert_eq!(Stand::nearer([&moved, &rest], [&moved, &rest]), 0.0);
        assert!((Stand::nearer([&moved, &rest], [&rest, &rest]) - 0.3).abs() < 1e-15);
        let (s, c) = 0.05_f64.sin_cos();
        for sign in [1.0, -1.0] {
            let turned = Stand {
                turn: [0.0, 0.0, sign * s, sign * c],
                own: 0.1,
                ..rest
            };
            let nearer = Stand::nearer([&turned, &rest], [&rest, &rest]);
            // No less than the chord of a tenth of a radian at a radius of 2, and its own way.
            let least = 4.0 * s + 0.1;
            assert!((least..1.01 * least).contains(&nearer), "{nearer}");
        }
    }
}
