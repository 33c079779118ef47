//! Where the loop is in a frame: the substep at hand, and the one after it.

use super::{
    limit::{Limit, time_step},
    rates::{Rate, Rates},
};
use crate::{
    colliders::Substep,
    kinematics::kick,
    state::{Given, GridMotion, Matter},
};

/// Substeps of a segment at most: the work that a rollback may repeat.
pub(crate) const SEGMENT: usize = 32;
/// Largest distance out of its block at which a particle may still be scattered [cells]: the drift margin of the tiles,
/// less the round-off of positions.
pub(super) const MARGIN: f64 = 0.999;

/// What stays the same from one rollback, or sort, to the next.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    /// How objects take substeps.
    pub rates: Rates,
    /// Length of the frame [s].
    pub length: f64,
    /// Smallest substep that is planned [s].
    pub smallest_dt: f64,
    /// Largest substep after failures, and why.
    pub cap: Limit,
    /// Substeps that a rolled-back segment had accepted, to be taken again: then it ends [s].
    pub replay: Vec<f64>,
    /// Substeps accepted so far [s].
    pub taken: Vec<f64>,
    /// Whether the first substep is not tried again if it fails.
    pub last_try: bool,
    /// Particles that sleep through the frame.
    pub asleep: usize,
}

/// The substep at hand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Schedule {
    /// Its size [s].
    pub dt: f64,
    /// That of coarse objects, which may have begun earlier [s].
    pub coarse_dt: f64,
    /// What limits it.
    pub limit: Limit,
    /// Fine substeps since coarse objects began theirs.
    pub index: u32,
    /// What is left of the frame where it begins [s].
    pub remaining: f64,
    /// The same where coarse objects began theirs [s].
    coarse_remaining: f64,
}

/// A substep among what it reads.
pub(super) struct Context<'a> {
    pub given: Given<'a>,
    pub segment: &'a Segment,
    pub schedule: &'a Schedule,
    /// As fine objects see it.
    pub now: Substep,
}

impl<'a> Context<'a> {
    /// A substep of a segment, before which velocities are behind positions by `offset` [s].
    pub fn new(
        given: Given<'a>,
        segment: &'a Segment,
        schedule: &'a Schedule,
        offset: f64,
    ) -> Self {
        Self {
            now: segment.substep(schedule, &given, Rate::Fine, offset),
            given,
            segment,
            schedule,
        }
    }

    /// Whether coarse objects move at its end.
    pub fn ends_coarse(&self) -> bool {
        self.segment.ends_coarse(self.schedule)
    }
}

impl Segment {
    /// The first substep, with so much left of the frame [s].
    pub fn first(
        &self,
        given: &Given<'_>,
        matter: &Matter,
        motion: &GridMotion,
        remaining: f64,
    ) -> Schedule {
        let limit = time_step(given, matter, motion, &self.rates);
        self.choose(limit, self.replay.first(), remaining)
    }

    /// The substep after the one at hand.
    pub(super) fn next(&self, at: &Context<'_>, matter: &Matter, motion: &GridMotion) -> Schedule {
        let before = at.schedule;
        let remaining = before.remaining - before.dt;
        if at.ends_coarse() {
            let limit = time_step(&at.given, matter, motion, &self.rates);
            return self.choose(limit, self.replay.get(self.taken.len() + 1), remaining);
        }
        self.with_share(Schedule {
            index: before.index + 1,
            remaining,
            ..*before
        })
    }

    /// Whether the substep at hand is not tried again if it fails.
    pub fn is_last_try(&self) -> bool {
        self.last_try && self.taken.is_empty()
    }

    /// A substep that all objects begin: equal shares of what is left of the frame, rounded to the precision of the
    /// kernels so that the shares add up to the frame.
    fn choose(&self, limit: Limit, replayed: Option<&f64>, remaining: f64) -> Schedule {
        let limit = match self.cap.dt < limit.dt {
            true => self.cap,
            false => limit,
        };
        let of = |coarse_dt: f64, limit: Limit| {
            self.with_share(Schedule {
                dt: coarse_dt,
                coarse_dt,
                limit,
                index: 0,
                remaining,
                coarse_remaining: remaining,
            })
        };
        if let Some(&dt) = replayed {
            return of(dt, limit);
        }
        let largest = limit.dt.max(self.smallest_dt.min(self.cap.dt));
        let largest = largest * f64::from(self.rates.per_coarse);
        // A share may exceed the limit by rounding: better than one substep more.
        let shares = (remaining / largest - 1e-6).ceil().max(1.0);
        if shares <= 1.0 {
            return of(remaining, Limit::FRAME);
        }
        of(f64::from((remaining / shares) as f32), limit)
    }

    /// With the size of the fine substep: equal shares of the coarse one, of which the last takes what rounding left.
    fn with_share(&self, at: Schedule) -> Schedule {
        let dt = match (self.rates.per_coarse, self.ends_coarse(&at)) {
            (1, _) => at.coarse_dt,
            (_, true) => at.remaining - (at.coarse_remaining - at.coarse_dt),
            (count, false) => f64::from((at.coarse_dt / f64::from(count)) as f32),
        };
        Schedule { dt, ..at }
    }

    /// Whether coarse objects move at the end of a substep.
    pub(super) fn ends_coarse(&self, at: &Schedule) -> bool {
        at.index + 1 == self.rates.per_coarse
    }

    /// Whether the segment ends with a substep in which particles `drift` out of their blocks [cells] and travel on.
    pub(super) fn ends(&self, at: &Schedule, drift: f64, travel: f64) -> bool {
        let count = self.taken.len() + 1;
        let per_coarse = self.rates.per_coarse as usize;
        let replayed = !self.replay.is_empty() && count == self.replay.len();
        let is_full = count + per_coarse > SEGMENT;
        // Coarse objects advect once, at the end, and the others twice until they are here again.
        let farthest = drift + travel + travel * (2 * per_coarse - 2) as f64;
        let no_more = replayed || is_full || at.dt >= at.remaining || farthest > MARGIN;
        self.ends_coarse(at) && no_more
    }

    /// The substep of objects with this rate, whose velocities are behind positions by `offset` [s].
    fn substep(&self, at: &Schedule, given: &Given<'_>, rate: Rate, offset: f64) -> Substep {
        let (dt, remaining) = match rate {
            Rate::Fine => (at.dt, at.remaining),
            Rate::Isolated | Rate::Coupled => (at.coarse_dt, at.coarse_remaining),
        };
        Substep {
            time: given.time + (self.length - remaining),
            dt,
            kick: kick(offset, dt, given.model.scene.cfl)[0],
            frame_start: given.time,
            frame_length: self.length,
        }
    }

    /// The substep that ends for such objects, and the one that begins, both the one at hand where there is no `next`.
    pub(super) fn substeps(
        &self,
        at: &Schedule,
        next: Option<&Schedule>,
        given: &Given<'_>,
        rate: Rate,
        offset: f64,
    ) -> [Substep; 2] {
        let ends = self.substep(at, given, rate, offset);
        let Some(next) = next else {
            return [ends; 2];
        };
        let cfl = given.model.scene.cfl;
        let dt = match rate {
            Rate::Fine => next.dt,
            Rate::Isolated | Rate::Coupled => next.coarse_dt,
        };
        let offset = kick(offset, ends.dt, cfl)[1];
        let begins = Substep {
            time: ends.time + ends.dt,
            dt,
            kick: kick(offset, dt, cfl)[0],
            ..ends
        };
        [ends, begins]
    }
}

impl Schedule {
    /// What of the coarse substep has passed where it begins [s].
    pub(super) fn elapsed(&self) -> f64 {
        match self.index {
            0 => 0.0,
            _ => self.coarse_remaining - self.remaining,
        }
    }
}
