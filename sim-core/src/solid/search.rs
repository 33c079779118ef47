//! Which points of a solid's surface may touch what: listed once, and true until things have come nearer by a margin.

use super::inverse::Start;
use crate::mat3::length;

/// How near to what they may touch points are listed [cells].
pub(super) const MARGIN: f64 = 0.5;

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
    /// By how much they have come nearer at most since the list was made [m], and when it ends.
    pub way: f64,
    end: f64,
    pub points: Vec<Candidate>,
}

impl CandidateList {
    /// Goes on to where all stand now; whether the list is still true.
    pub fn go_on(&mut self, now: Stand, with: &[(u32, Stand)]) -> bool {
        let Some(then) = self.stand.replace(now) else {
            return false;
        };
        let mut nearer = 0.0_f64;
        for ((_, before), (_, other)) in self.with.iter_mut().zip(with) {
            nearer = nearer.max(Stand::nearer([&now, &then], [other, before]));
            *before = *other;
        }
        self.way += nearer;
        self.way < self.end
    }

    /// A new list.
    pub fn begin(&mut self, found: FoundCandidates, with: &[(u32, Stand)]) {
        (self.way, self.end, self.points) = (0.0, found.end, found.points);
        self.with.clear();
        self.with.extend_from_slice(with);
    }
}

/// Points near something, and how far things may come nearer before they are looked for again [m].
pub(crate) struct FoundCandidates {
    pub points: Vec<Candidate>,
    pub end: f64,
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
